"""OpenCL device: command queue, compiled kernels and memory pool. Opened once per process, on first use."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import DTypeLike

from pipeline.arrays import AnyArray
from pipeline.compute import choice, runtime
from pipeline.compute.probe import Found, describe
from pipeline.compute.signature import Macro, Parameter, check, signature
from pipeline.errors import DeviceError

if TYPE_CHECKING:
    import pyopencl  # at run time through `runtime.opencl` only

Group: TypeAlias = tuple[int, ...] | None
_KernelKey: TypeAlias = tuple[Path, str, tuple[str, ...], Path | None]
"""File, name, options and common file of a kernel."""

_PRELUDE = "#pragma OPENCL FP_CONTRACT OFF\n#line 1\n"
"""Forbids contraction into fused multiply-adds, so that kernels round as NumPy does."""
_GROUP = {"cpu": (64, 16), "gpu": (32, 4), "other": (32, 1)}
_IDLE_BYTES = 256 << 20
"""Maximum unused memory that the pool retains, bytes."""


@dataclass(frozen=True, slots=True)
class DeviceArray:
    """An array in device memory, C order. Its memory returns to the pool when the last reference is dropped."""

    buffer: pyopencl.Buffer
    shape: tuple[int, ...]
    dtype: np.dtype[np.generic]

    @property
    def nbytes(self) -> int:
        """Size of the data, bytes."""
        return math.prod(self.shape) * self.dtype.itemsize


class Device:
    """One OpenCL device. Thread-safe; work runs in the order of submission."""

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
        self._programs: dict[tuple[str, tuple[str, ...]], pyopencl.Program] = {}
        self._lock = threading.RLock()
        self._kernels = threading.local()

    def _find(self, found: Found) -> pyopencl.Device:
        device: pyopencl.Device
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

    def upload(self, array: AnyArray) -> DeviceArray:
        """Copy an array to the device."""
        source = np.ascontiguousarray(array)
        target = self.empty(source.shape, source.dtype)
        with self._lock, _as_device_error(self._cl, "An upload failed"):
            self._cl.enqueue_copy(self._queue, target.buffer, source)
        return target

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> DeviceArray:
        """Allocate an array with undefined content. Raises `DeviceError` if it does not fit into device memory."""
        kind = np.dtype(dtype)
        size = max(1, int(math.prod(shape))) * kind.itemsize
        with self._lock, _as_device_error(self._cl, f"{size} bytes of device memory cannot be allocated"):
            if self._pool.managed_bytes - self._pool.active_bytes > _IDLE_BYTES:
                self._pool.free_held()
            return DeviceArray(self._pool.allocate(size), tuple(shape), kind)

    def zeros(self, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> DeviceArray:
        """Allocate an array of zeros."""
        target = self.empty(shape, dtype)
        with self._lock, _as_device_error(self._cl, "Memory cannot be set to zero"):
            if target.nbytes:
                zero = np.zeros(1, target.dtype)
                self._cl.enqueue_fill_buffer(self._queue, target.buffer, zero, 0, target.nbytes)
        return target

    def download(self, array: DeviceArray) -> AnyArray:
        """Copy an array from the device; waits for all work that it depends on."""
        target = np.empty(array.shape, array.dtype)
        with self._lock, _as_device_error(self._cl, "A download failed"):
            self._cl.enqueue_copy(self._queue, target, array.buffer)
        return target

    def finish(self) -> None:
        """Wait until all submitted work is done. Needed for timing only, because `download` waits, too."""
        with self._lock, _as_device_error(self._cl, "The device failed"):
            self._queue.finish()

    def kernel(
        self, file: Path, name: str, defines: Mapping[str, Macro] | None = None, common: Path | None = None
    ) -> Kernel:
        """The kernel `name` of an OpenCL C file, compiled on first use (pyopencl caches the binary on disk).

        Args:
            file: usually `Path(__file__).with_suffix(".cl")`.
            defines: macros, passed as `-D name=value`.
            common: a file of shared functions, prepended to the source.
        """
        options = tuple(f"-D{key}={value}" for key, value in (defines or {}).items())
        kept: dict[_KernelKey, Kernel] = self._kernels.__dict__.setdefault("kept", {})
        key: _KernelKey = (file, name, options, common)
        if key not in kept:
            before = f"{common.read_text()}#line 1\n" if common else ""
            text = file.read_text()
            program = self._program(before + text, options, file.name)
            kept[key] = Kernel(self, self._cl.Kernel(program, name), signature(text, name), defines or {})
        return kept[key]

    def _program(self, source: str, options: tuple[str, ...], name: str) -> pyopencl.Program:
        with self._lock, _as_device_error(self._cl, f"{name} cannot be built for {self.name}"):
            key = (source, options)
            if key not in self._programs:
                self._programs[key] = self._build(_PRELUDE + source, [*self._options, *options])
            return self._programs[key]

    def _build(self, source: str, options: list[str]) -> pyopencl.Program:
        """Compile, or load the binary that pyopencl keeps on disk.

        `Program.build` adds the path of pyopencl's headers, which our kernels do not include, to the options. They are
        part of the key of a binary, so another environment would compile every kernel again. Drivers that keep binaries
        themselves have no such key.
        """
        from pyopencl.cache import create_built_program_from_source_cached
        from pyopencl.characterize import has_src_build_cache

        program: pyopencl.Program
        if has_src_build_cache(self._context.devices[0]):
            program = self._cl.Program(self._context, source).build(options)
        else:
            built, _ = create_built_program_from_source_cached(self._context, source, " ".join(options).encode())
            program = self._cl.Program(built)
        return program

    def run(self, *launches: Launch, times: int = 1) -> None:
        """Submit the launches in order, repeat the whole sequence `times` times, and return without waiting.

        Arguments are set once (35 us per launch); each repetition only enqueues (5 us). A kernel may therefore occur
        only once in `launches`.
        """
        with self._lock, _as_device_error(self._cl, f"The kernel {launches[0].compiled.function_name} failed"):
            for launch in launches:
                launch.compiled.set_args(*launch.args)
            for launch in launches * times:
                self._cl.enqueue_nd_range_kernel(self._queue, launch.compiled, launch.padded, launch.group)


@dataclass(frozen=True, slots=True)
class Launch:
    """A kernel with its arguments and work sizes, for `Device.run`."""

    compiled: pyopencl.Kernel
    padded: tuple[int, ...]
    group: tuple[int, ...]
    args: tuple[pyopencl.Buffer | np.generic, ...]


class Kernel:
    """A compiled kernel. Only the thread that requested it may use it."""

    def __init__(
        self, device: Device, compiled: pyopencl.Kernel, parameters: tuple[Parameter, ...], macros: Mapping[str, Macro]
    ) -> None:
        self._device, self._compiled, self._parameters, self._macros = device, compiled, parameters, dict(macros)

    def at(self, size: tuple[int, ...], *args: DeviceArray | float | np.generic, group: Group = None) -> Launch:
        """Prepare a launch of this kernel with arguments and work sizes, without running it.

        Args:
            size: work items along x, y, z; rounded up to whole work groups, so the kernel must check its bounds.
            args: arrays and scalars; Python's int and float become OpenCL's `int` and `float`.
            group: work-group size if the kernel prescribes one; None = a size that suits the device.

        Raises:
            DeviceError: an array is smaller than the kernel declares (see `signature`).
        """
        check(self._compiled.function_name, self._parameters, args, size, self._macros)
        local = group or (*_GROUP[self._device.kind], 1)[: len(size)]
        padded = tuple(-(-n // m) * m for n, m in zip(size, local, strict=True))
        return Launch(self._compiled, padded, local, tuple(map(_argument, args)))

    def __call__(self, size: tuple[int, ...], *args: DeviceArray | float | np.generic, group: Group = None) -> None:
        """Run the kernel once; shorthand for `Device.run` with the launch that `at` returns."""
        self._device.run(self.at(size, *args, group=group))


def _argument(value: DeviceArray | float | np.generic) -> pyopencl.Buffer | np.generic:
    if isinstance(value, DeviceArray):
        return value.buffer
    if isinstance(value, np.generic):
        return value
    return np.int32(value) if isinstance(value, int) else np.float32(value)


@contextmanager
def _as_device_error(cl: ModuleType, what: str) -> Iterator[None]:
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
    """The device of this process, opened on first use; later calls with the same argument return the same object.

    Args:
        wanted: "" or "auto" (a GPU, otherwise a CPU), "gpu", "cpu", or a substring of a platform or device name.

    Raises:
        DeviceError: no device works, or none matches; the message gives the reason for each device.
    """
    with _devices_lock:
        found = choice.choose(wanted)
        if found.identity not in _devices:
            _devices[found.identity] = Device(found)
        return _devices[found.identity]
