"""Where regions are and how they are turned, frame by frame, as numbers small enough for a note."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np

from pipeline.methods.multistyle.carrier import Map
from pipeline.tensors.ellipses import Ellipse, fit_ellipse

Shape = tuple[float, float, float, float, float]
"""x, y, angle_rad, major_px, minor_px."""


def shapes(found: Map, numbers: Iterable[int]) -> dict[str, list[float]]:
    """The ellipse of each region of a map that is in it, by its number; angles in [0, pi)."""
    out: dict[str, list[float]] = {}
    for number in numbers:
        ellipse = fit_ellipse(np.asarray(found == number, np.bool_))
        if ellipse is not None:
            values = (ellipse.x, ellipse.y, ellipse.angle_rad, ellipse.major_px, ellipse.minor_px)
            out[str(number)] = [round(value, 4) for value in values]
    return out


def followed(frames: Mapping[int, Shape], round_limit: float = 0.95) -> dict[int, Ellipse]:
    """Ellipses of one region over a shot, each with the angle nearest to that of the frame before.

    A shape that is almost round keeps the angle it had.
    """
    out: dict[int, Ellipse] = {}
    before: Ellipse | None = None
    for frame in sorted(frames):
        x, y, angle, major, minor = frames[frame]
        if before is not None:
            turns = round((before.angle_rad - angle) / math.pi)
            angle = before.angle_rad if minor > round_limit * major else angle + math.pi * turns
        before = Ellipse(x, y, angle, major, minor)
        out[frame] = before
    return out
