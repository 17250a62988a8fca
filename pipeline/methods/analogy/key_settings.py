"""Reach and weight of keyframes: the input `keyframe_settings`.

A keyframe determines the frames up to its neighbours. `before` and `after` limit how many frames before and after it
it reaches; `weight` moves the border between it and its neighbour. Frames that no keyframe reaches are painted as those
of a shot without keyframes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass

from pydantic import BaseModel, ConfigDict, Field, JsonValue, TypeAdapter, ValidationError

from pipeline.errors import BadParameter
from pipeline.methods.parts import FrameNumber, PaintedKey

FIELD = "inputs.keyframe_settings"


class _Row(BaseModel):
    """Settings of one keyframe in the document."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)

    frame: FrameNumber
    before: FrameNumber | None = None
    after: FrameNumber | None = None
    weight: float = Field(default=1.0, ge=0.1, le=10)


_ROWS = TypeAdapter(list[_Row])


@dataclass(frozen=True)
class KeySettings:
    """Settings of one keyframe.

    Attributes:
        before, after: how many frames before and after it it reaches; None = up to the next keyframe.
        weight: 0.1..10; between two keyframes, the border of what each determines divides their distance by their
            weights.
    """

    before: int | None = None
    after: int | None = None
    weight: float = 1.0

    def reaches(self, distance: int) -> bool:
        """Whether it reaches the frame `distance` frames after it (negative: before it)."""
        limit = self.after if distance > 0 else self.before
        return distance == 0 or limit is None or abs(distance) <= limit


PLAIN = KeySettings()
Settings = Mapping[int, KeySettings]
"""Frame number of a keyframe -> its settings, if they differ from `PLAIN`."""


def key_settings(given: JsonValue) -> dict[int, KeySettings]:
    """The settings by frame number, from the document "keyframe_settings".

    Raises:
        BadParameter: it is no list of objects with the members frame, before, after and weight, or names a frame twice.
    """
    try:
        rows = _ROWS.validate_python(given)
    except ValidationError as error:
        first = error.errors()[0]
        place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"])
        raise BadParameter(
            f"{first['msg']}.", field=f"{FIELD}{place}", value=str(first["input"])[:100],
            remedy='For example [{"frame": 40, "before": 10, "after": 12, "weight": 2}]; weights are 0.1 to 10.',
        ) from None  # fmt: skip
    found: dict[int, KeySettings] = {}
    for number, row in enumerate(rows):
        if row.frame in found:
            raise BadParameter(
                "A keyframe has its settings twice.", field=f"{FIELD}[{number}].frame", value=row.frame,
                remedy="Keep one of both rows.",
            )  # fmt: skip
        found[row.frame] = KeySettings(row.before, row.after, row.weight)
    return {frame: settings for frame, settings in found.items() if settings != PLAIN}


def settings_document(part: Sequence[PaintedKey]) -> JsonValue:
    """The document "keyframe_settings" of painted keys: those whose settings differ from the usual ones."""
    rows: list[JsonValue] = []
    for key in part:
        settings = KeySettings(key.before, key.after, key.weight)
        if settings != PLAIN:
            rows.append({"frame": key.frame, **asdict(settings)})
    return rows


def reaching(near: int, keys: Iterable[int], settings: Settings) -> list[int]:
    """The keyframes on both sides of a frame that reach it, the nearest first."""
    sides = (
        max((index for index in keys if index <= near), default=None),
        min((index for index in keys if index >= near), default=None),
    )
    found = {index for index in sides if index is not None and settings.get(index, PLAIN).reaches(near - index)}
    return sorted(found, key=lambda index: (abs(index - near), index))


def weighted(share: float, before: float, after: float) -> float:
    """The share of the keyframe after a frame, 0..1, from that of equal weights: 0 and 1 stay, and it is a half where
    the distances to both keyframes relate as their weights `before` and `after`."""
    return share if before == after else share * after / ((1 - share) * before + share * after)
