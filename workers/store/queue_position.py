"""Jobs that are served before a queued one: counted by indexes, up to a limit, so that the cost has a bound."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, text

from workers.store import schema
from workers.store.records import Row

MOST = 1000
"""Maximum number of jobs that are counted."""
_ACTIVE = f"jobs.{schema.ACTIVE_TEXT}"
_AHEAD = text(
    f"""
    WITH RECURSIVE
    own(id, method) AS (
        SELECT id, method FROM jobs
        WHERE {_ACTIVE} AND priority = :priority AND owner = :owner AND id < :id LIMIT :most
    ),
    urgent(id, method) AS (SELECT id, method FROM jobs WHERE {_ACTIVE} AND priority > :priority LIMIT :most),
    owners(owner) AS (
        SELECT min(owner) FROM jobs WHERE {_ACTIVE} AND priority = :priority
        UNION ALL
        SELECT (SELECT min(jobs.owner) FROM jobs
                WHERE {_ACTIVE} AND priority = :priority AND jobs.owner > owners.owner)
        FROM owners WHERE owner IS NOT NULL
    ),
    rivals(owner, last_id) AS (
        SELECT owner, (SELECT id FROM jobs WHERE {_ACTIVE} AND priority = :priority AND jobs.owner = owners.owner
                       ORDER BY id LIMIT 1 OFFSET (SELECT count(*) FROM own))
        FROM owners WHERE owner <> :owner LIMIT :most
    ),
    turns(id, method) AS (
        SELECT jobs.id, jobs.method FROM rivals JOIN jobs ON jobs.owner = rivals.owner
        WHERE {_ACTIVE} AND jobs.priority = :priority AND (rivals.last_id IS NULL OR jobs.id <= rivals.last_id)
        LIMIT :most
    ),
    ahead(id, method) AS (
        SELECT id, method FROM urgent UNION ALL SELECT id, method FROM own UNION ALL SELECT id, method FROM turns
        LIMIT :most
    )
    SELECT ahead.id, ahead.method,
        sum(CASE WHEN steps.weight > 0 THEN steps.weight ELSE steps.expected END) AS weight,
        sum(CASE WHEN steps.weight > 0 THEN steps.weight - steps.weight_done ELSE steps.expected END) AS weight_left
    FROM ahead JOIN steps ON steps.job_id = ahead.id GROUP BY ahead.id, ahead.method ORDER BY ahead.id
    """  # noqa: S608 - the only insertion is a constant condition, which partial indexes need literally
)


@dataclass(frozen=True)
class MethodAhead:
    """The jobs of one method that are served before a job."""

    oldest: str
    """Id of one of them."""
    jobs: int
    left: float
    """Weight of all their unfinished tasks, in multiples of the whole weight of the oldest; see `progress`."""


def ahead(connection: Connection, job: Row) -> list[MethodAhead]:
    """Jobs that are served before a queued one, by method; together at most `MOST` + 1.

    These are all active jobs of higher priority, the owner's earlier jobs, and as many jobs of each other owner, plus
    one, because owners take turns.
    """
    values = {"id": job["id"], "priority": job["priority"], "owner": job["owner"], "most": MOST + 1}
    found: dict[str, list[Any]] = defaultdict(list)
    for row in connection.execute(_AHEAD, values):
        found[row.method].append(row)
    return [_summed(rows) for rows in found.values()]


def _summed(rows: Sequence[Any]) -> MethodAhead:
    left = sum(max(0.0, row.weight_left) for row in rows)
    return MethodAhead(rows[0].id, len(rows), left / rows[0].weight if rows[0].weight > 0 else float(len(rows)))
