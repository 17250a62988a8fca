"""Dense inverse search: OpenCV's implementation of kroeger2016dis, the fast default.

The result depends only on the two pictures and the preset. OpenCV 4.x cuts the picture into a fixed number of stripes,
so its thread count changes the time and not one bit; and a solver is made anew for every pair, since a used one has
adapted its scales to the pictures it has seen and may answer differently (by 0.01 px on small frames). That costs a
few per cent, and lets threads call it freely. On thin pictures OpenCV's own choice of scales reads beyond its buffers
(4.14 crashes at 131x17), so the finest scale is chosen here. Tests pin all three.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import cv2
import numpy as np

from pipeline.flow.gray import Gray
from pipeline.frames import Flow

Preset = Literal["ultrafast", "fast", "medium"]

PRESETS: dict[Preset, int] = {
    "ultrafast": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    "fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
}


def dis(previous: Gray, current: Gray, preset: Preset = "fast") -> Flow:
    """Flow from `previous` to `current`: previous(x) matches current(x + flow(x)).

    Args:
        previous, current: uint8 (height, width), one size, at least 16 px on each side.
        preset: ultrafast and fast stop at a quarter of the resolution, ultrafast without variational refinement;
            medium stops at half the resolution and compares more patches.

    Returns:
        float32 (height, width, 2): (dx, dy) in px.

    Source: kroeger2016dis.
    """
    solver: Any = cv2.DISOpticalFlow.create(PRESETS[preset])  # Any: the stubs know no `calc` without a first guess
    solver.setFinestScale(min(solver.getFinestScale(), _coarsest_scale(previous.shape, solver.getPatchSize())))
    return np.ascontiguousarray(solver.calc(previous, current, None), dtype=np.float32)


def _coarsest_scale(shape: tuple[int, ...], patch_px: int) -> int:
    """Where OpenCV starts: motion of a quarter of the longer side is within a patch, and a patch fits the shorter."""
    by_motion = math.log2(max(shape) / (4 * patch_px)) + 0.5
    return max(0, int(min(by_motion, math.log2(min(shape) // patch_px))))
