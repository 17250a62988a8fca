"""Renders the cases in a child process that computes alike on every x86-64 processor with AVX2 and FMA.

OpenCV and NumPy choose their loops by the processor: with AVX-512, AVX2 or SSE the last bits of a float differ, and so
do some pixels. The child has them stay with AVX2. Numba, OpenBLAS, the C library and Intel's OpenCL runtime gave equal
bytes at every instruction set that could be tried (SSE4.2, AVX and AVX2).
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pipeline.compute import report

ROOT = Path(__file__).resolve().parents[2]
INSTRUCTIONS = "x86-64-v3"
PINNED = {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR", "OPENCV_IPP": "avx2"}
PINNED_WITH_AVX512 = PINNED | {"OPENCV_CPU_DISABLE": "AVX512-SKX"}
"""OpenCV warns of a feature that is to be disabled and is not there."""
PACKAGES = ("numpy", "opencv-contrib-python-headless", "numba", "pyopencl", "intel-opencl-rt")
OPENCL = "Intel(R) OpenCL"

Values = dict[str, dict[str, str]]
"""Case -> name -> SHA-256; see `digests.render`. The case `clips` has those of the clips themselves."""


def digests(ids: Iterable[str]) -> Values:
    """Render the cases in a pinned child process."""
    command = [sys.executable, "-m", "tests.regression.child", *ids]
    pinned = PINNED_WITH_AVX512 if "avx512f" in _features() else PINNED
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **pinned}
    done = subprocess.run(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, check=True)
    values: Values = json.loads(done.stdout)
    return values


def machine() -> dict[str, Any]:
    """The machine the values apply to: instruction set, OpenCL platform, versions of the packages that compute."""
    return {
        "instructions": INSTRUCTIONS if _has_avx2() else platform.machine(),
        "opencl": opencl_platform(),
        "packages": {name: version(name) for name in PACKAGES},
    }


def opencl_platform() -> str:
    """Name of the platform that the pipeline chooses, "" where there is none."""
    return next((str(row["platform"]) for row in report(fresh=False) if row["chosen"]), "")


def unfit() -> str:
    """Why this processor cannot reproduce the recorded values; "" if it can."""
    return "" if _has_avx2() else f"values are recorded for {INSTRUCTIONS}, which this processor is not"


def _has_avx2() -> bool:
    return platform.machine() == "x86_64" and {"avx2", "fma"} <= _features()


@cache
def _features() -> frozenset[str]:
    """Features of the processor as Linux names them."""
    info = Path("/proc/cpuinfo")
    return frozenset(info.read_text().split()) if info.exists() else frozenset()
