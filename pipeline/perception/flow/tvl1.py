"""TV-L1 optical flow (zach2007duality): slower and more accurate than DIS, on any OpenCL device.

This module has the coarse-to-fine loop. Its operations are implemented twice: as kernels (`tvl1.cl`, launched by
`tvl1_opencl`), and in NumPy as their specification (`tvl1_reference`).
"""

from __future__ import annotations

from typing import Protocol, TypeVar

from pipeline.compute import Device
from pipeline.frames import Flow
from pipeline.perception.flow.gray import Gray, gray_pair
from pipeline.perception.flow.tvl1_opencl import Kernels
from pipeline.perception.flow.tvl1_params import DEFAULTS, TvL1
from pipeline.perception.flow.tvl1_reference import Reference

COARSEST_PX = 16
"""The smaller side of the coarsest level is at least this and less than twice this."""


T = TypeVar("T")


class TvL1Operations(Protocol[T]):
    """TvL1Operations of the loop on arrays of type T: an image pair (2, h, w), a flow (2, h, w), float32; see
    `tvl1_reference`."""

    def load(self, previous: Gray, current: Gray) -> T: ...
    def size(self, planes: T) -> tuple[int, int]: ...
    def texture(self, pair: T, params: TvL1) -> T: ...
    def down(self, pair: T) -> T: ...
    def gradient(self, pair: T) -> T: ...
    def zeros(self, planes: int, size: tuple[int, int]) -> T: ...
    def up(self, flow: T, size: tuple[int, int]) -> T: ...
    def linearise(self, pair: T, slope: T, flow: T) -> T: ...
    def iterate(self, data: T, flow: T, dual: T, params: TvL1) -> tuple[T, T]: ...
    def median(self, flow: T) -> T: ...
    def fetch(self, flow: T) -> Flow: ...


def tvl1(previous: object, current: object, params: TvL1 = DEFAULTS, device: Device | None = None) -> Flow:
    """Flow from `previous` to `current`: previous(x) matches current(x + flow(x)).

    Args:
        previous, current: uint8, RGB (height, width, 3) or gray (height, width), one size, at least 16 px a side.
        params: parameters of the paper.
        device: device of the kernels; None = the NumPy reference, which is several times slower. The result is the same
            on devices with correctly rounded divisions and square roots, such as the CPU runtimes.

    Returns:
        float32 (height, width, 2): (dx, dy) in px.

    Raises:
        BadFrame: an argument is not a picture, or the sizes differ.
        DeviceError: the device failed.

    Source: zach2007duality, sections 2 and 3.

    Departure: structure-texture decomposition of the pictures, gradients averaged over both frames and a median of
        the flow after each warp, all from wedel2009improved. Mean end-point error in px on RubberWhale and Sintel's
        alley_1: 0.155 and 0.234 without texture and median, 0.101 and 0.210 with. A fixed number of
        iterations instead of a stopping criterion, so that the time does not depend on the picture.
    """
    first, second = gray_pair(previous, current)
    if device is None:
        return solve(Reference(), first, second, params)
    return solve(Kernels(device), first, second, params)


def solve(ops: TvL1Operations[T], previous: Gray, current: Gray, params: TvL1) -> Flow:
    """Estimate the flow from coarse to fine with either implementation of the operations."""
    levels = [ops.texture(ops.load(previous, current), params)]
    while min(ops.size(levels[-1])) >= 2 * COARSEST_PX:
        levels.append(ops.down(levels[-1]))
    flow = ops.zeros(2, ops.size(levels[-1]))
    for pair in reversed(levels):
        if ops.size(flow) != ops.size(pair):
            flow = ops.up(flow, ops.size(pair))
        flow = _level(ops, pair, flow, params)
    return ops.fetch(flow)


def _level(ops: TvL1Operations[T], pair: T, flow: T, params: TvL1) -> T:
    slope, dual = ops.gradient(pair), ops.zeros(4, ops.size(pair))
    for _ in range(params.warps):
        data = ops.linearise(pair, slope, flow)
        flow, dual = ops.iterate(data, flow, dual, params)
        flow = ops.median(flow) if params.median else flow
    return flow
