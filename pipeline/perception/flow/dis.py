"""Dense inverse search (kroeger2016dis) in OpenCV's implementation: the fast default.

The flow depends on the two pictures and the preset only. OpenCV 4.x cuts a picture into a fixed number of stripes, so
that the number of threads changes no bit; and a new solver is created for each pair, because a used one keeps the
scales of earlier pictures.
"""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np

from pipeline.frames import Flow
from pipeline.perception.flow.gray import Gray

Preset = Literal["ultrafast", "fast", "sparse", "half", "medium"]


class DisParams(NamedTuple):
    """The finest scale, and the work at each scale.

    Attributes:
        finest_scale: 0 = the full size, 1 = half of the sides, ...
        stride_px: distance of patches, px of their scale.
        steps: maximum number of steps of gradient descent for a patch, half of them in each of two passes.
        refinements: outer iterations of the variational refinement; 0 = none.
    """

    finest_scale: int
    stride_px: int
    steps: int
    refinements: int


PRESETS: dict[Preset, DisParams] = {
    "ultrafast": DisParams(2, 4, 12, 0),
    "fast": DisParams(2, 4, 16, 5),
    "sparse": DisParams(1, 4, 8, 2),
    "half": DisParams(1, 3, 8, 2),
    "medium": DisParams(1, 3, 25, 5),
}
FINER_STRIDE_PX = 5
"""Distance of the patches of 8 px at a further scale, px: at 4 px, it would cost as much as twice the sides."""


def dis(previous: Gray, current: Gray, preset: Preset = "fast", finer: bool = False) -> Flow:
    """Flow from `previous` to `current`: previous(x) matches current(x + flow(x)).

    Args:
        previous, current: uint8 (height, width), one size, at least 16 px on each side.
        preset: ultrafast and fast stop at a quarter of the resolution, ultrafast without variational refinement;
            medium stops at half the resolution. half stops there too, with as many patches and fewer iterations: two
            thirds of medium's time, and warps nearly as accurate. sparse is half with 9/16 as many patches.
        finer: whether to stop one scale later, with patches at least `FINER_STRIDE_PX` apart.

    Returns:
        float32 (height, width, 2): (dx, dy) in px.

    Source: kroeger2016dis, with the parameters of OpenCV's presets.
    """
    params = PRESETS[preset]
    # The presets of OpenCV differ in these numbers only. Any: the stubs require an initial flow for `calc`.
    solver: Any = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    solver.setFinestScale(min(params.finest_scale - finer, _coarsest_scale(previous.shape, solver.getPatchSize())))
    solver.setPatchStride(max(params.stride_px, FINER_STRIDE_PX) if finer else params.stride_px)
    solver.setGradientDescentIterations(params.steps)
    solver.setVariationalRefinementIterations(params.refinements)
    return np.ascontiguousarray(solver.calc(previous, current, None), dtype=np.float32)


def _coarsest_scale(shape: tuple[int, ...], patch_px: int) -> int:
    """The coarsest scale: there, a quarter of the longer side fits a patch, and a patch fits the shorter side. OpenCV
    does not limit its finest scale to it, and reads beyond its buffers for thin pictures (131x17)."""
    by_motion = math.log2(max(shape) / (4 * patch_px)) + 0.5
    return max(0, int(min(by_motion, math.log2(min(shape) // patch_px))))
