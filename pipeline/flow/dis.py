"""Dense inverse search: OpenCV's implementation of kroeger2016dis, the fast default.

The result depends only on the two pictures and the preset: OpenCV 4.x cuts the picture into a fixed number of
stripes, so its thread count changes the time and not one bit (a test pins it).
"""

from __future__ import annotations

import threading
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

_own = threading.local()


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
    flow: Flow = _solver(preset).calc(previous, current, None)
    return np.ascontiguousarray(flow, dtype=np.float32)


def _solver(preset: Preset) -> Any:
    """This thread's solver: it keeps its pyramids between calls, so two threads may not share one.

    Any, since OpenCV's stubs know no `calc` without a first guess of the flow.
    """
    solvers: dict[Preset, Any] = _own.__dict__.setdefault("solvers", {})
    if preset not in solvers:
        solvers[preset] = cv2.DISOpticalFlow.create(PRESETS[preset])
    return solvers[preset]
