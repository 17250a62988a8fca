"""Compares the resources of a task with those of workers and machines. Pure functions without access to a cluster."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from pipeline.methods.base import Resources
from workers.settings import FarmSettings

_LEAST_BYTES = 512 << 20
"""Smallest amount of memory that is reserved; larger amounts are doubled from it, so that a worker suits many tasks."""


@dataclass(frozen=True)
class Capacity:
    """Processors, GPUs and memory of a machine, or a part of it."""

    cpus: float
    gpus: float
    memory_bytes: int

    def covers(self, other: Capacity) -> bool:
        """Whether every demand that fits into `other` fits into this capacity."""
        return self.cpus >= other.cpus and self.gpus >= other.gpus and self.memory_bytes >= other.memory_bytes

    def __str__(self) -> str:
        gpus = f", {self.gpus:g} GPU" if self.gpus else ""
        memory = f", {self.memory_bytes >> 20} MiB" if self.memory_bytes else ""
        return f"{self.cpus:g} CPU{gpus}{memory}"


def default_capacity(settings: FarmSettings) -> Capacity:
    """Capacity of an idle worker. It has no GPU, which would be unused or unavailable to others."""
    return Capacity(settings.task_cpus, 0.0, settings.task_memory_bytes)


def capacity_for(resources: Resources | None, settings: FarmSettings) -> Capacity:
    """Capacity for a task: its declared resources, otherwise the farm's settings. Memory is rounded up, to at least
    the farm's value for every task."""
    given = resources or Resources()
    return Capacity(
        settings.task_cpus if given.cpus is None else given.cpus,
        settings.task_gpus if given.gpus is None else given.gpus,
        max(settings.task_memory_bytes, _rounded(given.memory_bytes)),
    )


def _rounded(size: int) -> int:
    """The smallest reservable amount of memory that is at least this large; 0 for 0."""
    if size <= 0:
        return 0
    given = _LEAST_BYTES
    while given < size:
        given *= 2
    return given


Machines = Iterable[tuple[str, Capacity]]
"""Machines by name with their total capacity. Names may repeat."""


def machines_with(wanted: Capacity, machines: Machines) -> set[str]:
    """Names of the machines that have this capacity."""
    return {name for name, machine in machines if machine.covers(wanted)}


def has_capacity(wanted: Capacity, machines: Machines, taken: Iterable[tuple[str, Capacity]]) -> bool:
    """Whether a machine has this capacity left. `taken`: (name of a machine, capacity in use)."""
    parts = list(taken)
    return any(
        _remaining(machine, [part for at, part in parts if at == name]).covers(wanted) for name, machine in machines
    )


def _remaining(machine: Capacity, taken: Iterable[Capacity]) -> Capacity:
    cpus, gpus, memory_bytes = machine.cpus, machine.gpus, machine.memory_bytes
    for part in taken:
        cpus, gpus, memory_bytes = cpus - part.cpus, gpus - part.gpus, memory_bytes - part.memory_bytes
    return Capacity(cpus, gpus, memory_bytes)


def shortage(wanted: Capacity, machines: Machines) -> str:
    """Message for users: the resources that no machine has, and the largest available."""
    there = "; ".join(sorted(f"{name}: {machine}" for name, machine in machines)) or "there are none"
    return f"No machine of the cluster has {wanted} ({there})"
