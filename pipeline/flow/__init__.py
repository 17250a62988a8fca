"""Optical flow: how far each pixel of one frame has moved in the next."""

from __future__ import annotations

from typing import Literal, get_args

from pipeline.compute import Device
from pipeline.compute import device as default_device
from pipeline.errors import BadParameter
from pipeline.flow.dis import dis
from pipeline.flow.gray import gray_pair
from pipeline.flow.tvl1 import tvl1
from pipeline.flow.tvl1_params import DEFAULTS, TvL1
from pipeline.frames import Flow

FlowMethod = Literal["dis-ultrafast", "dis-fast", "dis-medium", "tvl1"]
"""Fastest first. `tvl1` runs on an OpenCL device."""


def estimate(
    previous: object,
    current: object,
    method: FlowMethod = "dis-fast",
    *,
    params: TvL1 = DEFAULTS,
    device: Device | None = None,
) -> Flow:
    """Flow from `previous` to `current`: previous(x) matches current(x + flow(x)).

    Args:
        previous, current: uint8, RGB (height, width, 3) or gray (height, width), one size, at least 16 px a side.
        method: which solver, see `FlowMethod`.
        params: of `tvl1`; DIS has its presets.
        device: where `tvl1` runs; None = this process's device, as `pipeline.compute.device()` chooses it.

    Returns:
        float32 (height, width, 2): (dx, dy) in px.

    Raises:
        BadFrame: a picture is not one, or the sizes differ.
        BadParameter: there is no such method.
        DeviceError: `tvl1` was asked for and no compute device works.
    """
    first, second = gray_pair(previous, current)
    match method:
        case "dis-ultrafast":
            return dis(first, second, "ultrafast")
        case "dis-fast":
            return dis(first, second, "fast")
        case "dis-medium":
            return dis(first, second, "medium")
        case "tvl1":
            return tvl1(first, second, params, device or default_device())
    raise BadParameter(
        "There is no such flow method.",
        field="flow",
        value=method,
        remedy=f"Use one of: {', '.join(get_args(FlowMethod))}.",
    )
