"""Confidence in the motion of each pixel of the source."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Plane
from pipeline.kernels.buffers import Buffers
from pipeline.kernels.executors import INLINE, FrameExecutor
from pipeline.kernels.jit import kernel
from pipeline.perception.flow.dis import dis
from pipeline.perception.flow.gray import to_gray
from pipeline.perception.flow.warp import positions

BOUNDARY = 0.3
"""Exponent by which the confidence falls where the gradient of the flow reaches the limit of a motion boundary. It is
small, since the limit of slow motion lies within the noise of a flow's gradient."""
WINDOW_PX = 5
"""Side of the window over which colour differences are averaged. An inaccuracy of the flow at an edge adds differences
of both signs, which cancel; a trail has one sign."""
SINGLE = 1 / 3
"""Rate of the decay with the difference of a single pixel, relative to that with the mean over the window."""
ROUND_TRIP = 0.08
"""Exponent by which the confidence falls where the round trip is as long as its tolerance. It is small, since a fast
flow is off by a pixel or two in smooth areas, which does no harm."""

Picture: TypeAlias = NDArray[np.float32]
"""float32 (h, w, 3), RGB, 0..255."""


def motion(before: Frame, now: Frame, both_accurate: bool) -> tuple[Flow, Flow]:
    """Flows in px: an accurate one from `now` to `before`, and one from `before` to `now` to check it.

    Args:
        both_accurate: whether the second flow is accurate, too, instead of fast.
    """
    first, second = to_gray(before), to_gray(now)
    return dis(second, first, "half"), dis(first, second, "half" if both_accurate else "ultrafast")


@dataclass(frozen=True)
class TrustedMotion:
    """Motion from each pixel of a frame to another frame, and how far it can be trusted."""

    to: tuple[Plane, Plane]
    """x and y of the same point of the scene in the other frame, float32 (h, w), px."""
    trust: Plane
    """Confidence in that motion, float32 (h, w), 0..1."""


@dataclass(frozen=True)
class Evidence:
    """Data from which the confidence in the motion of a frame is computed; flows in px."""

    back: Flow
    """Flow from this frame to the previous one."""
    round_trip: Flow
    """The flow from the previous frame to this one, at the pixels that `back` leads to."""
    source: Frame
    """This frame."""
    warped: Frame
    """The previous frame, moved along `back`."""
    expected: Picture
    """The average of all past frames along the motion."""


def confidence(evidence: Evidence, alpha: float, buffers: Buffers, background: FrameExecutor = INLINE) -> Plane:
    """Confidence that a pixel shows the same point of the scene as the pixel that `back` leads to.

        exp(-alpha |mean of (source - expected) over 5 x 5 px|^2  -  SINGLE alpha |source - warped|^2
            -  ROUND_TRIP |b + f|^2 / tolerance  -  BOUNDARY |grad b|^2 / limit)

    The tolerance of the round trip is 0.01 (|b|^2 + |f|^2) + 0.5 px^2, the limit of a motion boundary
    0.01 |b|^2 + 0.002 (sundaram2010dense, eq. 5 and 6). Where `back` leads out of the picture, the confidence is 0.

    Args:
        alpha: rate of the decay, per squared RGB distance, RGB in 0..1.
        buffers: working memory.
        background: may take rows.

    Returns:
        float32 (h, w), 0..1.

    Source: bonneel2015blind, section 3: the second term. Departure: the first term finds trails, see `SteadyFilter`,
    the third and fourth term find occlusions where the colours are alike.
    """
    exponent = buffers.get("exponent", evidence.back.shape[:2])
    difference = buffers.get("difference", evidence.source.shape)
    mean = buffers.get("mean difference", evidence.source.shape)
    rate, height = np.float32(alpha / 255**2), len(exponent)
    source, warped, expected = evidence.source, evidence.warped, evidence.expected
    weights = np.float32(ROUND_TRIP), np.float32(BOUNDARY)

    def differ(first: int, last: int) -> None:
        rows = slice(first, last)
        _compare(evidence.back, evidence.round_trip, *weights, exponent, first, last)
        single = rate * np.float32(SINGLE)
        _differ(source[rows], warped[rows], expected[rows], single, exponent[rows], difference[rows])

    background.rows(differ, height)
    cv2.blur(difference, (WINDOW_PX, WINDOW_PX), dst=mean)
    background.rows(lambda first, last: _decay(mean[first:last], rate, exponent[first:last]), height)
    return np.asarray(cv2.exp(exponent), np.float32)


def onward_motion(
    before: Frame, now: Frame, flows: tuple[Flow, Flow], alpha: float, buffers: Buffers,
    background: FrameExecutor = INLINE,
) -> TrustedMotion:  # fmt: skip
    """Motion from a frame to the next one.

    Args:
        before, now: the two frames of the source.
        flows: accurate flows from `now` to `before` and from `before` to `now`.
        alpha, buffers, background: see `confidence`. There is no average of later frames: `before` is compared with the
            next frame itself.
    """
    back, forth = flows
    there = positions(forth)
    round_trip = cv2.remap(back, *there, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    warped = np.asarray(cv2.remap(now, *there, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)
    evidence = Evidence(forth, np.asarray(round_trip, np.float32), before, warped, warped.astype(np.float32))
    return TrustedMotion(there, confidence(evidence, alpha, buffers, background))


@kernel
def _compare(
    back: Any, forth: Any, round_trip: Any, boundary: Any, exponent: Any, first_row: int, end_row: int
) -> None:
    """Fill rows of `exponent` with the parts of the round trip and of the motion boundaries."""
    height, width = exponent.shape
    for y in range(first_row, end_row):
        for x in range(width):
            bx, by, fx, fy = back[y, x, 0], back[y, x, 1], forth[y, x, 0], forth[y, x, 1]
            tolerance = np.float32(0.01) * (bx * bx + by * by + fx * fx + fy * fy) + np.float32(0.5)
            away = (bx + fx) * (bx + fx) + (by + fy) * (by + fy)
            exponent[y, x] = -round_trip * away / tolerance
            left, right, up, down = max(x - 1, 0), min(x + 1, width - 1), max(y - 1, 0), min(y + 1, height - 1)
            gradient = np.float32(0)
            for c in range(2):
                across, along = back[y, right, c] - back[y, left, c], back[down, x, c] - back[up, x, c]
                gradient += np.float32(0.25) * (across * across + along * along)
            limit = np.float32(0.01) * (bx * bx + by * by) + np.float32(0.002)
            exponent[y, x] -= boundary * gradient / limit
            if x + bx < 0 or x + bx > width - 1 or y + by < 0 or y + by > height - 1:
                exponent[y, x] = -np.inf


@kernel
def _differ(source: Any, warped: Any, expected: Any, rate: Any, exponent: Any, difference: Any) -> None:
    """Subtract the single pixels' part from `exponent`; fill `difference` with source - expected."""
    height, width = exponent.shape
    for y in range(height):
        for x in range(width):
            total = np.float32(0)
            for c in range(3):
                value = np.float32(source[y, x, c])
                step = value - np.float32(warped[y, x, c])
                total += step * step
                difference[y, x, c] = value - expected[y, x, c]
            exponent[y, x] -= rate * total


@kernel
def _decay(mean: Any, rate: Any, exponent: Any) -> None:
    """Subtract the windows' part from `exponent`."""
    height, width = exponent.shape
    for y in range(height):
        for x in range(width):
            r, g, b = mean[y, x, 0], mean[y, x, 1], mean[y, x, 2]
            exponent[y, x] -= rate * (r * r + g * g + b * b)
