"""Reliability of a flow: forward-backward consistency, occlusion, motion boundaries, colour residual."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.frames import Flow, Mask, Plane
from pipeline.kernels.jit import kernel
from pipeline.perception.flow.gray import Gray
from pipeline.perception.flow.warp import positions, warp_back

CHI_EPSILON_PX2 = 2.0
"""Largest squared difference of consistent velocities, px^2, for `chi_minus` and `chi_plus`."""


def visible(flow: Flow, back: Flow) -> Mask:
    """True where a pixel of this frame is visible in the other one: the flows are consistent, and it stays in the
    picture.

    The tolerance increases with the motion: |f + b|^2 <= 0.01 (|f|^2 + |b|^2) + 0.5 (sundaram2010dense, eq. 5).
    """
    there = warp_back(back, flow)
    squares = np.square(flow).sum(-1) + np.square(there).sum(-1)
    closes: Mask = np.square(flow + there).sum(-1) <= 0.01 * squares + 0.5
    return closes & inside(flow)


def inside(flow: Flow) -> Mask:
    """True where the flow points to a position inside the picture."""
    height, width = flow.shape[:2]
    x, y = positions(flow)
    within: Mask = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    return within


def looks_alike(here: Gray, there: Gray, flow: Flow, difference: float) -> Mask:
    """True where a pixel of this frame looks like the place in the other frame to which the flow leads.

    Args:
        here, there: both frames, uint8 (height, width).
        flow: from this frame to the other one, px.
        difference: largest mean absolute difference over 5x5 px, gray levels.
    """
    apart = cv2.absdiff(here, np.asarray(warp_back(there, flow), np.uint8))
    mean = np.asarray(cv2.boxFilter(apart, cv2.CV_32F, (5, 5)), np.float32)
    alike: Mask = mean <= difference
    return alike & inside(flow)


def motion_boundary(flow: Flow) -> Mask:
    """True where the flow is discontinuous and therefore uncertain: |grad f|^2 > 0.01 |f|^2 + 0.002.

    Source: sundaram2010dense, eq. 6.
    """
    gradients = [np.square(g) for plane in cv2.split(flow) for g in np.gradient(plane)]
    edge: Mask = np.sum(gradients, axis=0) > 0.01 * np.square(flow).sum(-1) + 0.002
    return edge


def chi_minus(velocity_minus: Flow, velocity_plus_before: Flow, epsilon_px2: float = CHI_EPSILON_PX2) -> Mask:
    """True where a pixel of frame t was not occluded at t - 1.

    Args:
        velocity_minus: V-(t): the pixel p was at p - V-(p). float32 (height, width, 2), px.
        velocity_plus_before: V+(t - 1).
        epsilon_px2: largest squared difference.

    Source: benard2013stylizing, section 3.1. Departure: a pixel that came from outside the picture counts as occluded.
    """
    return _agree(velocity_plus_before, velocity_minus, -velocity_minus, epsilon_px2)


def chi_plus(velocity_plus: Flow, velocity_minus_after: Flow, epsilon_px2: float = CHI_EPSILON_PX2) -> Mask:
    """True where a pixel of frame t is not occluded at t + 1.

    Args:
        velocity_plus: V+(t): the pixel p moves to p + V+(p). float32 (height, width, 2), px.
        velocity_minus_after: V-(t + 1).
        epsilon_px2: largest squared difference.

    Source and departure: as `chi_minus`.
    """
    return _agree(velocity_minus_after, velocity_plus, velocity_plus, epsilon_px2)


def _agree(there: Flow, here: Flow, step: Flow, epsilon_px2: float) -> Mask:
    x, y = positions(step)
    fetched = np.asarray(cv2.remap(there, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)
    out = np.empty(x.shape, np.bool_)
    _agreeing(fetched, np.ascontiguousarray(here), (x, y), np.float32(epsilon_px2), out)
    return out


@kernel
def _agreeing(fetched: Flow, here: Flow, at: tuple[Plane, Plane], epsilon_px2: np.float32, out: Mask) -> None:
    """Whether velocities agree and the positions `at`, (x, y) px, are inside the picture; NumPy takes four times as
    long."""
    x, y = at
    height, width = out.shape
    for i in range(height):
        for j in range(width):
            dx, dy = fetched[i, j, 0] - here[i, j, 0], fetched[i, j, 1] - here[i, j, 1]
            within = 0 <= x[i, j] <= width - 1 and 0 <= y[i, j] <= height - 1
            out[i, j] = within and dx * dx + dy * dy < epsilon_px2
