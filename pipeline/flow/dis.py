"""Dense inverse search (kroeger2016dis) in OpenCV's implementation: the fast default.

The result depends on the two pictures and the preset only:

- OpenCV 4.x divides the picture into a fixed number of stripes, so the number of threads does not change the result.
- A new solver is created for each pair, since a used one has adapted its scales to earlier pictures, which changes the
  result by up to 0.01 px on small frames. This costs a few per cent and makes the function thread-safe.
- The finest scale is set here, because OpenCV's own choice reads beyond its buffers for thin pictures (4.14 crashes at
  131x17).
"""

from __future__ import annotations

import math
from typing import Any, Literal

import cv2
import numpy as np

from pipeline.flow.gray import Gray
from pipeline.frames import Flow

Preset = Literal["ultrafast", "fast", "sparse", "half", "medium"]

PRESETS: dict[Preset, int] = {
    "ultrafast": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    "fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "sparse": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    "half": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    "medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
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

    Source: kroeger2016dis.
    """
    solver: Any = cv2.DISOpticalFlow.create(PRESETS[preset])  # Any: the stubs require an initial flow for `calc`
    if preset in ("half", "sparse"):
        solver.setFinestScale(1)
        solver.setPatchStride(3 if preset == "half" else 4)
        solver.setGradientDescentIterations(8)
        solver.setVariationalRefinementIterations(2)
    if finer:
        solver.setFinestScale(solver.getFinestScale() - 1)
        solver.setPatchStride(max(solver.getPatchStride(), FINER_STRIDE_PX))
    solver.setFinestScale(min(solver.getFinestScale(), _coarsest_scale(previous.shape, solver.getPatchSize())))
    return np.ascontiguousarray(solver.calc(previous, current, None), dtype=np.float32)


def _coarsest_scale(shape: tuple[int, ...], patch_px: int) -> int:
    """OpenCV's coarsest scale: there, a quarter of the longer side fits a patch, and a patch fits the shorter side."""
    by_motion = math.log2(max(shape) / (4 * patch_px)) + 0.5
    return max(0, int(min(by_motion, math.log2(min(shape) // patch_px))))
