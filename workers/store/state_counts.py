"""Jobs and tasks by state, counted as they change: a sum over `SHARDS` rows instead of a scan of all jobs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from typing import Any
from zlib import crc32

from sqlalchemy import Connection, func, select

from workers.contract.record import RunState, TaskState
from workers.store import schema

SHARDS = 16
_COUNTS = [column.name for column in schema.tallies.columns if column.name != "shard"]
_SUMS = select(*(func.coalesce(func.sum(schema.tallies.c[name]), 0).label(name) for name in _COUNTS))


class CountChanges:
    """Changes of the counts by one transaction."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def job(self, state: str, number: int) -> None:
        """Add `number` jobs in this state; negative: fewer."""
        self._counts[f"jobs_{state}"] += number

    def tasks(self, state: str, number: int) -> None:
        """Add `number` tasks in this state; negative: fewer."""
        self._counts[f"tasks_{state}"] += number

    def startable(self, number: int) -> None:
        """Add `number` ready tasks of jobs that may start tasks; negative: fewer."""
        self._counts["startable"] += number

    def add(self, other: CountChanges) -> None:
        """Add the changes of another job of the same transaction."""
        self._counts.update(other._counts)

    def write(self, connection: Connection, job_id: str) -> None:
        """Add the changes to the row of this job's shard; no effect if there are none."""
        if any(self._counts.values()):
            values = {name: self._counts[name] for name in _COUNTS}
            connection.execute(_addition(connection.dialect.name), {"shard": crc32(job_id.encode()) % SHARDS, **values})
            self._counts.clear()


@cache
def _addition(dialect: str) -> Any:
    """The statement that adds to a shard's row, or inserts it."""
    added = import_module(f"sqlalchemy.dialects.{dialect}").insert(schema.tallies)
    sums = {name: schema.tallies.c[name] + added.excluded[name] for name in _COUNTS}
    return added.on_conflict_do_update(index_elements=["shard"], set_=sums)


def jobs_by_state(counts: Mapping[str, int]) -> dict[str, int]:
    return {state.value: counts[f"jobs_{state.value}"] for state in RunState}


def tasks_by_state(counts: Mapping[str, int]) -> dict[str, int]:
    return {state.value: counts[f"tasks_{state.value}"] for state in TaskState}


def read(connection: Connection) -> dict[str, int]:
    """All counts, by column of `tallies`."""
    return {name: int(number) for name, number in connection.execute(_SUMS).mappings().one().items()}
