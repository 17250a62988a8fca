"""The named styles, and what a style is: numbers that vary per pixel, and a manner alike for the whole picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from pipeline.strokes.emboss import Light
from pipeline.strokes.layers import Recipe
from pipeline.strokes.raster import Touch

StyleName = Literal["van-gogh", "impressionism", "expressionism", "pointillism", "colorist-wash", "watercolor"]
STYLE_NAMES: tuple[str, ...] = get_args(StyleName)


def _number(default: float, low: float, high: float, help_: str, unit: str) -> Any:
    return Field(default, ge=low, le=high, description=help_, json_schema_extra={"unit": unit})


class Style(BaseModel):
    """The style parameters of kagaya2011video, section 3, that may differ from pixel to pixel and from frame to frame.

    Lengths are in thousandths of the picture's height, so that a style looks alike at every size.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    size: float = _number(
        18, 2, 150, "Width of strokes, diameter of dots, in the coarsest layer.", "per mille of the height"
    )
    length: float = _number(90, 0, 600, "Length of strokes in the coarsest layer; 0 = dots.", "per mille of the height")
    opacity: float = _number(1, 0.02, 1, "Opacity of a stroke.", "ratio")
    hue: float = _number(0, -180, 180, "Shift of hue.", "degrees")
    saturation: float = _number(0, -1, 1, "Shift of saturation.", "ratio")
    value: float = _number(0, -1, 1, "Shift of brightness.", "ratio")
    jitter: float = _number(0.2, 0, 1, "How far the colours of single strokes stray.", "ratio")
    relief: float = _number(2, 0, 20, "Height of the texture in a stroke.", "per mille of the height")
    grain: float = _number(0.6, 0, 1, "Density of the texture in a stroke: the traces of the brush's hairs.", "ratio")
    layers: float = _number(3, 1, 4, "Number of layers, coarse to fine; may be fractional.", "layers")
    threshold: float = _number(20, 0, 442, "Error above which a finer layer paints.", "RGB distance")


FIELDS: tuple[str, ...] = tuple(Style.model_fields)
"""The names of the style parameters, in the order of a style's vector."""


def vector(style: Style) -> NDArray[np.float32]:
    """The style as float32 (len(FIELDS),)."""
    return np.array([getattr(style, name) for name in FIELDS], np.float32)


@dataclass(frozen=True)
class Manner:
    """What is alike for a whole picture.

    Attributes:
        recipe, touch, light: of layers, strokes and relief.
        ground: RGB of the ground; `cover` in 0..1 how much of it there is instead of the picture's own colours.
        vivid: factor on the chroma of the picture before it is painted.
        contrast: factor on lightness about the middle.
        mingle: gray levels by which the order of colours is blurred from stroke to stroke: 0 = the paper's total
            order, in which dark strokes always cover light ones.
        rim: 0..1, how much darker paint dries at the edge of a wet area.
        hold: factor on the parameter `hold`: broad, wet paint needs not follow every shade.
        paper: 0..1, how far the paper's grain shows in thin paint.
        linger: frames that paint lingers beyond the parameter `linger`, if that is not 0: wet paint is slow.
    """

    recipe: Recipe
    touch: Touch
    light: Light
    ground: tuple[int, int, int] = (235, 226, 205)
    cover: float = 0.0
    vivid: float = 1.0
    contrast: float = 1.0
    mingle: float = 60.0
    hold: float = 1.0
    rim: float = 0.0
    paper: float = 0.0
    linger: int = 0


@dataclass(frozen=True)
class Named:
    title: str
    about: str
    style: Style
    manner: Manner


STYLES: Mapping[str, Named] = MappingProxyType({
    "van-gogh": Named(
        "Van Gogh", "Thick, curving strokes that run along every form; strong colour.",
        Style(
            size=20, length=105, jitter=0.25, saturation=0.08, relief=3.4, grain=0.75, layers=3, threshold=20,
        ),
        Manner(
            Recipe(most=4, ratio=0.55, overlap=2.6, edge=85), Touch((0.2, 0.5), streaks=32, dry=0.35),
            Light(strength=0.31, gloss=0.08), vivid=1.25, contrast=1.06, mingle=110,
        ),
    ),
    "impressionism": Named(
        "Impressionism", "Short, broken dabs of light colour, laid wet into wet.",
        Style(
            size=21, length=42, jitter=0.42, value=0.03, relief=2.0, grain=0.5, layers=3, threshold=22,
        ),
        Manner(
            Recipe(most=4, ratio=0.58, overlap=2.6, edge=80), Touch((0.1, 0.3), streaks=24, dry=0.4),
            Light(strength=0.28, gloss=0.04, weave_px=0.12), vivid=1.2, mingle=170,
        ),
    ),
    "expressionism": Named(
        "Expressionism", "Long, bold, restless strokes in colours stronger than nature.",
        Style(
            size=27, length=190, jitter=0.5, saturation=0.22, relief=2.2, grain=0.75, layers=3, threshold=34,
        ),
        Manner(
            Recipe(most=4, ratio=0.5, overlap=2.4, edge=75), Touch((0.1, 0.7), streaks=36, dry=0.7),
            Light(strength=0.28, gloss=0.05), vivid=1.45, contrast=1.15, mingle=50,
        ),
    ),
    "pointillism": Named(
        "Pointillism", "Dots of pure colour that mix in the eye, on a light ground.",
        Style(
            size=17, length=0, jitter=0.5, saturation=0.1, value=0.02, relief=0.8, grain=0, layers=2, threshold=26,
        ),
        Manner(
            Recipe(most=4, ratio=0.6, overlap=1.5, edge=90, scatter=0.6), Touch((0, 0), streaks=0, dry=0, soft=0.4),
            Light(strength=0.22, gloss=0.0, weave_px=0.1), cover=0.24, vivid=1.3, mingle=220,
        ),
    ),
    "colorist-wash": Named(
        "Colorist wash", "Transparent washes over each other, in free, strong colours.",
        Style(
            size=38, length=130, opacity=0.5, jitter=0.7, saturation=0.15, relief=0.4, grain=0.5, layers=3,
            threshold=20,
        ),
        Manner(
            Recipe(most=4, ratio=0.5, overlap=4.0, edge=75), Touch((0.1, 0.4), streaks=18, dry=0.5),
            Light(strength=0.2, gloss=0, weave_px=0.12), cover=0.35, vivid=1.5, mingle=240, rim=0.15, paper=0.25,
        ),
    ),
    "watercolor": Named(
        "Watercolor", "Pale, wet areas with darker rims, on white paper with a grain.",
        Style(
            size=44, length=60, opacity=0.43, jitter=0.4, value=0.06, relief=0, grain=0, layers=3, threshold=16,
        ),
        Manner(
            Recipe(most=4, ratio=0.5, overlap=3.7, edge=60, scatter=1.0), Touch((0, 0), streaks=0, dry=0, soft=0.35),
            Light(strength=0, gloss=0), ground=(250, 248, 242), cover=0.4, vivid=1.3, mingle=300, hold=1.5,
            rim=0.4, paper=0.5, linger=2,
        ),
    ),
})  # fmt: skip


def pigment(aims: NDArray[np.float32], vivid: float, contrast: float) -> NDArray[np.float32]:
    """The manner's paint for colours (n, 3), RGB 0..255."""
    gray = (aims @ np.array([0.299, 0.587, 0.114], np.float32))[:, None]
    strong = gray + np.float32(vivid) * (aims - gray)
    return np.asarray(np.clip(np.float32(128) + np.float32(contrast) * (strong - np.float32(128)), 0, 255), np.float32)
