"""Named styles, and style parameters per pixel.

A style has two groups of numbers. `Style` holds those that kagaya2011video lists in section 3 and that a design can
set by name. `Technique` holds the rest of a style: layers, stroke profile, ground, pigment, lighting and paper. Both
vary over regions and time in the same way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from pipeline.frames import Plane
from pipeline.kernels.jit import kernel
from pipeline.methods.multistyle.params import MultistyleParams, StyleName
from pipeline.strokes.brush import Brush
from pipeline.strokes.seeds import StyleField

Values = Mapping[str, StyleField]
"""Style parameters by name: a number where a parameter is the same everywhere, otherwise float32 (h, w)."""


@dataclass(frozen=True)
class StyleConstants:
    """Constants of styles."""

    size_fall: tuple[float, float] = (0.55, 0.07)
    length_fall: tuple[float, float] = (0.3, 0.35)
    threshold_fall: tuple[float, float] = (0.75, 0.15)
    """Relative decrease of stroke size, stroke length and error threshold at full detail: coefficients of the
    detail and of its square. The square matters for faces, where a stroke as long as the face is wide hides an
    eye."""
    extra_layers: float = 1.0
    jitter_fall: float = 0.45
    """Additional layers, and relative decrease of the colour jitter, at full detail."""
    face_detail: float = 0.5
    """Detail above which a pixel counts as a face: other cues reach 0.4 with their default weights."""
    face_length_fall: float = 0.6
    face_jitter_fall: float = 0.6
    face_relief_fall: float = 0.6
    """Further relative decrease of stroke length, colour jitter and relief in the middle of a face."""
    face_opacity: float = 0.7
    """Part of the missing opacity of a stroke that is added in the middle of a face: through transparent strokes,
    the blur of a coarser layer hides the eyes."""
    luma: tuple[float, float, float] = (0.299, 0.587, 0.114)
    """Weights of red, green and blue in the gray of a colour (ITU-R BT.601)."""
    smallest_px: float = 1.7
    """Width of the finest strokes, px; narrower ones are not visible as strokes."""


STYLE_LIMITS = StyleConstants()


_RED, _GREEN, _BLUE = (np.float32(weight) for weight in STYLE_LIMITS.luma)


def _number(default: float, low: float, high: float, help_: str, unit: str) -> Any:
    return Field(default, ge=low, le=high, description=help_, json_schema_extra={"unit": unit})


class Style(BaseModel):
    """Style parameters of kagaya2011video, section 3. Each can differ from pixel to pixel and from frame to frame.

    Lengths are in thousandths of the picture's shorter side, so that a style looks alike at every size.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    size: float = _number(
        18, 2, 150, "Width of strokes, diameter of dots, in the coarsest layer.", "per mille of the shorter side"
    )
    length: float = _number(
        90, 0, 600, "Length of strokes in the coarsest layer; 0 = dots.", "per mille of the shorter side"
    )
    opacity: float = _number(1, 0.02, 1, "Opacity of a stroke.", "ratio")
    hue: float = _number(0, -180, 180, "Shift of hue.", "degrees")
    saturation: float = _number(0, -1, 1, "Shift of saturation.", "ratio")
    value: float = _number(0, -1, 1, "Shift of brightness.", "ratio")
    jitter: float = _number(0.2, 0, 1, "Random variation of colour from stroke to stroke.", "ratio")
    relief: float = _number(2, 0, 20, "Height of the paint of a stroke.", "per mille of the shorter side")
    grain: float = _number(0.6, 0, 1, "Strength of the bristle texture in a stroke.", "ratio")
    layers: float = _number(3, 1, 4, "Number of layers, coarse to fine; may be fractional.", "layers")
    threshold: float = _number(20, 0, 442, "Error above which a finer layer paints.", "RGB distance")


FIELDS: tuple[str, ...] = tuple(Style.model_fields)
"""Names of the style parameters, in the order of a style's vector."""


def vector(style: Style) -> NDArray[np.float32]:
    """The style as float32 (len(FIELDS),)."""
    return np.array([getattr(style, name) for name in FIELDS], np.float32)


