"""How cut-outs are coloured: plain paints, and ways to make one livelier."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.scenes.base import Paint, Spot
from pipeline.scenes.grain import grain
from pipeline.scenes.outlines import Outline
from pipeline.scenes.pose import Array


def rgb(code: str) -> Array:
    """ "#rrggbb" as three numbers 0..1."""
    return np.array([int(code[i : i + 2], 16) / 255 for i in (1, 3, 5)])


def ramp(value: Array, low: float, high: float) -> Array:
    """0 below `low`, 1 above `high`, smooth between."""
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return t * t * (3 - 2 * t)


def mix(first: Array, second: Array, share: Array) -> Array:
    """Colours between two, by a share for every spot."""
    return first + (second - first) * share[..., None]


def flat(code: str) -> Paint:
    colour = rgb(code)
    return lambda spot: np.broadcast_to(colour, (*spot.x.shape, 3))


def blend(first: str, second: str, share: Callable[[Spot], Array]) -> Paint:
    """Between two colours."""
    a, b = rgb(first), rgb(second)
    return lambda spot: mix(a, b, share(spot))


def vertical(top: str, bottom: str, start: float, stop: float) -> Paint:
    """From one colour at y = start to another at y = stop."""
    return blend(top, bottom, lambda s: ramp(s.y, start, stop))


def grainy(paint: Paint, amount: float, period: float, seed: int, stretch: float = 1.0) -> Paint:
    """Lighter and darker by noise.

    Args:
        amount: of change, 0..1.
        period: of the noise, in the cut-out's units.
        stretch: how much longer its features are along x than along y.
    """

    def painted(spot: Spot) -> Array:
        noise = grain(spot.x / stretch, spot.y, period, spot.pixel, seed)
        return np.asarray(paint(spot) * (1 + amount * noise[..., None]))

    return painted


def shaded(paint: Paint, side: tuple[float, float], amount: float, size: float) -> Paint:
    """Lighter towards `side` (a direction) over `size` units about the origin: soft light from there."""

    def painted(spot: Spot) -> Array:
        towards = (spot.x * side[0] + spot.y * side[1]) / size
        return np.asarray(paint(spot) * (1 + amount * np.tanh(towards)[..., None]))

    return painted


def rimmed(paint: Paint, code: str, width: float, strength: float) -> Paint:
    """Another colour along the outline, over `width` units inwards."""
    colour = rgb(code)
    return lambda spot: mix(paint(spot), colour, strength * (1 - ramp(spot.depth, 0.0, width)))


def stamped(paint: Paint, code: str, shape: Outline) -> Paint:
    """A shape painted on: part of the texture, with a soft edge of a pixel."""
    colour = rgb(code)
    return lambda spot: mix(paint(spot), colour, np.clip(0.5 - shape(spot.x, spot.y) / spot.pixel, 0.0, 1.0))
