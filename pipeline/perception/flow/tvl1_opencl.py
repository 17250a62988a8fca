"""Operations of TV-L1 as launches of the kernels in `tvl1.cl`. The specification is `tvl1_reference`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.compute import Device, DeviceArray, Launch
from pipeline.frames import Flow
from pipeline.perception.flow.gray import Gray
from pipeline.perception.flow.tvl1_params import TvL1
from pipeline.perception.flow.tvl1_reference import ROF_RATIO, ROF_THETA

_SOURCE = Path(__file__).with_name("tvl1.cl")


class Kernels:
    """The operations of `tvl1.solve` on a device; arrays stay in device memory between `load` and `fetch`."""

    def __init__(self, device: Device) -> None:
        self._device = device

    def _at(self, name: str, planes: int, size: tuple[int, int], *args: DeviceArray | float | np.generic) -> Launch:
        """Launch with one work item per pixel of `planes` planes; appends the width and height to the arguments."""
        height, width = size
        return self._device.kernel(_SOURCE, name).at((width, height, planes), *args, width, height)

    def _run(self, name: str, planes: int, size: tuple[int, int], *args: DeviceArray | float | np.generic) -> None:
        self._device.run(self._at(name, planes, size, *args))

    def load(self, previous: Gray, current: Gray) -> DeviceArray:
        return self._device.upload(np.stack([previous, current]).astype(np.float32))

    def size(self, planes: DeviceArray) -> tuple[int, int]:
        return planes.shape[1], planes.shape[2]

    def zeros(self, planes: int, size: tuple[int, int]) -> DeviceArray:
        return self._device.zeros((planes, *size))

    def fetch(self, flow: DeviceArray) -> Flow:
        return np.ascontiguousarray(self._device.download(flow).transpose(1, 2, 0), dtype=np.float32)

    def texture(self, pair: DeviceArray, params: TvL1) -> DeviceArray:
        if not params.texture_iterations:
            return pair
        size = self.size(pair)
        dual, other = self.zeros(4, size), self._device.empty((4, *size))
        for _ in range(params.texture_iterations):
            self._run("rof", 2, size, pair, dual, other, ROF_THETA, ROF_RATIO)
            dual, other = other, dual
        out = self._device.empty(pair.shape)
        self._run("texture", 2, size, pair, dual, out, ROF_THETA, params.texture_share)
        return out

    def down(self, pair: DeviceArray) -> DeviceArray:
        height, width = self.size(pair)
        half = ((height + 1) // 2, (width + 1) // 2)
        out = self._device.empty((2, *half))
        self._run("down", 2, half, pair, out, width, height)
        return out

    def up(self, flow: DeviceArray, size: tuple[int, int]) -> DeviceArray:
        height, width = self.size(flow)
        out = self._device.empty((2, *size))
        self._run("up", 2, size, flow, out, width, height)
        return out

    def gradient(self, pair: DeviceArray) -> DeviceArray:
        out = self._device.empty((4, *self.size(pair)))
        self._run("gradient", 2, self.size(pair), pair, out)
        return out

    def linearise(self, pair: DeviceArray, slope: DeviceArray, flow: DeviceArray) -> DeviceArray:
        out = self._device.empty((3, *self.size(pair)))
        self._run("linearise", 1, self.size(pair), pair, slope, flow, out)
        return out

    def iterate(
        self, data: DeviceArray, flow: DeviceArray, dual: DeviceArray, params: TvL1
    ) -> tuple[DeviceArray, DeviceArray]:
        size, bound = self.size(flow), params.attachment * params.tightness
        primal = self._at("primal", 1, size, data, dual, flow, bound, params.tightness)
        second = self._at("dual", 1, size, flow, dual, params.time_step / params.tightness)
        self._device.run(primal, second, times=params.iterations)
        return flow, dual

    def median(self, flow: DeviceArray) -> DeviceArray:
        out = self._device.empty(flow.shape)
        self._run("median", 2, self.size(flow), flow, out)
        return out
