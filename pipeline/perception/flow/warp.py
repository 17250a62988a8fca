"""Backward warping along a flow."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.frames import Flow, Plane
from pipeline.kernels.jit import kernel


def positions(flow: Flow) -> tuple[Plane, Plane]:
    """End points x + flow(x) of the flow, as two planes (x, y), px."""
    height, width = flow.shape[:2]
    x = flow[..., 0] + np.arange(width, dtype=np.float32)
    y = flow[..., 1] + np.arange(height, dtype=np.float32)[:, None]
    return np.asarray(x, dtype=np.float32), np.asarray(y, dtype=np.float32)


def scale_flow(flow: Flow, across: float, down: float) -> Flow:
    """Vectors (dx, dy) multiplied by (`across`, `down`), as for pictures of another size; a new array."""
    scaled = np.empty(flow.shape, np.float32)
    _scale(np.ascontiguousarray(flow, np.float32).reshape(-1), np.float32(across), np.float32(down), scaled.reshape(-1))
    return scaled


@kernel
def _scale(flow: NDArray[np.float32], across: np.float32, down: np.float32, scaled: NDArray[np.float32]) -> None:
    for k in range(flow.size // 2):  # this vectorises
        scaled[2 * k], scaled[2 * k + 1] = flow[2 * k] * across, flow[2 * k + 1] * down


def warp_back(image: AnyArray, flow: Flow) -> AnyArray:
    """Backward warp: out(x) = image(x + flow(x)), bilinear; border pixels are replicated.

    With `flow = estimate(previous, current)` and `image = current`, the result equals `previous` at visible pixels.

    Args:
        image: uint8 or float32, (height, width) or (height, width, channels).
        flow: float32 (height, width, 2), px.
    """
    x, y = positions(flow)
    return np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
