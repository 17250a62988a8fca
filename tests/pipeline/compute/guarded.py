"""OpenCL device that surrounds arrays with guard bands, to detect kernels that read or write out of bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import DTypeLike

from pipeline.compute.opencl import Device, DeviceArray
from pipeline.compute.probe import Found
from pipeline.errors import DeviceError

if TYPE_CHECKING:
    import pyopencl  # at run time through `runtime.opencl` only

BAND_BYTES = 4096


class GuardedDevice(Device):
    """A `Device` with guard bands.

    `check_bands` detects out-of-bounds writes. To detect out-of-bounds reads, run the same work with two values of
    `fill`: the results then differ.

    Args:
        fill: value of every byte of the bands and of arrays whose content is undefined.
    """

    def __init__(self, found: Found, fill: int) -> None:
        super().__init__(found)
        self._fill = fill
        self._arrays: list[tuple[pyopencl.Buffer, int]] = []

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> DeviceArray:
        kind = np.dtype(dtype)
        size = max(1, int(np.prod(shape))) * kind.itemsize
        flags = self._cl.mem_flags.READ_WRITE
        whole = np.full(size + 2 * BAND_BYTES, self._fill, np.uint8)
        buffer = self._cl.Buffer(self._context, flags | self._cl.mem_flags.COPY_HOST_PTR, hostbuf=whole)
        self._arrays.append((buffer, size))
        return DeviceArray(buffer.get_sub_region(BAND_BYTES, size), tuple(shape), kind)

    def check_bands(self) -> None:
        """Raise `DeviceError` if any guard band has changed."""
        self.finish()
        for buffer, size in self._arrays:
            content = np.empty(size + 2 * BAND_BYTES, np.uint8)
            self._cl.enqueue_copy(self._queue, content, buffer)
            if (content[:BAND_BYTES] != self._fill).any() or (content[BAND_BYTES + size :] != self._fill).any():
                raise DeviceError(
                    f"A kernel has written outside an array of {size} bytes.", field="device",
                    remedy="Compare the sizes of its arrays with its work items.",
                )  # fmt: skip
