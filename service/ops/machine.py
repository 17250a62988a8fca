"""Metrics of the service's machine: disks, process, version."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

from prometheus_client import CollectorRegistry, Gauge, ProcessCollector
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector

from service.settings import Settings
from workers.version import version


def add_machine(registry: CollectorRegistry, settings: Settings) -> None:
    """Register metrics of this process and its disks."""
    ProcessCollector(registry=registry)
    Gauge("impasto_build_info", "1, with the version.", ("version",), registry=registry).labels(version()).set(1)
    registry.register(DiskMetrics(settings))


class DiskMetrics(Collector):
    """Free and total bytes of the disks that hold work."""

    def __init__(self, settings: Settings) -> None:
        self._places = work_places(settings)
        self._reserve = settings.reserve_bytes

    def describe(self) -> Iterable[Metric]:
        """Return no metrics at registration, because a disk may be slow to answer."""
        return ()

    def collect(self) -> Iterator[Metric]:
        free = GaugeMetricFamily("impasto_disk_free_bytes", "Free for us where things are kept.", labels=["place"])
        size = GaugeMetricFamily("impasto_disk_size_bytes", "Of the whole disk.", labels=["place"])
        for place, path in self._places.items():
            usage = shutil.disk_usage(existing(path))
            free.add_metric([place], usage.free)
            size.add_metric([place], usage.total)
        yield free
        yield size
        text = "New work is refused while less is free for blobs."
        yield GaugeMetricFamily("impasto_disk_reserve_bytes", text, value=float(self._reserve))


def work_places(settings: Settings) -> dict[str, Path]:
    """Folders that hold work, by what they hold."""
    blobs = settings.copies_at if settings.blob_url else settings.blobs_at
    return {"home": settings.home.absolute(), "blobs": blobs, "scratch": settings.scratch}


def existing(path: Path) -> Path:
    """`path` or its nearest existing parent, because folders are created on demand."""
    while not path.exists() and path != path.parent:
        path = path.parent
    return path