class Technique(BaseModel):
    """Parameters of a style that are not in `Style`."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    layer_ratio: float = _number(0.5, 0.3, 0.8, "Stroke size of a layer relative to the layer below.", "ratio")
    overlap: float = _number(3, 0.5, 8, "Mean number of strokes of a layer on a pixel.", "strokes")
    scatter: float = _number(1, 0, 1, "Jitter of the seed grid. Uniform over a picture.", "ratio")
    edge: float = _number(90, 10, 442, "Colour distance at which strokes end.", "RGB distance")
    order_mix: float = _number(
        60, 0, 442, "Random variation of the painting order by colour; 0 = dark strokes always cover light ones.",
        "RGB distance",
    )  # fmt: skip
    taper_start: float = _number(0.15, 0, 1, "Decrease of width at the start of a stroke.", "ratio")
    taper_end: float = _number(0.6, 0, 1, "Decrease of width at the end of a stroke.", "ratio")
    streaks: float = _number(36, 0, 128, "Amplitude of lightness of the bristle texture.", "gray levels")
    dry: float = _number(0.6, 0, 1, "Paint missing between bristles at the end of a stroke.", "ratio")
    soft: float = _number(0.18, 0, 1, "Width over which stroke edges fade.", "radii")
    bristles: float = _number(
        5, 1, 20, "Density of the bristle texture: bristles from the centre to the side of a stroke, at most one a px.",
        "bristles",
    )  # fmt: skip
    ground_red: float = _number(235, 0, 255, "Colour of the ground.", "gray levels")
    ground_green: float = _number(226, 0, 255, "Colour of the ground.", "gray levels")
    ground_blue: float = _number(205, 0, 255, "Colour of the ground.", "gray levels")
    cover: float = _number(0, 0, 1, "Ground colour in the first coat; 0 = the picture's colours.", "ratio")
    vivid: float = _number(1, 0, 3, "Factor on the chroma of the paint.", "ratio")
    contrast: float = _number(1, 0, 3, "Factor on the lightness of the paint about middle gray.", "ratio")
    light: float = _number(0.35, 0, 2, "Relative change of lightness by relief, at a slope of 1.", "ratio")
    gloss: float = _number(0.1, 0, 2, "Highlights on relief.", "ratio")
    weave: float = _number(0, 0, 2, "Height of the canvas weave.", "px")
    rim: float = _number(0, 0, 1, "Edge darkening of wet areas.", "ratio")
    paper: float = _number(0, 0, 1, "Visibility of paper grain in thin paint.", "ratio")


TECHNIQUE_FIELDS: tuple[str, ...] = tuple(Technique.model_fields)
PIXEL_FIELDS: tuple[str, ...] = TECHNIQUE_FIELDS[TECHNIQUE_FIELDS.index("ground_red") :]
"""Technique parameters that the painter reads at every pixel; the others are read at the seeds of strokes."""
PROFILE_FIELDS: tuple[str, ...] = ("taper_start", "taper_end", "streaks", "dry", "soft", "bristles")


@dataclass(frozen=True)
class NamedStyle:
    """A style with a name that people recognise.

    Attributes:
        denoise_factor: factor on the parameter `noise_floor`, larger for broad wet paint, which does not follow every
            shade. One for a video.
        extra_frames: frames of temporal accumulation beyond the parameter `accumulated_frames`. One for a video.
    """

    title: str
    about: str
    style: Style
    technique: Technique
    denoise_factor: float = 1.0
    extra_frames: int = 0


STYLES: Mapping[StyleName, NamedStyle] = MappingProxyType({
    "van-gogh": NamedStyle(
        "Van Gogh", "Thick, curving strokes that run along every form; strong colour.",
        Style(
            size=20, length=105, jitter=0.25, saturation=0.08, relief=3.4, grain=0.75, layers=3, threshold=20,
        ),
        Technique(
            layer_ratio=0.55, overlap=2.6, edge=85, taper_start=0.2, taper_end=0.5, streaks=32, dry=0.35,
            light=0.31, gloss=0.08, vivid=1.25, contrast=1.06, order_mix=110,
        ),
    ),
    "impressionism": NamedStyle(
        "Impressionism", "Short, broken dabs of light colour, laid wet into wet.",
        Style(
            size=21, length=42, jitter=0.42, value=0.03, relief=2.0, grain=0.5, layers=3, threshold=22,
        ),
        Technique(
            layer_ratio=0.58, overlap=2.6, edge=80, taper_start=0.1, taper_end=0.3, streaks=24, dry=0.4,
            light=0.28, gloss=0.04, weave=0.12, vivid=1.2, order_mix=170,
        ),
    ),
    "expressionism": NamedStyle(
        "Expressionism", "Long, bold, restless strokes in colours stronger than nature.",
        Style(
            size=27, length=190, jitter=0.5, saturation=0.22, relief=2.2, grain=0.75, layers=3, threshold=34,
        ),
        Technique(
            layer_ratio=0.5, overlap=2.4, edge=75, taper_start=0.1, taper_end=0.7, streaks=36, dry=0.7,
            light=0.28, gloss=0.05, vivid=1.45, contrast=1.15, order_mix=50,
        ),
    ),
    "pointillism": NamedStyle(
        "Pointillism", "Dots of pure colour that mix in the eye, on a light ground.",
        Style(
            size=17, length=0, jitter=0.5, saturation=0.1, value=0.02, relief=0.8, grain=0, layers=2, threshold=26,
        ),
        Technique(
            layer_ratio=0.6, overlap=1.5, edge=90, scatter=0.6, taper_start=0, taper_end=0, streaks=0, dry=0, soft=0.4,
            light=0.22, gloss=0.0, weave=0.1, cover=0.24, vivid=1.3, order_mix=220,
        ),
    ),
    "colorist-wash": NamedStyle(
        "Colorist wash", "Transparent washes over each other, in free, strong colours.",
        Style(
            size=38, length=130, opacity=0.5, jitter=0.7, saturation=0.15, relief=0.4, grain=0.5, layers=3,
            threshold=20,
        ),
        Technique(
            layer_ratio=0.5, overlap=4.0, edge=75, taper_start=0.1, taper_end=0.4, streaks=18, dry=0.5,
            light=0.2, gloss=0, weave=0.12, cover=0.35, vivid=1.5, order_mix=240, rim=0.15, paper=0.25,
        ),
    ),
    "watercolor": NamedStyle(
        "Watercolor", "Pale, wet areas with darker rims, on white paper with a grain.",
        Style(
            size=44, length=60, opacity=0.43, jitter=0.4, value=0.06, relief=0, grain=0, layers=3, threshold=16,
        ),
        Technique(
            layer_ratio=0.5, overlap=3.7, edge=60, taper_start=0, taper_end=0, streaks=0, dry=0, soft=0.35,
            light=0, gloss=0, ground_red=250, ground_green=248, ground_blue=242, cover=0.4, vivid=1.3, order_mix=300,
            rim=0.4, paper=0.5,
        ),
        denoise_factor=1.5, extra_frames=2,
    ),
})  # fmt: skip


def chosen_style(params: MultistyleParams) -> Style:
    """The named style with the job's parameters applied."""
    return adjusted(STYLES[params.style].style, params)


