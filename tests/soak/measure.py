"""Samples a running service and tests whether the measures grow."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import numpy as np
import psutil

WARM_UP = 0.25
"""Fraction of the samples at the start that is ignored, while caches and pools fill up."""


@dataclass
class Series:
    """Values over time. `at_s`: seconds since the start."""

    at_s: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class Trend:
    """A line through a series, without its warm-up.

    Attributes:
        mean: of the values.
        per_hour, error: slope and its standard error, units per hour.
    """

    mean: float
    per_hour: float
    error: float

    @property
    def grows(self) -> bool:
        """Whether the slope is above three standard errors, and above 1 % of the mean per hour."""
        return self.per_hour > 3 * self.error and self.per_hour > 0.01 * abs(self.mean)


def trend(series: Series) -> Trend | None:
    """The least-squares line; None for fewer than four samples after the warm-up."""
    begin = int(WARM_UP * len(series.values))
    hours, values = np.array(series.at_s[begin:]) / 3600, np.array(series.values[begin:])
    if len(values) < 4:
        return None
    centred = hours - hours.mean()
    slope = float((centred * values).sum() / (centred**2).sum())
    rest = values - values.mean() - slope * centred
    error = float(np.sqrt((rest**2).sum() / (len(values) - 2) / (centred**2).sum()))
    return Trend(float(values.mean()), slope, error)


class Sampler:
    """Samples a service's process and its children, its database and its answers.

    Args:
        process: of the service.
        home: its folder.
        url: its address.
    """

    def __init__(self, process: psutil.Process, home: Path, url: str) -> None:
        self._process, self._home, self._url = process, home, url
        self._began = time.monotonic()
        self.series: dict[str, Series] = {}

    def sample(self) -> None:
        """One sample of everything."""
        now = time.monotonic() - self._began
        for name, value in self._measured().items():
            found = self.series.setdefault(name, Series())
            found.at_s.append(now)
            found.values.append(value)

    def _measured(self) -> dict[str, float]:
        own = self._process
        children = [child for child in own.children(recursive=True) if child.is_running()]
        return {
            "service: RSS, MiB": own.memory_info().rss / 2**20,
            "service: descriptors": own.num_fds(),
            "service: threads": own.num_threads(),
            "decoder processes: number": len(children),
            "decoder processes: RSS, MiB": sum(map(_rss, children)) / 2**20,
            "database, MiB": sum(map(_size, self._home.glob("impasto.db*"))) / 2**20,
            "blobs, MiB": folder_size(self._home / "blobs") / 2**20,
            "answer of /healthz on the event loop, ms": 1000 * self._answer_s("/healthz"),
            "answer of /v1/jobs, ms": 1000 * self._answer_s("/v1/jobs?limit=20"),
        }

    def _answer_s(self, path: str) -> float:
        """Median of five answers, s."""
        taken = []
        for _ in range(5):
            began = time.perf_counter()
            httpx.get(self._url + path, timeout=60).raise_for_status()
            taken.append(time.perf_counter() - began)
        return sorted(taken)[2]


def _rss(process: psutil.Process) -> int:
    try:
        return int(process.memory_info().rss)
    except psutil.Error:
        return 0


def _size(file: Path) -> int:
    try:
        return file.stat().st_size
    except OSError:  # deleted meanwhile
        return 0


def folder_size(folder: Path) -> int:
    """Bytes of all files of a folder from which others delete folders meanwhile; `Path.glob` would raise then."""
    return sum(_size(Path(place, name)) for place, _, names in os.walk(folder) for name in names)
