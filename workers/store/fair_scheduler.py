"""Selects the job that is served next.

Jobs with a ready task are grouped in lanes, one per owner and priority. The highest priority is served first; within it
the owner with the fewest running tasks; of several, the one that has used the least slot time (`shares`); within a
lane the oldest job. So no owner waits for another owner's thousand jobs, with one slot as with many, and the jobs of an
owner run in the order of submission.

Steps without tasks are planned in turns, too: one job of each owner at a time.

The cost of a claim depends neither on the number of jobs nor of tasks: lanes are found by jumping through an index of
those jobs only, and running tasks are counted from running attempts, whose number is at most that of the workers.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import CTE, Connection, RowMapping, ScalarSelect, Select, bindparam, exists, func, or_, select, text

from workers.contract.record import TaskState
from workers.store import schema, shares
from workers.store.job_transaction import LONGEST_WAIT_S, RUNNING

RUNNING_TASKS = "running_tasks"
"""Quota of a key: maximum number of its running tasks."""


@dataclass(frozen=True)
class Lane:
    """The jobs of an owner that may start a task, of one priority."""

    priority: int
    owner: str
    oldest: str
    """Id of a job."""
    running: int
    """Tasks of the owner that run now."""
    most: int | None
    """Maximum number of running tasks of the owner."""
    used_s: float = 0.0
    """Slot time that the owner counts as having used, seconds."""

    @property
    def order(self) -> tuple[int, int, float, str]:
        return -self.priority, self.running, self.used_s, self.oldest


def lanes(connection: Connection, most: int | None = None) -> list[Lane]:
    """Lanes in the order in which they are served, without those at their limit.

    Args:
        most: maximum number of running tasks of an owner whose key has no limit of its own.
    """
    found = connection.execute(_LANES).all()
    running = _running(connection) if found else {}
    made = (
        Lane(row.priority, row.owner, row.id, running.get(row.owner, 0), (row.quotas or {}).get(RUNNING_TASKS, most),
             shares.counted_s(row.used_s, row.floor_s))
        for row in found
    )  # fmt: skip
    return sorted((lane for lane in made if lane.most is None or lane.running < lane.most), key=lambda lane: lane.order)


def job_in(
    connection: Connection, lane: Lane, now: float, wait: bool, skipped: Collection[str] = ()
) -> RowMapping | None:
    """The lane's next job with a task that is due, under lock.

    Args:
        wait: whether to wait for the lock of a job that another dispatcher has locked, instead of skipping the job.
        skipped: ids of jobs that are passed over.
    """
    values: dict[str, Any] = {"priority": lane.priority, "owner": lane.owner, **moment(now)}
    if not skipped:
        return connection.execute(_JOB_IN[wait], values).mappings().first()
    query = _JOB_IN[wait].where(schema.jobs.c.id.not_in(list(skipped)))
    return connection.execute(query, values).mappings().first()


def unplanned_lanes(connection: Connection, after: str, most: int) -> list[tuple[int, str]]:
    """Priority and owner of at most `most` lanes of jobs whose step has no tasks yet, in the order in which they are
    planned: the highest priority first; within it one owner after another, beginning after the owner `after`."""
    found = [(row.priority, row.owner) for row in connection.execute(_UNPLANNED_LANES)]
    return sorted(found, key=lambda lane: (-lane[0], lane[1] <= after, lane[1]))[:most]


def due() -> tuple[Any, ...]:
    """Conditions of a task that may run at `moment`."""
    tasks = schema.tasks
    in_time = or_(tasks.c.ready_at <= bindparam("now"), tasks.c.ready_at > bindparam("too_late"))
    return tasks.c.state == TaskState.READY.value, in_time


def moment(now: float) -> dict[str, float]:
    """Parameters of the query `due`."""
    return {"now": now, "too_late": now + LONGEST_WAIT_S}


def _job_in(wait: bool) -> Select[Any]:
    jobs = schema.jobs
    return (
        select(jobs)
        .where(text("jobs.ready > 0"), jobs.c.priority == bindparam("priority"), jobs.c.owner == bindparam("owner"))
        .where(exists().where(schema.tasks.c.job_id == jobs.c.id, *due()))
        .order_by(jobs.c.id)
        .limit(1)
        .with_for_update(skip_locked=not wait)
    )


def _lanes() -> Select[Any]:
    """Priority, owner, oldest job, quotas and slot time of every lane. Jumps through the index from lane to lane and
    reads only the first row of each."""
    heads, jobs, owners, used = _heads(_is_ready), schema.jobs, schema.owners, schema.shares
    columns = (jobs.c.priority, jobs.c.owner, jobs.c.id, owners.c.quotas, used.c.used_s, shares.FLOOR.label("floor_s"))
    lanes = select(*columns).join(heads, heads.c.id == jobs.c.id)
    return lanes.outerjoin(owners, owners.c.id == jobs.c.owner).outerjoin(used, used.c.owner == jobs.c.owner)


def _unplanned() -> Select[Any]:
    """Priority and owner of every lane of jobs whose step has no tasks yet."""
    heads, jobs = _heads(_is_unplanned), schema.jobs
    return select(jobs.c.priority, jobs.c.owner).join(heads, heads.c.id == jobs.c.id)


Condition = Callable[[Any, str], Sequence[Any]]
"""Function: an alias of the table of jobs, its name -> the conditions of a partial index."""


def _is_ready(_jobs: Any, name: str) -> Sequence[Any]:
    return (text(f"{name}.ready > 0"),)


def _is_unplanned(jobs: Any, name: str) -> Sequence[Any]:
    return ~jobs.c.planned, text(f"{name}.{schema.ACTIVE_TEXT}")


def _heads(condition: Condition) -> CTE:
    """Ids of the oldest job of every lane of jobs with this condition. A hop is one or two look-ups, because SQLite
    cannot seek a pair of columns at once."""
    first = select(_first(condition, "start").label("id")).cte("heads", recursive=True)
    at = schema.jobs.alias("at")
    later = func.coalesce(_first(condition, "sideways", at, same_priority=True), _first(condition, "upwards", at))
    return first.union_all(select(later).select_from(first.join(at, at.c.id == first.c.id)))


def _first(condition: Condition, name: str, at: Any = None, same_priority: bool = False) -> ScalarSelect[Any]:
    """The oldest job of the next lane: of the priority of the job `at`, or of the next higher one; without `at`, of the
    first lane there is."""
    then = schema.jobs.alias(name)
    query = select(then.c.id).where(*condition(then, name))
    if same_priority:
        query = query.where(then.c.priority == at.c.priority, then.c.owner > at.c.owner).correlate(at)
    elif at is not None:
        query = query.where(then.c.priority > at.c.priority).correlate(at)
    return query.order_by(then.c.priority, then.c.owner, then.c.id).limit(1).scalar_subquery()


def _running(connection: Connection) -> dict[str, int]:
    """Running tasks by owner."""
    return {owner: int(n) for owner, n in connection.execute(_RUNNING)}


# Built once, because building a statement takes longer than running it.
_LANES = _lanes()
_UNPLANNED_LANES = _unplanned()
_JOB_IN = {wait: _job_in(wait) for wait in (False, True)}
_RUNNING = (
    select(schema.jobs.c.owner, func.count())
    .join(schema.attempts, schema.attempts.c.job_id == schema.jobs.c.id)
    .where(schema.attempts.c.outcome == RUNNING)
    .group_by(schema.jobs.c.owner)
)
