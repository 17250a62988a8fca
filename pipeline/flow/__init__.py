"""Optical flow: how far each pixel of one frame has moved in the next."""

from __future__ import annotations

from typing import Literal, get_args

from pipeline.errors import BadParameter
from pipeline.flow.dis import dis
from pipeline.flow.gray import gray_pair
from pipeline.frames import Flow

FlowMethod = Literal["dis-ultrafast", "dis-fast", "dis-medium"]
"""Fastest first."""


def estimate(previous: object, current: object, method: FlowMethod = "dis-fast") -> Flow:
    """Flow from `previous` to `current`: previous(x) matches current(x + flow(x)).

    Args:
        previous, current: uint8, RGB (height, width, 3) or gray (height, width), one size, at least 16 px a side.
        method: which solver, see `FlowMethod`.

    Returns:
        float32 (height, width, 2): (dx, dy) in px.

    Raises:
        BadFrame: a picture is not one, or the sizes differ.
        BadParameter: there is no such method.
    """
    first, second = gray_pair(previous, current)
    match method:
        case "dis-ultrafast":
            return dis(first, second, "ultrafast")
        case "dis-fast":
            return dis(first, second, "fast")
        case "dis-medium":
            return dis(first, second, "medium")
    raise BadParameter(
        "There is no such flow method.",
        field="flow",
        value=method,
        remedy=f"Use one of: {', '.join(get_args(FlowMethod))}.",
    )
