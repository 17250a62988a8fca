"""What jobs have cost: one row for each job that has ended, which outlives the job."""

from __future__ import annotations

from typing import Any

from sqlalchemy import delete, func, select, update

from workers.contract.owners import Cost
from workers.store import schema
from workers.store.base import StorePart

OWNER = "owner"
"""`by` of a sum over owners."""


class Costs(StorePart):
    """Costs of jobs that have ended."""

    def report(self, by: str = OWNER, since: float = 0.0, until: float | None = None) -> list[Cost]:
        """The costs of jobs that ended from `since` until before `until` (None: now), dearest first.

        Args:
            by: "owner", or the name of a label.
        """
        table = schema.job_costs
        column: Any = table.c.owner if by == OWNER else func.coalesce(table.c.labels[by].as_string(), "")
        name = column.label("name")
        sums = (func.coalesce(func.sum(each), 0) for each in (table.c.cpu_s, table.c.busy_s, table.c.bytes))
        query = select(name, func.count(), *sums).where(table.c.ended_at >= since).group_by("name")
        if until is not None:
            query = query.where(table.c.ended_at < until)
        with self._db.read() as connection:
            rows = connection.execute(query).all()
        found = [Cost(row[0], row[1], float(row[2]), float(row[3]), int(row[4])) for row in rows]
        return sorted(found, key=lambda cost: (-cost.cpu_s, -cost.busy_s, cost.name))

    def stored(self, job_id: str, size_bytes: int) -> None:
        """Note the size of a job's results."""
        table = schema.job_costs
        with self._db.write() as connection:
            connection.execute(update(table).where(table.c.job_id == job_id).values(bytes=size_bytes))

    def prune(self, age_s: float) -> int:
        """Delete the costs of jobs that ended longer ago; returns their number."""
        with self._db.write() as connection:
            table = schema.job_costs
            return connection.execute(delete(table).where(table.c.ended_at < self._now() - age_s)).rowcount
