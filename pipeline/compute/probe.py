"""Which OpenCL devices really work: each builds and runs a tiny kernel, and its answer is checked.

A listed runtime may fail to build, crash or hang. So this happens in a child process, whose end is the worst that can
come of it; the verdicts are kept on disk for as long as runtimes, drivers and this file stay the same.
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
from typing import Any

import numpy as np

from pipeline.compute import runtime

TIMEOUT_S = 120.0
"""For all devices together: a first build on a busy machine takes seconds, a hanging driver for ever."""
_NVIDIA = Path("/proc/driver/nvidia/version")
_COUNT = 1003


@dataclass(frozen=True)
class Found:
    """A listed device and how it did. `fault` is empty if it works."""

    platform: str
    device: str
    kind: str
    """gpu, cpu or other."""
    version: str
    """The driver's."""
    rank: tuple[int, int]
    """Among devices of one kind: own memory first (or Intel's CPU runtime, the faster one), then bytes of memory."""
    fault: str = ""

    @property
    def identity(self) -> tuple[str, str, str, str]:
        """What stays the same from one process to the next (the memory that a CPU runtime reports may not)."""
        return self.platform, self.device, self.kind, self.version


def probe(fresh: bool = False) -> tuple[list[Found], str]:
    """Every device with its verdict, and why there are none (else empty). `fresh` asks them all anew."""
    verdicts = runtime.cache_folder() / f"opencl-{_fingerprint()}.json"
    if not fresh and verdicts.exists():
        return _parse(verdicts.read_text().splitlines()), ""
    lines, ending = _ask_all()
    if not ending and lines:
        _keep(verdicts, lines)
    return _parse(lines), ending


def _fingerprint() -> str:
    """Changes whenever a runtime, a driver or the probe does."""
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
    """Ask device after device; after one that takes the child down, a new child goes on with the next."""
    lines: list[str] = []
    deadline = time.monotonic() + TIMEOUT_S
    while True:
        out, ending = _child(len(lines), max(1.0, deadline - time.monotonic()))
        asked = [line for line in out if line.startswith("{")]
        announced = [line[1:] for line in out if line.startswith("?")]
        lines += asked
        if not ending:
            return lines, "" if lines else "No OpenCL runtime is registered on this machine."
        if len(announced) == len(asked):  # it did not fall over a device: listing them is what fails
            return lines, f"Listing the OpenCL devices failed: {ending}."
        lines.append(json.dumps({**json.loads(announced[-1]), "fault": f"its test {ending}"}))
        if time.monotonic() > deadline:
            return lines, "Testing the OpenCL devices took too long."


def _child(skip: int, timeout_s: float) -> tuple[list[str], str]:
    """Its lines, and how it came to a bad end (empty if it did not)."""
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
    """The child: for each device from number `skip` on, announce it (`?{...}`), try it, print the verdict."""
    cl = runtime.opencl()
    for found, device in list(_listed(cl))[skip:]:
        print("?" + json.dumps(asdict(found)), flush=True)
        print(json.dumps({**asdict(found), "fault": _try(cl, device)}), flush=True)


def _listed(cl: Any) -> Iterator[tuple[Found, Any]]:
    for platform in cl.get_platforms():
        for device in platform.get_devices():
            yield describe(cl, device), device


def describe(cl: Any, device: Any) -> Found:
    """What a device says of itself, the same in the child and in the process that uses it."""
    kinds = {cl.device_type.GPU: "gpu", cl.device_type.CPU: "cpu"}
    kind = next((name for bit, name in kinds.items() if device.type & bit), "other")
    platform = device.platform.name.strip()
    own = not device.host_unified_memory if kind == "gpu" else "intel" in platform.lower()
    return Found(platform, device.name.strip(), kind, device.driver_version.strip(), (int(own), device.global_mem_size))


def _try(cl: Any, device: Any) -> str:
    """Empty if the device computes the right thing, else what went wrong."""
    try:
        got, wanted = _run(cl, device)
    except cl.Error as error:
        return " ".join(str(error).split())[:300]
    return "" if np.allclose(got, wanted, rtol=1e-5) else "its answer to the test is wrong"


def _run(cl: Any, device: Any) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    context = cl.Context([device])
    queue = cl.CommandQueue(context)
    values = np.zeros(-(-_COUNT // 8) * 8, np.float32)
    values[:_COUNT] = np.arange(_COUNT)
    source, result = (cl.Buffer(context, cl.mem_flags.READ_WRITE, values.nbytes) for _ in range(2))
    cl.enqueue_copy(queue, source, values)
    cl.enqueue_copy(queue, result, np.zeros_like(values))
    program = cl.Program(context, Path(__file__).with_suffix(".cl").read_text()).build()
    program.probe(queue, values.shape, (8,), source, result, np.int32(_COUNT))
    got = np.empty_like(values)
    cl.enqueue_copy(queue, got, result)
    mirrored = values.reshape(-1, 8)[:, ::-1].reshape(-1)
    return got[:_COUNT], (3 * values + mirrored + np.sqrt(values))[:_COUNT]
