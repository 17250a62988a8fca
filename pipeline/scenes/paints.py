"""Paints (colour functions) of cut-outs, and modifiers that add texture, shading and rims."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.scenes.base import Paint, Spot
from pipeline.scenes.grain import grain
from pipeline.scenes.outlines import Outline
from pipeline.scenes.pose import Array


def rgb(code: str) -> Array:
    """Convert "#rrggbb" to float64 (3,), 0..1."""
    return np.array([int(code[i : i + 2], 16) / 255 for i in (1, 3, 5)])


def ramp(value: Array, low: float, high: float) -> Array:
    """Smoothstep: 0 below `low`, 1 above `high`."""
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return t * t * (3 - 2 * t)


def mix(first: Array, second: Array, share: Array) -> Array:
    """Interpolate between two colours; `share` is the weight of the second at each spot, 0..1."""
    return first + (second - first) * share[..., None]


def flat(code: str) -> Paint:
    colour = rgb(code)
    return lambda spot: np.broadcast_to(colour, (*spot.x.shape, 3))


def blend(first: str, second: str, share: Callable[[Spot], Array]) -> Paint:
    """Blend two colours; `share` returns the weight of the second, 0..1."""
    a, b = rgb(first), rgb(second)
    return lambda spot: mix(a, b, share(spot))


def vertical(top: str, bottom: str, start: float, stop: float) -> Paint:
    """Vertical gradient from `top` at y = start to `bottom` at y = stop."""
    return blend(top, bottom, lambda s: ramp(s.y, start, stop))


def grainy(paint: Paint, amount: float, period: float, seed: int, stretch: float = 1.0) -> Paint:
    """Modulate the lightness of a paint by noise.

    Args:
        amount: relative amplitude, 0..1.
        period: period of the noise, in the cut-out's units.
        stretch: ratio of the size of features along x to that along y.
    """

    def painted(spot: Spot) -> Array:
        noise = grain(spot.x / stretch, spot.y, period, spot.pixel, seed)
        return np.asarray(paint(spot) * (1 + amount * noise[..., None]))

    return painted


def shaded(paint: Paint, side: tuple[float, float], amount: float, size: float) -> Paint:
    """Soft directional shading: lighter towards the direction `side`, over `size` units around the origin."""

    def painted(spot: Spot) -> Array:
        towards = (spot.x * side[0] + spot.y * side[1]) / size
        return np.asarray(paint(spot) * (1 + amount * np.tanh(towards)[..., None]))

    return painted


def rimmed(paint: Paint, code: str, width: float, strength: float) -> Paint:
    """Blend in another colour along the outline, up to `width` units inwards."""
    colour = rgb(code)
    return lambda spot: mix(paint(spot), colour, strength * (1 - ramp(spot.depth, 0.0, width)))


def stamped(paint: Paint, code: str, shape: Outline) -> Paint:
    """Paint a shape on the texture, anti-aliased over one pixel."""
    colour = rgb(code)
    return lambda spot: mix(paint(spot), colour, np.clip(0.5 - shape(spot.x, spot.y) / spot.pixel, 0.0, 1.0))
