"""/v1/ops/machine: processors, memory and disks of the machine that answers, now and over the last hour."""

from __future__ import annotations

import shutil
import socket
from dataclasses import dataclass

import psutil

from pipeline.kernels.processors import usable_processors
from service.context.depends import Admin, Context
from service.context.load_history import LoadSample
from service.ops.machine import existing, work_places
from service.routing import Router

router = Router(prefix="/v1/ops", tags=["ops"])


@dataclass(frozen=True)
class DiskOut:
    """A disk that holds work."""

    place: str
    """"home", "blobs" or "scratch"."""
    free_bytes: int
    size_bytes: int


@dataclass(frozen=True)
class MachineOut:
    """The machine of the process that answers."""

    host: str
    cpus: int
    """Processors that the process may use."""
    memory_bytes: int
    disks: tuple[DiskOut, ...]
    samples: tuple[LoadSample, ...]
    """Oldest first, one every ten seconds, at most an hour."""


@router.get("/machine")
def get_machine(context: Context, _caller: Admin) -> MachineOut:
    """Load of the machine that answers: processors, memory and disks. Behind a balancer, that is one of several."""
    disks = []
    for place, path in work_places(context.settings).items():
        usage = shutil.disk_usage(existing(path))
        disks.append(DiskOut(place, usage.free, usage.total))
    memory = psutil.virtual_memory().total
    return MachineOut(socket.gethostname(), usable_processors(), memory, tuple(disks), context.load.samples)