def adjusted(style: Style, params: MultistyleParams) -> Style:
    """A style with the parameters of the group Style applied, limited to each parameter's range."""
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


def uniform(style: Style, technique: Technique) -> dict[str, StyleField]:
    """All parameters of a style by name."""
    return {name: float(getattr(own, name)) for own in (style, technique) for name in type(own).model_fields}


@dataclass(frozen=True)
class LayerStyle:
    """Style parameters in px, in the renderer's form; each is a number, or float32 on a grid over the picture.

    Attributes:
        brush: of the coarsest layer.
        layers, threshold: requested number of layers and error threshold.
        technique: by name, see `Technique`.
        widest_px: the widest stroke before detail makes it finer. It determines the number of layers; with the refined
            width, a little detail everywhere would remove the finest layer of the whole picture.
    """

    brush: Brush
    layers: StyleField
    threshold: StyleField
    technique: Values
    widest_px: float


def layer_style(values: Values, detail: Plane | None, side: int) -> LayerStyle:
    """Convert style parameters to px and apply the detail map.

    Args:
        values: all parameters of `Style` and `Technique`.
        detail: float32 in 0..1, 1 = finest strokes, of the shape of the values that are planes; None = 0.
        side: shorter side of the frame, px.
    """
    px = np.float32(side / 1000)
    size, length, threshold, layers, jitter = (
        values[name] for name in ("size", "length", "threshold", "layers", "jitter")
    )
    widest_px = float(np.max(size) * px)
    if detail is not None:
        size = np.asarray(size * _decrease(detail, STYLE_LIMITS.size_fall), np.float32)
        length = np.asarray(length * _decrease(detail, STYLE_LIMITS.length_fall), np.float32)
        threshold = np.asarray(threshold * _decrease(detail, STYLE_LIMITS.threshold_fall), np.float32)
        jitter = np.asarray(jitter * (1 - np.float32(STYLE_LIMITS.jitter_fall) * detail), np.float32)
        layers = np.asarray(layers + np.float32(STYLE_LIMITS.extra_layers) * detail, np.float32)
    opacity, relief = values["opacity"], values["relief"]
    face = None if detail is None else face_weight(detail)
    if face is not None:
        length, jitter, relief = (
            np.asarray(value * (1 - np.float32(fall) * face), np.float32)
            for value, fall in (
                (length, STYLE_LIMITS.face_length_fall),
                (jitter, STYLE_LIMITS.face_jitter_fall),
                (relief, STYLE_LIMITS.face_relief_fall),
            )
        )
        opacity = np.asarray(opacity + np.float32(STYLE_LIMITS.face_opacity) * face * (1 - opacity), np.float32)
    brush = Brush(
        size_px=np.maximum(np.multiply(size, px), np.float32(STYLE_LIMITS.smallest_px)),
        length_px=np.multiply(length, px),
        opacity=opacity, hue_deg=values["hue"], saturation=values["saturation"], value=values["value"],
        jitter=jitter, relief_px=np.multiply(relief, px), grain=values["grain"],
    )  # fmt: skip
    return LayerStyle(brush, layers, threshold, values, widest_px)


