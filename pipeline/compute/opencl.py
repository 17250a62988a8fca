"""A compute device at work: queue, compiled kernels, memory. Made once a process, when first asked for."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from pipeline.compute import choice, runtime
from pipeline.compute.probe import Found, describe
from pipeline.errors import DeviceError

Group: TypeAlias = tuple[int, ...] | None

_PRELUDE = "#pragma OPENCL FP_CONTRACT OFF\n#line 1\n"
"""Every kernel rounds as NumPy does: no fused multiply-add behind our back."""
_GROUP = {"cpu": (64, 16), "gpu": (32, 4), "other": (32, 1)}
_IDLE_BYTES = 256 << 20
"""How much memory in no use the pool may hold on to."""


@dataclass(frozen=True, slots=True)
class DeviceArray:
    """An array in the device's memory, C order. Freed (into the pool) when no one refers to it."""

    buffer: Any
    shape: tuple[int, ...]
    dtype: np.dtype[Any]


class Device:
    """One OpenCL device. Safe to share between threads: work runs in the order in which it was handed over."""

    def __init__(self, found: Found) -> None:
        self._cl = runtime.opencl()
        self.name, self.platform, self.kind = found.device, found.platform, found.kind
        with _as_device_error(self._cl, f"{found.device} cannot be opened"):
            handle = self._find(found)
            self._context = self._cl.Context([handle])
            self._queue = self._cl.CommandQueue(self._context)
            self.memory_bytes = int(handle.global_mem_size)
            self._pool = self._cl.tools.MemoryPool(self._cl.tools.ImmediateAllocator(self._queue))
        rounding = self._cl.device_fp_config.CORRECTLY_ROUNDED_DIVIDE_SQRT
        exact = handle.single_fp_config & rounding
        self._options = ["-cl-std=CL1.2", *(["-cl-fp32-correctly-rounded-divide-sqrt"] if exact else [])]
        self._programs: dict[tuple[str, tuple[str, ...]], Any] = {}
        self._lock = threading.RLock()
        self._kernels = threading.local()

    def _find(self, found: Found) -> Any:
        for platform in self._cl.get_platforms():
            for device in platform.get_devices():
                if describe(self._cl, device).identity == found.identity:
                    return device
        raise DeviceError(
            f"{found.device} works, but is not listed in this process.",
            field="device",
            remedy="Import pyopencl, if you must, after `pipeline.compute.device()`: the first import fixes the list.",
        )

    def __repr__(self) -> str:
        return f"<Device {self.platform}: {self.name}>"

    def upload(self, array: NDArray[Any]) -> DeviceArray:
        """Copy an array to the device."""
        source = np.ascontiguousarray(array)
        target = self.empty(source.shape, source.dtype)
        with self._lock, _as_device_error(self._cl, "An upload failed"):
            self._cl.enqueue_copy(self._queue, target.buffer, source)
        return target

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> DeviceArray:
        """Memory for an array, its content undefined. `DeviceError` if it does not fit."""
        kind = np.dtype(dtype)
        size = max(1, int(np.prod(shape))) * kind.itemsize
        with self._lock, _as_device_error(self._cl, f"{size} bytes of device memory are not to be had"):
            if self._pool.managed_bytes - self._pool.active_bytes > _IDLE_BYTES:
                self._pool.free_held()
            return DeviceArray(self._pool.allocate(size), tuple(shape), kind)

    def zeros(self, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> DeviceArray:
        """An array of zeros on the device."""
        return self.upload(np.zeros(shape, dtype))

    def download(self, array: DeviceArray) -> NDArray[Any]:
        """Copy an array from the device; waits for the work it depends on."""
        target = np.empty(array.shape, array.dtype)
        with self._lock, _as_device_error(self._cl, "A download failed"):
            self._cl.enqueue_copy(self._queue, target, array.buffer)
        return target

    def finish(self) -> None:
        """Wait until all work handed over is done (to measure it; `download` waits by itself)."""
        with self._lock, _as_device_error(self._cl, "The device failed"):
            self._queue.finish()

    def kernel(
        self, file: Path, name: str, defines: Mapping[str, int | float | str] | None = None, common: Path | None = None
    ) -> Kernel:
        """The kernel `name` of the OpenCL C file, compiled on first use (and kept on disk by pyopencl).

        Args:
            file: usually `Path(__file__).with_suffix(".cl")`.
            defines: macros, `-D name=value`.
            common: a file of functions that several share, put in front.
        """
        options = tuple(f"-D{key}={value}" for key, value in (defines or {}).items())
        kept: dict[Any, Kernel] = self._kernels.__dict__.setdefault("kept", {})
        key = (file, name, options, common)
        if key not in kept:
            before = f"{common.read_text()}#line 1\n" if common else ""
            program = self._program(before + file.read_text(), options, file.name)
            kept[key] = Kernel(self, self._cl.Kernel(program, name))
        return kept[key]

    def _program(self, source: str, options: tuple[str, ...], name: str) -> Any:
        with self._lock, _as_device_error(self._cl, f"{name} cannot be built for {self.name}"):
            key = (source, options)
            if key not in self._programs:
                program = self._cl.Program(self._context, _PRELUDE + source)
                self._programs[key] = program.build([*self._options, *options])
            return self._programs[key]

    def run(self, *launches: Launch, times: int = 1) -> None:
        """Hand launches over in this order, all of them `times` over, and return at once.

        An iteration is cheap: arguments are set once (35 us), then only enqueued (5 us). So a kernel may occur in
        `launches` only once.
        """
        with self._lock, _as_device_error(self._cl, f"The kernel {launches[0].compiled.function_name} failed"):
            for launch in launches:
                launch.compiled.set_args(*launch.args)
            for launch in launches * times:
                self._cl.enqueue_nd_range_kernel(self._queue, launch.compiled, launch.padded, launch.group)


@dataclass(frozen=True, slots=True)
class Launch:
    """A kernel with its arguments and sizes: what `Device.run` takes."""

    compiled: Any
    padded: tuple[int, ...]
    group: tuple[int, ...]
    args: tuple[Any, ...]


class Kernel:
    """A compiled kernel. Belongs to the thread that asked for it."""

    def __init__(self, device: Device, compiled: Any) -> None:
        self._device, self._compiled = device, compiled

    def at(self, size: tuple[int, ...], *args: DeviceArray | float | np.generic, group: Group = None) -> Launch:
        """What to run over which work items.

        Args:
            size: work items along x, y, z; rounded up to whole work groups, so the kernel must check its bounds.
            args: arrays; Python's int and float become `int` and `float`.
            group: work-group size, where the kernel prescribes one; else what suits the device.
        """
        local = group or (*_GROUP[self._device.kind], 1)[: len(size)]
        padded = tuple(-(-n // m) * m for n, m in zip(size, local, strict=True))
        return Launch(self._compiled, padded, local, tuple(map(_argument, args)))

    def __call__(self, size: tuple[int, ...], *args: DeviceArray | float | np.generic, group: Group = None) -> None:
        """Run it once: `Device.run` of `at`."""
        self._device.run(self.at(size, *args, group=group))


def _argument(value: DeviceArray | float | np.generic) -> Any:
    if isinstance(value, DeviceArray):
        return value.buffer
    if isinstance(value, np.generic):
        return value
    return np.int32(value) if isinstance(value, int) else np.float32(value)


@contextmanager
def _as_device_error(cl: Any, what: str) -> Iterator[None]:
    try:
        yield
    except cl.Error as error:
        remedy = "Try another device (`impasto doctor` lists them) or a smaller frame."
        raise DeviceError(f"{what}: {' '.join(str(error).split())[:2000]}", field="device", remedy=remedy) from error


_devices: dict[tuple[str, ...], Device] = {}
_devices_lock = threading.Lock()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_devices.clear)  # a context does not survive a fork


def device(wanted: str = "") -> Device:
    """This process's device: opened when first asked for, then always the same one.

    Args:
        wanted: "" or "auto" (a GPU, else a CPU runtime), "gpu", "cpu", or a part of a platform's or device's name.

    Raises:
        DeviceError: none works, or none fits; the message says why for each.
    """
    with _devices_lock:
        found = choice.choose(wanted)
        if found.identity not in _devices:
            _devices[found.identity] = Device(found)
        return _devices[found.identity]
