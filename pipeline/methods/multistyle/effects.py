"""Ready-made designs for any video: the effects that kagaya2011video shows in section 6."""

from __future__ import annotations

from typing import TypeAlias, get_args

from pydantic import JsonValue

from pipeline.methods.multistyle.design import REST, Design
from pipeline.methods.multistyle.params import Effect

JsonObject: TypeAlias = dict[str, JsonValue]

EFFECTS: tuple[str, ...] = get_args(Effect)

BACKGROUND = "background"
"""Name of the region of the largest object of each shot; the region `rest` is the subject."""
SHARP: JsonObject = {"size": 9, "layers": 3, "threshold": 12}
BROAD: JsonObject = {"size": 44, "layers": 1}


def document(effect: Effect, frames: int) -> JsonObject:
    """The effect as a design document, which can be edited and passed as the input `design`.

    Args:
        frames: number of frames of the video.
    """
    last = max(frames - 1, 0)
    match effect:
        case "rack-focus":
            return _two(_rack(BACKGROUND, BROAD, SHARP, last) + _rack(REST, SHARP, BROAD, last))
        case "emphasis":
            dull: JsonObject = {**BROAD, "size": 34, "layers": 1.6, "saturation": -0.35, "value": -0.06, "jitter": 0.1}
            return _two([_key(BACKGROUND, 0, dull), _key(REST, 0, {**SHARP, "saturation": 0.18})])
        case "calm-to-stress":
            calm: JsonObject = {"size": 26, "length": 180, "jitter": 0.12, "saturation": -0.1}
            stress: JsonObject = {"size": 18, "length": 70, "jitter": 0.85, "saturation": 0.35, "hue": -35, "relief": 5}
            keys: list[JsonValue] = [_key(REST, 0, calm, "smooth"), _key(REST, last, stress)]
            return {"version": 1, "keys": keys[: 1 if last == 0 else 2]}
        case "none":
            return {"version": 1}


def documents(frames: int) -> dict[str, JsonObject]:
    """Every effect as a design document, by its name."""
    chosen: tuple[Effect, ...] = get_args(Effect)
    return {effect: document(effect, frames) for effect in chosen if effect != "none"}


def effect_design(effect: Effect, frames: int) -> Design | None:
    """The effect's design; None for the effect `none`."""
    return None if effect == "none" else Design.model_validate(document(effect, frames))


def _two(keys: list[JsonValue]) -> JsonObject:
    return {"version": 1, "regions": {BACKGROUND: {"objects": [1], "border": "soft"}}, "keys": keys}


def _rack(region: str, before: JsonObject, after: JsonObject, last: int) -> list[JsonValue]:
    """Two keys: the first style for a third of the video, the second for the last third, a smooth change between."""
    first, second = last // 3, 2 * last // 3
    if first == second:
        return [_key(region, 0, before)]
    return [_key(region, first, before, "smooth"), _key(region, second, after)]


def _key(region: str, frame: int, changes: JsonObject, ease: str = "linear") -> JsonObject:
    return {"region": region, "frame": frame, "set": changes, "ease": ease}
