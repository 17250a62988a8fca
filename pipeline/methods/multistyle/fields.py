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

FINER = 0.62
"""How much smaller strokes are where detail is fullest, in parts."""
SHORTER, CLOSER, MORE, CALMER = 0.65, 0.9, 1.0, 0.45
"""The same for their length and for the error threshold, in parts; how many layers more there are; and how much less
colours stray, in parts."""
SMALLEST_PX = 1.7
"""Width of the finest strokes that are still strokes."""


@dataclass(frozen=True)
class StyleFields:
    """Brush of the coarsest layer, wished number of layers and error threshold; each a number, or one per pixel."""

    brush: Brush
    layers: Field
    threshold: Field


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
    if detail is not None:
        size = np.asarray(size * (1 - np.float32(FINER) * detail), np.float32)
        length = np.asarray(length * (1 - np.float32(SHORTER) * detail), np.float32)
        threshold = np.asarray(threshold * (1 - np.float32(CLOSER) * detail), np.float32)
        jitter = np.asarray(jitter * (1 - np.float32(CALMER) * detail), np.float32)
        layers = np.asarray(layers + np.float32(MORE) * detail, np.float32)
    brush = Brush(
        size_px=np.maximum(np.multiply(size, px), np.float32(SMALLEST_PX)), length_px=np.multiply(length, px),
        opacity=values["opacity"], hue_deg=values["hue"], saturation=values["saturation"], value=values["value"],
        jitter=jitter, relief_px=np.multiply(values["relief"], px), grain=values["grain"],
    )  # fmt: skip
    return StyleFields(brush, layers, threshold)
