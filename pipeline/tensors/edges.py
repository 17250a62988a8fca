"""The direction of the picture itself: along its edges, smoothed over space and over time (kagaya2011video, 5.1)."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.errors import BadParameter
from pipeline.flow.warp import fetch
from pipeline.frames import Flow, Plane
from pipeline.tensors.field import Field
from pipeline.tensors.structure import Tensors

FAINT = 2.0
"""Gradient, gray levels/px, at which an edge has half the weight it could have."""


def gradient_tensor(gray: Plane, sigma_px: float) -> Tensors:
    """Outer product of Sobel's gradient with itself, smoothed: float32 (3, h, w), xx, xy, yy, (gray levels/px)^2.

    Args:
        gray: float32 (h, w), gray levels.
        sigma_px: of the Gaussian, > 0.
    """
    dx = cv2.Sobel(gray, cv2.CV_32F, 1, 0, scale=1 / 8, borderType=cv2.BORDER_REPLICATE)
    dy = cv2.Sobel(gray, cv2.CV_32F, 0, 1, scale=1 / 8, borderType=cv2.BORDER_REPLICATE)
    return np.stack([cv2.GaussianBlur(plane, (0, 0), sigma_px) for plane in (dx * dx, dx * dy, dy * dy)])


def remember(now: Tensors, before: Tensors, flow: Flow | None, trust: Plane | None, memory: float) -> Tensors:
    """Smooth over time: this frame's tensors, and what was remembered of the frames before, carried along the motion.

    Fed back as the next `before`, it is an exponential mean over 1 / (1 - memory) frames.

    Args:
        now: float32 (planes, h, w), of this frame.
        before: of the same shape, what this returned for the frame before.
        flow: float32 (h, w, 2), px, from this frame back to the one before; None = nothing moves.
        trust: float32 (h, w) in 0..1, how far to believe the flow; None = fully. What came into view has none.
        memory: in [0, 1); 0 forgets.

    Raises:
        BadParameter: `memory` is out of its range.
    """
    if not 0 <= memory < 1:
        raise BadParameter("It is at least 0 and less than 1.", field="memory", value=memory, remedy="Use 0.8.")
    carried = before if flow is None else np.stack([fetch(plane, flow) for plane in before])
    share = np.float32(memory) if trust is None else np.float32(memory) * trust
    return np.asarray(now + share * (carried - now), np.float32)


def edge_field(tensors: Tensors, faint: float = FAINT) -> Field:
    """Strokes along the edges: float32 (2, h, w), its strength in [0, 1).

    The strength is near 1 at a clear straight edge, near 0 where the picture is flat or runs in no direction.

    Args:
        tensors: float32 (3, h, w), from `gradient_tensor`, perhaps remembered.
        faint: gray levels/px, > 0.

    Departure: the paper leaves the tensor's length open. Here it is without unit, so that it can be weighed against
    design elements of strength 1.
    """
    xx, xy, yy = tensors
    scale = 1 / (xx + yy + np.float32(faint * faint))
    return np.stack([(yy - xx) * scale, np.float32(-2) * xy * scale])
