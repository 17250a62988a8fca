"""Displacement and visibility between neighbouring frames, from optical flow or given velocities."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.frames import Flow, Plane
from pipeline.kernels.jit import kernel
from pipeline.perception.flow.gray import Gray
from pipeline.perception.flow.reliability import chi_minus, chi_plus, looks_alike
from pipeline.synthesis.images import Bytes, halved


@dataclass(frozen=True)
class Motion:
    """Motion from a frame to the next or the previous frame.

    Attributes:
        displacement: float32 (h, w, 2), from each pixel to its position in the other frame, px.
        visible: uint8 (h, w), chi of benard2013stylizing: 1 = visible in the other frame, 0 = occluded.
    """

    displacement: Flow
    visible: Bytes


MAX_VISIBLE_DIFFERENCE = 10.0
"""Mean difference over 5x5 px up to which a pixel counts as visible in the other frame of the flow, gray levels."""


def motions_between(
    velocity_plus: Flow, velocity_minus: Flow, epsilon_px2: float, pictures: tuple[Gray, Gray] | None = None
) -> tuple[Motion, Motion]:
    """The motions between two frames: from the first to the second, and back.

    Departure from the paper: where velocities were estimated, a pixel is also visible if it looks alike in the other
    frame. Optical flow is arbitrary where a picture has no texture, so that both directions disagree there: by chi
    alone, a fifth of a panned street was hidden, and its strokes were chosen anew in each frame.

    Args:
        velocity_plus: V+ of the first frame: a point at p goes to p + V+(p).
        velocity_minus: V- of the second frame: a point at p came from p - V-(p).
        epsilon_px2: tolerance of chi, px^2; math.inf = every pixel counts as visible.
        pictures: both frames, uint8 (h, w), if the velocities are estimated; None = they are exact.
    """
    forth = chi_plus(velocity_plus, velocity_minus, epsilon_px2)
    back = chi_minus(velocity_minus, velocity_plus, epsilon_px2)
    if pictures is not None:
        first, second = pictures
        forth |= looks_alike(first, second, velocity_plus, MAX_VISIBLE_DIFFERENCE)
        back |= looks_alike(second, first, -velocity_minus, MAX_VISIBLE_DIFFERENCE)
    return Motion(velocity_plus, forth.astype(np.uint8)), Motion(-velocity_minus, back.astype(np.uint8))


STILL_PX = 0.1
"""Speed below which a velocity is set to 0, px per frame."""
SLOW_PX = 0.5
"""Speed below which a velocity is set to 0 where the images do not differ, px per frame."""
MAX_STILL_DIFFERENCE = 2.0
"""Mean difference over 5x5 px up to which the images do not differ, gray levels."""


def zero_still_velocity(velocity: Flow, first: Bytes, second: Bytes) -> Flow:
    """Set estimated velocities to exactly 0 in static regions.

    Args:
        velocity: estimated velocity, px, float32 (h, w, 2).
        first, second: gray images of both frames, uint8 (h, w).

    Departure from the paper: optical flow is a few hundredths of a pixel in static regions, which would make advected
    strokes jitter by a pixel. Velocities below `STILL_PX` are set to 0, and velocities below `SLOW_PX` if the images
    do not differ there. Untextured parts of faster objects keep their velocity.
    """
    difference = np.asarray(cv2.boxFilter(cv2.absdiff(first, second), cv2.CV_32F, (5, 5)), np.float32)
    out = np.empty(velocity.shape, np.float32)
    _zero_still(np.ascontiguousarray(velocity), difference, out)
    return out


_STILL_PX2, _SLOW_PX2 = np.float32(STILL_PX**2), np.float32(SLOW_PX**2)


@kernel
def _zero_still(velocity: Flow, difference: Plane, out: Flow) -> None:
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            vx, vy = velocity[y, x, 0], velocity[y, x, 1]
            square = vx * vx + vy * vy
            still = square < _STILL_PX2 or (square < _SLOW_PX2 and difference[y, x] <= MAX_STILL_DIFFERENCE)
            out[y, x, 0] = np.float32(0) if still else vx
            out[y, x, 1] = np.float32(0) if still else vy


def downscaled_velocity(velocity: Flow, levels: int) -> Flow:
    """Downscale a velocity field by `levels` pyramid levels; each level halves the size and the speed.

    Takes the top left pixel of each 2x2 block, because the mean over two objects is the velocity of neither.
    """
    for _ in range(levels):
        velocity = np.asarray(halved(velocity, nearest=True), np.float32) / np.float32(2)
    return np.ascontiguousarray(velocity)
