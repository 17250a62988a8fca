"""The style of every pixel, in px: what the painter's brush is, there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.frames import Plane
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.styles import STYLES, Style
from pipeline.strokes.brush import Brush
from pipeline.strokes.seeds import Field

FINER, SHORTER, CLOSER, MORE, CALMER = (0.55, 0.07), (0.3, 0.35), (0.75, 0.15), 1.0, 0.45
"""How much smaller strokes are where detail is fullest, in parts, and how much shorter; the same for the error
threshold; how many layers more there are; and how much less colours stray. Of pairs, the first goes with the detail,
the second with its square: that is for faces, which lose an eye to a stroke that is as long as they are wide."""
SMALLEST_PX = 1.7
"""Width of the finest strokes that are still strokes."""


@dataclass(frozen=True)
class StyleFields:
    """Brush of the coarsest layer, wished number of layers and error threshold; each a number, or one per pixel.

    `widest_px` is the style's widest stroke before any detail makes it finer: layers are counted by that, or the finest
    would go for the whole picture as soon as there is a little detail everywhere.
    """

    brush: Brush
    layers: Field
    threshold: Field
    widest_px: float


def chosen_style(params: MultistyleParams) -> Style:
    """The named style, as the parameters change it."""
    return adjusted(STYLES[params.style].style, params)


def adjusted(style: Style, params: MultistyleParams) -> Style:
    """A style, as the parameters of the group Style change it, within the limits of each."""
    wanted = {
        "size": style.size * params.stroke_size, "length": style.length * params.stroke_length,
        "opacity": style.opacity * params.opacity, "hue": (style.hue + params.hue + 180) % 360 - 180,
        "saturation": style.saturation + params.saturation, "value": style.value + params.value,
        "jitter": style.jitter * params.jitter, "relief": style.relief * params.relief,
        "grain": style.grain * params.grain, "layers": style.layers + params.layers,
        "threshold": style.threshold * params.threshold,
    }  # fmt: skip
    properties = Style.model_json_schema()["properties"]
    return Style(**{
        name: min(max(value, properties[name]["minimum"]), properties[name]["maximum"])
        for name, value in wanted.items()
    })  # fmt: skip


def uniform(style: Style) -> dict[str, Field]:
    return {name: float(getattr(style, name)) for name in Style.model_fields}


def style_fields(values: Mapping[str, Field], detail: Plane | None, height: int) -> StyleFields:
    """Style parameters as the renderer takes them.

    Args:
        values: every parameter of `Style` by name: a number, or float32 (h, w).
        detail: float32 (h, w) in 0..1, how much finer to paint; None = 0.
        height: of the frame, px.
    """
    px = np.float32(height / 1000)
    size, length, threshold, layers, jitter = (
        values[name] for name in ("size", "length", "threshold", "layers", "jitter")
    )
    widest_px = float(np.max(size) * px)
    if detail is not None:
        size = np.asarray(size * _less(detail, FINER), np.float32)
        length = np.asarray(length * _less(detail, SHORTER), np.float32)
        threshold = np.asarray(threshold * _less(detail, CLOSER), np.float32)
        jitter = np.asarray(jitter * (1 - np.float32(CALMER) * detail), np.float32)
        layers = np.asarray(layers + np.float32(MORE) * detail, np.float32)
    brush = Brush(
        size_px=np.maximum(np.multiply(size, px), np.float32(SMALLEST_PX)), length_px=np.multiply(length, px),
        opacity=values["opacity"], hue_deg=values["hue"], saturation=values["saturation"], value=values["value"],
        jitter=jitter, relief_px=np.multiply(values["relief"], px), grain=values["grain"],
    )  # fmt: skip
    return StyleFields(brush, layers, threshold, widest_px)


def _less(detail: Plane, parts: tuple[float, float]) -> Plane:
    return np.asarray(1 - np.float32(parts[0]) * detail - np.float32(parts[1]) * detail * detail, np.float32)
