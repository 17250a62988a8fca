"""The cost of a job, written in the transaction that ends it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqlalchemy import Connection, delete, insert, select

from workers.contract.order import CPU
from workers.store import schema


def record_cost(connection: Connection, job: Mapping[str, Any], ended_at: float) -> None:
    """Write the cost of a job that ends in this transaction; of one that ended before and was retried, anew."""
    steps, table = schema.steps, schema.job_costs
    rows = connection.execute(select(steps.c.stages, steps.c.busy_s).where(steps.c.job_id == job["id"])).all()
    cpu_s = sum(float((row.stages or {}).get(CPU, 0.0)) for row in rows)
    connection.execute(delete(table).where(table.c.job_id == job["id"]))
    connection.execute(
        insert(table).values(
            job_id=job["id"], owner=job["owner"], labels=job["request"].get("labels") or {}, ended_at=ended_at,
            cpu_s=cpu_s, busy_s=sum(row.busy_s for row in rows),
        )
    )  # fmt: skip