def face_weight(detail: Plane) -> Plane | None:
    """Weight 0..1 by which a pixel belongs to a face, float32 (h, w), from the detail map; None = no face."""
    if detail.max(initial=0) <= STYLE_LIMITS.face_detail:
        return None
    return np.asarray(
        np.maximum(detail - np.float32(STYLE_LIMITS.face_detail), 0) * np.float32(1 / (1 - STYLE_LIMITS.face_detail)),
        np.float32,
    )


def _decrease(detail: Plane, coefficients: tuple[float, float]) -> Plane:
    linear, square = (np.float32(value) for value in coefficients)
    return np.asarray(1 - linear * detail - square * detail * detail, np.float32)


def profile_fields(technique: Values) -> Values:
    """Those of `PROFILE_FIELDS` that must be read at each stroke: all or none."""
    names = PROFILE_FIELDS if any(not isinstance(technique[name], float) for name in PROFILE_FIELDS) else ()
    return {name: technique[name] for name in names}


def profile_columns(technique: Values, own: Mapping[str, NDArray[np.float32]]) -> NDArray[np.float32]:
    """Profile of each stroke, float32 (n, 5), from the values at its seed; (1, 5) where all have the same."""
    varying = profile_fields(technique)
    columns = [own[name] if varying else np.array([technique[name]]) for name in PROFILE_FIELDS]
    return np.stack(columns, axis=1).astype(np.float32)


def pigment(
    colours: NDArray[np.float32], vivid: float | NDArray[np.float32], contrast: float | NDArray[np.float32]
) -> NDArray[np.float32]:
    """Paint colours for picture colours (n, 3), RGB 0..255; `vivid` and `contrast` are numbers or float32 (n,).

    The luma is added up in a fixed order: a matrix product depends on the processor in its last bit.
    """
    out = np.empty(colours.shape, np.float32)
    chroma, lightness = (np.atleast_1d(np.asarray(value, np.float32)) for value in (vivid, contrast))
    _pigment(np.ascontiguousarray(colours, np.float32), chroma, lightness, out)
    return out


@kernel
def _pigment(
    colours: NDArray[np.float32], vivid: NDArray[np.float32], contrast: NDArray[np.float32], out: NDArray[np.float32]
) -> None:
    """`vivid` and `contrast`: float32 (1,) or (n,)."""
    middle, zero, most = np.float32(128), np.float32(0), np.float32(255)
    last_vivid, last_contrast = len(vivid) - 1, len(contrast) - 1
    for k in range(len(colours)):
        gray = colours[k, 0] * _RED + (colours[k, 1] * _GREEN + colours[k, 2] * _BLUE)
        chroma, lightness = vivid[min(k, last_vivid)], contrast[min(k, last_contrast)]
        for c in range(3):
            strong = gray + chroma * (colours[k, c] - gray)
            out[k, c] = min(max(middle + lightness * (strong - middle), zero), most)
