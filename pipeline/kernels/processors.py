"""The number of processors that this process may use."""

from __future__ import annotations

import os
from pathlib import Path

_CGROUP = Path("/sys/fs/cgroup")


def usable_processors() -> int:
    """Processors that this process may use: its affinity, and the limit of its container."""
    mask = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    quota, _, period = container_limit("cpu.max").partition(" ")
    return max(1, min(mask, -(-int(quota) // int(period)))) if quota.isdecimal() else mask


def container_limit(name: str) -> str:
    """A limit of the control group of this container (version 2); empty if there is none."""
    try:
        return (_CGROUP / name).read_text().strip()
    except OSError:
        return ""
