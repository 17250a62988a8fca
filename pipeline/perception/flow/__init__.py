"""Optical flow: displacement of each pixel between two frames."""

from __future__ import annotations

from typing import Literal, get_args

from pipeline.compute import Device
from pipeline.compute import device as default_device
from pipeline.errors import BadParameter
from pipeline.frames import Flow
from pipeline.perception.flow.dis import dis
from pipeline.perception.flow.gray import gray_pair
from pipeline.perception.flow.tvl1 import tvl1
from pipeline.perception.flow.tvl1_params import DEFAULTS, TvL1

FlowMethod = Literal["dis-ultrafast", "dis-fast", "dis-medium", "tvl1"]
"""Flow methods, fastest first. `tvl1` runs on an OpenCL device."""


def estimate(
    previous: object,
    current: object,
    method: FlowMethod = "dis-fast",
    *,
    finer: bool = False,
    params: TvL1 = DEFAULTS,
    device: Device | None = None,
) -> Flow:
    """Flow from `previous` to `current`: previous(x) matches current(x + flow(x)).

    Args:
        previous, current: uint8, RGB (height, width, 3) or gray (height, width), one size, at least 16 px a side.
        method: solver, see `FlowMethod`.
        finer: whether DIS goes one scale further than its preset: for pictures of half the sides of the frames.
        params: parameters of `tvl1`; DIS has presets.
        device: device for `tvl1`; None = the device that `pipeline.compute.device()` selects.

    Returns:
        float32 (height, width, 2): (dx, dy) in px.

    Raises:
        BadFrame: an argument is not a picture, or the sizes differ.
        BadParameter: the method is unknown.
        DeviceError: `tvl1` is requested and no compute device works.
    """
    first, second = gray_pair(previous, current)
    match method:
        case "dis-ultrafast":
            return dis(first, second, "ultrafast", finer)
        case "dis-fast":
            return dis(first, second, "fast", finer)
        case "dis-medium":
            return dis(first, second, "medium", finer)
        case "tvl1":
            return tvl1(first, second, params, device or default_device())
    raise BadParameter(
        "Unknown flow method.",
        field="flow",
        value=method,
        remedy=f"Use one of: {', '.join(get_args(FlowMethod))}.",
    )
