"""Edge field: orientation along the picture's edges, smoothed over space and time (kagaya2011video, section 5.1)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadParameter
from pipeline.frames import Flow
from pipeline.perception.flow.warp import warp_back
from pipeline.tensors.field import OrientationField
from pipeline.tensors.structure import Tensors

FAINT = 2.0
"""Gradient, gray levels/px, at which an edge has half of the maximum weight."""


def gradient_tensor(picture: NDArray[np.float32], sigma_px: float) -> Tensors:
    """Structure tensor of Sobel's gradient: float32 (3, h, w), planes xx, xy, yy, (gray levels/px)^2.

    Args:
        picture: float32 (h, w), or (h, w, channels), gray levels; of the channels' tensors, the mean is taken.
        sigma_px: sigma of the Gaussian blur, > 0.

    Source: dizenzo1986gradient (tensor of several channels). Departure from kagaya2011video, which takes the lightness:
    between colours of equal lightness, such as red and brown, strokes would run across the edge.
    """
    dx = cv2.Sobel(picture, cv2.CV_32F, 1, 0, scale=1 / 8, borderType=cv2.BORDER_REPLICATE)
    dy = cv2.Sobel(picture, cv2.CV_32F, 0, 1, scale=1 / 8, borderType=cv2.BORDER_REPLICATE)
    products = (plane if plane.ndim == 2 else plane.mean(axis=2) for plane in (dx * dx, dx * dy, dy * dy))
    return np.stack([cv2.GaussianBlur(plane, (0, 0), sigma_px) for plane in products])


def smooth_over_time(now: Tensors, before: Tensors, flow: Flow | None, memory: float, faint: float = FAINT) -> Tensors:
    """Smooth tensors over time: exponential mean along the motion, over 1 / (1 - memory) frames.

    The past counts less where edges have gone: the border of an object has a hundred times the energy of the surface
    that it uncovers, and would determine the directions there for thirty frames.

    Args:
        now: float32 (planes, h, w), tensors of this frame.
        before: same shape, the result for the previous frame.
        flow: float32 (h, w, 2), px, from this frame to the previous one; None = nothing moves.
        memory: in [0, 1); 0 uses this frame only.
        faint: gray levels/px, > 0, see `edge_field`: fainter edges count as none.

    Raises:
        BadParameter: `memory` is out of its range.
    """
    if not 0 <= memory < 1:
        raise BadParameter(
            "The memory must be at least 0 and less than 1.", field="memory", value=memory, remedy="Use 0.8."
        )
    advected = before if flow is None else np.stack([warp_back(plane, flow) for plane in before])
    energy, past = (tensors[0] + tensors[2] + np.float32(faint * faint) for tensors in (now, advected))
    share = np.float32(memory) * np.minimum(energy / past, 1)
    return np.asarray(now + share * (advected - now), np.float32)


def edge_field(tensors: Tensors, faint: float = FAINT) -> OrientationField:
    """Orientation along the edges: float32 (2, h, w), strength in [0, 1).

    The strength is near 1 at a clear straight edge and near 0 in flat or isotropic places.

    Args:
        tensors: float32 (3, h, w), from `gradient_tensor` or `smooth_over_time`.
        faint: gray levels/px, > 0.

    Departure: the paper leaves the tensor's length open. Here it is dimensionless, so that it can be weighed against
    design elements of strength 1.
    """
    xx, xy, yy = tensors
    scale = 1 / (xx + yy + np.float32(faint * faint))
    return np.stack([(yy - xx) * scale, np.float32(-2) * xy * scale])
