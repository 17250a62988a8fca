"""Cost of claiming a task and recording its outcome, by number of jobs and tasks, in SQLite and in a real PostgreSQL.

The table shows medians of `ROUNDS` in milliseconds: wall time, and CPU time of this process (without PostgreSQL's own).
Then it shows the time to plan, show, list and cancel the largest job.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sqlalchemy import insert, select

from pipeline.methods.base import Task
from workers.contract.order import TaskOutcome
from workers.contract.record import Asset
from workers.contract.request import JobRequest
from workers.ids import new_id
from workers.jobs import state_machine as machine
from workers.store import Accepted, Store, schema

SIZES = ((10, 100), (1_000, 10_000), (10_000, 100_000))
"""(queued jobs of 50 owners, tasks of one more job)"""
ROUNDS = 100
_STEPS = (("draw", "Draw"), ("assemble", "Join"))
_ASSET = "a" * 64


def main() -> None:
    """Print a table for each database."""
    with tempfile.TemporaryDirectory(prefix="impasto-dispatch-") as folder:
        _table("SQLite", lambda size: f"sqlite:///{Path(folder) / f'{size[1]}.db'}")
    from tests.real.postgres import Postgres, missing

    if reason := missing():
        print(f"no PostgreSQL: {reason}")
        return
    server = Postgres()
    server.start()
    try:
        _table("PostgreSQL", lambda size: server.fresh())
    finally:
        server.close()


def _table(name: str, url: Callable[[tuple[int, int]], str]) -> None:
    print(f"{name}: ms, wall (CPU)")
    print("   jobs   tasks         claim        answer    plan  show  list  cancel")
    for size in SIZES:
        print(_row(url(size), *size))


def _row(url: str, jobs: int, tasks: int) -> str:
    store = Store(url)
    _queue(store, jobs)
    big = _submit(store, priority=1)
    planned = _timed(lambda: _plan(store, big, tasks))[0]
    claims, answers = [], []
    for _ in range(min(ROUNDS, tasks)):
        wall, cpu, claim = _timed(lambda: store.queue.claim("bench", 600))
        claims.append((wall, cpu))
        outcome = TaskOutcome(claim.attempt_id, {}, {}, {}, None, {"method": 1.0}, "log")
        wall, cpu, _ = _timed(lambda outcome=outcome: store.queue.finish(outcome))  # type: ignore[misc]
        answers.append((wall, cpu))
    shown = _timed(lambda: store.jobs.get(big))[0]
    listed = _timed(lambda: store.jobs.page(limit=50))[0]
    cancelled = _timed(lambda: store.jobs.command(big, machine.Cancel()))[0]
    store.close()
    rest = f"{planned:8.0f}{shown:6.1f}{listed:6.1f}{cancelled:8.0f}"
    return f"{jobs:7d}{tasks:8d}  {_median(claims)}  {_median(answers)}{rest}"


def _median(measured: list[tuple[float, float]]) -> str:
    wall, cpu = (statistics.median(column) for column in zip(*measured, strict=True))
    return f"{wall:5.2f} ({cpu:4.2f})"


def _timed(act: Callable[[], Any]) -> tuple[float, float, Any]:
    wall, cpu = time.perf_counter(), time.process_time()
    answer = act()
    return 1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - cpu), answer


def _submit(store: Store, priority: int = 0) -> str:
    asset = Asset(f"ast_{_ASSET}", _ASSET, 10, "cat.mp4", "video/mp4", "video", {}, 1.0, "owner")
    store.assets.add(asset, lambda: True)
    request = JobRequest("toy", {"video": asset.id}, priority=priority)
    return store.jobs.add(Accepted(request, {}, _STEPS), "owner").id


def _plan(store: Store, job_id: str, tasks: int) -> None:
    assert store.plans.planned(job_id, 0, [Task(f"t-{i}") for i in range(tasks)])


def _queue(store: Store, jobs: int) -> None:
    """Add queued jobs with one ready task each. The store creates the first; the others are copies of its rows."""
    first = _submit(store)
    _plan(store, first, 1)
    ids = [new_id("job_") for _ in range(jobs - 1)]
    with store.database.write() as connection:
        for table in (schema.jobs, schema.steps, schema.tasks):
            key = table.c.id if table is schema.jobs else table.c.job_id
            rows = connection.execute(select(table).where(key == first)).mappings().all()
            copies = [_copy(dict(row), table.name, job_id, i) for i, job_id in enumerate(ids) for row in rows]
            connection.execute(insert(table), copies)


def _copy(row: dict[str, Any], table: str, job_id: str, number: int) -> dict[str, Any]:
    if table == "jobs":
        return {**row, "id": job_id, "owner": f"owner-{number % 50}"}
    return {**row, "job_id": job_id, **({"id": new_id("tsk_")} if table == "tasks" else {})}


if __name__ == "__main__":
    main()
