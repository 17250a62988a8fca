"""Test of the OpenCL devices: each device builds and runs a small kernel, and the result is verified.

A listed runtime may fail to build, crash or hang, so the test runs in a child process. The results are cached on disk
until a runtime, a driver or this file changes.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.compute import runtime

if TYPE_CHECKING:
    import pyopencl  # at run time through `runtime.opencl` only

TIMEOUT_S = 120.0
"""Time limit for testing all devices together. A first build on a busy machine takes several seconds."""
_NVIDIA = Path("/proc/driver/nvidia/version")
_COUNT = 1003


@dataclass(frozen=True)
class Found:
    """A listed device and its test result. `fault` is empty if the device works."""

    platform: str
    device: str
    kind: str
    """Device type: "gpu", "cpu" or "other"."""
    version: str
    """Driver version."""
    rank: tuple[int, int]
    """Preference among devices of one kind: (1 for dedicated memory or Intel's faster CPU runtime, memory in bytes)."""
    fault: str = ""

    @property
    def identity(self) -> tuple[str, str, str, str]:
        """Key that is stable between processes. Excludes the memory size, which CPU runtimes report inconsistently."""
        return self.platform, self.device, self.kind, self.version


def probe(fresh: bool = False) -> tuple[list[Found], str]:
    """All devices with their test results, and the reason if there are no devices (otherwise "").

    Args:
        fresh: test all devices again and ignore cached results.
    """
    verdicts = runtime.cache_folder() / f"opencl-{_fingerprint()}.json"
    if not fresh and verdicts.exists():
        return _parse(verdicts.read_text().splitlines()), ""
    lines, ending = _ask_all()
    if not ending and lines:
        _keep(verdicts, lines)
    return _parse(lines), ending


def _fingerprint() -> str:
    """Cache key: a hash of the installed runtimes, the driver version, the probe's source and the Python version."""
    runtime.prepare()
    libraries = sorted(runtime.registrations().items())
    stamps = [(s.st_size, s.st_mtime_ns) for _, lib in libraries if Path(lib).is_file() for s in [Path(lib).stat()]]
    driver = _NVIDIA.read_text() if _NVIDIA.exists() else ""
    sources = [Path(__file__).with_suffix(end).read_text() for end in (".py", ".cl")]
    return hashlib.sha256(repr([libraries, stamps, driver, sources, sys.version]).encode()).hexdigest()[:16]


def _keep(file: Path, lines: list[str]) -> None:
    partial = file.with_name(f"{file.name}.{os.getpid()}")
    partial.write_text("\n".join(lines))
    partial.replace(file)


def _parse(lines: list[str]) -> list[Found]:
    rows = [json.loads(line) for line in lines]
    return [Found(**{**row, "rank": tuple(row["rank"])}) for row in rows]


def _ask_all() -> tuple[list[str], str]:
    """Test the devices one after the other. If a device crashes the child, a new child continues with the next one.

    Returns one JSON line per device, and the reason if devices could not be listed or tested (otherwise "").
    """
    lines: list[str] = []
    deadline = time.monotonic() + TIMEOUT_S
    while True:
        out, ending = _child(len(lines), max(1.0, deadline - time.monotonic()))
        asked = [line for line in out if line.startswith("{")]
        announced = [line[1:] for line in out if line.startswith("?")]
        lines += asked
        if not ending:
            return lines, "" if lines else "No OpenCL runtime is registered on this machine."
        if len(announced) == len(asked):  # no device was being tested: listing the devices failed
            return lines, f"Listing the OpenCL devices failed: {ending}."
        lines.append(json.dumps({**json.loads(announced[-1]), "fault": f"its test {ending}"}))
        if time.monotonic() > deadline:
            return lines, "Testing the OpenCL devices took too long."


def _child(skip: int, timeout_s: float) -> tuple[list[str], str]:
    """Run the test child, skipping `skip` devices: its output lines, and how it failed ("" = it succeeded)."""
    root = Path(__file__).resolve().parents[2]
    code = f"import sys; sys.path.insert(0, {str(root)!r}); from pipeline.compute.probe import main; main({skip})"
    try:
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=timeout_s, check=False)  # noqa: S603
    except subprocess.TimeoutExpired as late:
        return (late.stdout or b"").decode(errors="replace").splitlines(), f"did not end within {timeout_s:.0f} s"
    ending = "" if done.returncode == 0 else _how(done.returncode, done.stderr.decode(errors="replace"))
    return done.stdout.decode(errors="replace").splitlines(), ending


def _how(status: int, stderr: str) -> str:
    if status < 0:
        return f"was killed by signal {-status}"
    return f"failed: {(stderr.strip().splitlines() or [f'exit status {status}'])[-1]}"[:300]


def main(skip: int) -> None:
    """Entry point of the child. For each device from index `skip` on: print `?{...}`, test it, print the result."""
    cl = runtime.opencl()
    for found, device in list(_listed(cl))[skip:]:
        print("?" + json.dumps(asdict(found)), flush=True)
        print(json.dumps({**asdict(found), "fault": _try(cl, device)}), flush=True)


def _listed(cl: ModuleType) -> Iterator[tuple[Found, pyopencl.Device]]:
    for platform in cl.get_platforms():
        for device in platform.get_devices():
            yield describe(cl, device), device


def describe(cl: ModuleType, device: pyopencl.Device) -> Found:
    """Properties of a device, computed in the same way in the test child and in the process that uses the device."""
    kinds = {cl.device_type.GPU: "gpu", cl.device_type.CPU: "cpu"}
    kind = next((name for bit, name in kinds.items() if device.type & bit), "other")
    platform = device.platform.name.strip()
    own = not device.host_unified_memory if kind == "gpu" else "intel" in platform.lower()
    return Found(platform, device.name.strip(), kind, device.driver_version.strip(), (int(own), device.global_mem_size))


def _try(cl: ModuleType, device: pyopencl.Device) -> str:
    """Run the test kernel. Returns "" if the result is correct, otherwise a description of the fault."""
    try:
        got, wanted = _run(cl, device)
    except cl.Error as error:
        return " ".join(str(error).split())[:300]
    return "" if np.allclose(got, wanted, rtol=1e-5) else "its result of the test kernel is wrong"


def _run(cl: ModuleType, device: pyopencl.Device) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    context = cl.Context([device])
    queue = cl.CommandQueue(context)
    values = np.zeros(-(-_COUNT // 8) * 8, np.float32)
    values[:_COUNT] = np.arange(_COUNT)
    source, result = (cl.Buffer(context, cl.mem_flags.READ_WRITE, values.nbytes) for _ in range(2))
    cl.enqueue_copy(queue, source, values)
    cl.enqueue_copy(queue, result, np.zeros_like(values))
    program = cl.Program(context, Path(__file__).with_suffix(".cl").read_text()).build()
    cl.Kernel(program, "probe")(queue, values.shape, (8,), source, result, np.int32(_COUNT))
    got = np.empty_like(values)
    cl.enqueue_copy(queue, got, result)
    mirrored = values.reshape(-1, 8)[:, ::-1].reshape(-1)
    return got[:_COUNT], (3 * values + mirrored + np.sqrt(values))[:_COUNT]
