"""Compositing of pictures with opacity, mattes and blend modes, on stored sRGB values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray

Blend = Literal[
    "over", "multiply", "screen", "overlay", "darken", "lighten", "color-dodge", "color-burn", "hard-light",
    "soft-light", "difference", "exclusion", "hue", "saturation", "color", "luminosity", "add",
]  # fmt: skip
Colours = NDArray[np.float32]
_LUMINOSITY = np.array([0.3, 0.59, 0.11], np.float32)


def lay_over(
    below: AnyArray, above: AnyArray, opacity: float = 1.0, blend: Blend = "over",
    matte: NDArray[np.uint8] | None = None,
) -> AnyArray:  # fmt: skip
    """A picture laid over another, (height, width, 3) in the type of `below`: uint8, rounded to nearest, or float32
    with white at 255.

    Args:
        opacity: 0..1.
        blend: "over" shows `above`; "add" sums the values, up to 255; the others are those of W3C Compositing and
            Blending Level 1, as browsers and Photoshop have them.
        matte: uint8 (height, width): 255 where `above` is, 0 where it is not; None: it is everywhere.

    Returns:
        below + opacity * matte / 255 * (blended - below), where `blended` is the blend of both (Porter and Duff 1984).
    """
    a, b, full = above.astype(np.float32), below.astype(np.float32), np.float32(255)
    blended = _blended(a, b, full, blend)
    share: np.float32 | NDArray[np.float32] = np.float32(opacity)
    if matte is not None:
        share = share * (matte.astype(np.float32) / full)[..., None]
    mixed = np.asarray(b + share * (blended - b), np.float32)
    return mixed if below.dtype == np.float32 else np.asarray(np.rint(mixed).clip(0, 255), np.uint8)


def covers(opacity: float, blend: Blend, matted: bool) -> bool:
    """Whether a layer hides everything below it."""
    return opacity >= 1 and blend == "over" and not matted


def _blended(a: Colours, b: Colours, full: np.float32, blend: Blend) -> Colours:
    """The blend of the colour `a` above and `b` below, 0..`full`."""
    if blend == "over":
        return a
    if blend == "multiply":
        return np.asarray(a * b / full, np.float32)
    if blend == "screen":
        return np.asarray(full - (full - a) * (full - b) / full, np.float32)
    if blend == "add":
        return np.asarray(np.minimum(a + b, full), np.float32)
    return np.asarray(full * _MODES[blend](a / full, b / full), np.float32)


def _hard_light(a: Colours, b: Colours) -> Colours:
    screen = 2 * a - 1 + b - (2 * a - 1) * b
    return np.where(a <= 0.5, 2 * a * b, screen)


def _soft_light(a: Colours, b: Colours) -> Colours:
    curve = np.where(b <= 0.25, ((16 * b - 12) * b + 4) * b, np.sqrt(np.maximum(b, 0)))
    return np.where(a <= 0.5, b - (1 - 2 * a) * b * (1 - b), b + (2 * a - 1) * (curve - b))


def _color_dodge(a: Colours, b: Colours) -> Colours:
    brighter = np.minimum(1, b / np.where(a < 1, 1 - a, 1))
    return np.where(b <= 0, 0, np.where(a >= 1, 1, brighter)).astype(np.float32)


def _color_burn(a: Colours, b: Colours) -> Colours:
    darker = 1 - np.minimum(1, (1 - b) / np.where(a > 0, a, 1))
    return np.where(b >= 1, 1, np.where(a <= 0, 0, darker)).astype(np.float32)


def _luminosity(colour: Colours) -> Colours:
    return np.asarray((colour @ _LUMINOSITY)[..., None], np.float32)


def _with_luminosity(colour: Colours, of: Colours) -> Colours:
    """The colour with the luminosity of another one, its saturation reduced where it would leave 0..1."""
    goal = _luminosity(of)
    moved = colour + (goal - _luminosity(colour))
    low, high = moved.min(-1, keepdims=True), moved.max(-1, keepdims=True)
    below, above = np.maximum(goal - low, 1e-6), np.maximum(high - goal, 1e-6)
    moved = np.where(low < 0, goal + (moved - goal) * goal / below, moved)
    return np.where(high > 1, goal + (moved - goal) * (1 - goal) / above, moved).astype(np.float32)


def _saturation(colour: Colours) -> Colours:
    return np.asarray(colour.max(-1, keepdims=True) - colour.min(-1, keepdims=True), np.float32)


def _with_saturation(colour: Colours, of: Colours) -> Colours:
    """The colour with the saturation of another one; its smallest channel is 0."""
    span = _saturation(colour)
    scaled = (colour - colour.min(-1, keepdims=True)) * _saturation(of) / np.where(span > 0, span, 1)
    return np.where(span > 0, scaled, 0).astype(np.float32)


_MODES: Mapping[str, Callable[[Colours, Colours], Colours]] = {
    "overlay": lambda a, b: _hard_light(b, a),
    "darken": np.minimum,
    "lighten": np.maximum,
    "color-dodge": _color_dodge,
    "color-burn": _color_burn,
    "hard-light": _hard_light,
    "soft-light": _soft_light,
    "difference": lambda a, b: np.abs(a - b),
    "exclusion": lambda a, b: a + b - 2 * a * b,
    "hue": lambda a, b: _with_luminosity(_with_saturation(a, b), b),
    "saturation": lambda a, b: _with_luminosity(_with_saturation(b, a), b),
    "color": lambda a, b: _with_luminosity(a, b),
    "luminosity": lambda a, b: _with_luminosity(b, a),
}
