"""A store with many jobs, projects and assets, inserted row by row without the program that would make them."""

from __future__ import annotations

import hashlib
import io
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

from sqlalchemy import Connection, func, insert, select, text

from workers.blobs.base import Blobs
from workers.contract.record import RunState, TaskState, asset_key
from workers.store import Store, schema

OWNERS = 20
"""Further owners, who share a twentieth of all jobs. One owner has a few jobs, and anna has the rest."""
FEW = 5
STEPS = ("scan", "paint", "assemble")
ZIP = "application/zip"
BEGAN = 1_700_000_000.0
MOVIE = b"movie"
ASSET = f"ast_{hashlib.sha256(MOVIE).hexdigest()}"
Rows = Iterable[dict[str, Any]]


@dataclass(frozen=True)
class Size:
    """Numbers of jobs, projects and assets of a store."""

    jobs: int
    projects: int = 0
    assets: int = 0


@dataclass(frozen=True)
class Owners:
    """Ids of the keys of the owner of most things, and of one with a few."""

    anna: str
    cleo: str


def fill(store: Store, blobs: Blobs, owners: Owners, size: Size) -> None:
    """Insert everything. The oldest three fifths of the jobs have succeeded, a hundredth runs, the others wait, half
    of them without a plan. None has failed. The oldest job's files exist."""
    with store.database.write() as connection:
        _insert(connection, schema.assets, map(_asset, range(max(1, size.assets))))
        _insert(connection, schema.asset_owners, (_asset_owner(owners, i) for i in range(max(1, size.assets))))
        _insert(connection, schema.asset_owners, [_asset_owner(owners, 0) | {"owner": owners.cleo}])
        for table, rows in _tables(owners, size.jobs).items():
            _insert(connection, schema.metadata.tables[table], rows)
        _insert(connection, schema.projects, (_project(owners, i) for i in range(size.projects)))
        _insert(connection, schema.project_versions, map(_version, range(size.projects)))
        if size.projects:
            _insert(connection, schema.project_jobs, [_project_job()])
        if "tallies" in schema.metadata.tables:
            connection.execute(insert(schema.metadata.tables["tallies"]).values(shard=0, **_counts(connection)))
    if not store.database.is_sqlite:
        with store.database.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            connection.execute(text("ANALYZE"))
    blobs.put("jobs/result", _archive())
    for name in ("poster", "sheet", "preview"):
        blobs.put(f"jobs/{name}", b"picture")
    blobs.put(asset_key(ASSET), MOVIE)


def job_id(number: int) -> str:
    return f"job_{number:026d}"


def project_id(number: int) -> str:
    return f"prj_{number:026d}"


def state_of(number: int, jobs: int) -> RunState:
    if number < 0.6 * jobs or number == 0:
        return RunState.SUCCEEDED
    return RunState.RUNNING if number < 0.61 * jobs else RunState.QUEUED


def _is_planned(number: int, jobs: int) -> bool:
    return state_of(number, jobs) is not RunState.QUEUED or number % 2 == 0


def _owner(owners: Owners, number: int) -> str:
    if number % 20 == 19:
        return f"owner-{number % OWNERS:02d}-{number // 20 % OWNERS:02d}"
    return owners.cleo if number in range(2, 2 + FEW) else owners.anna


def _insert(connection: Connection, table: Any, rows: Rows) -> None:
    left = iter(rows)
    while some := list(islice(left, 5000)):
        connection.execute(insert(table), some)


def _asset_id(number: int) -> str:
    """The first asset is the one that jobs and projects use; only its bytes are stored."""
    return f"ast_{number:064x}" if number else ASSET


def _asset(number: int) -> dict[str, Any]:
    sha = _asset_id(number).removeprefix("ast_")
    info = {"width": 64, "height": 36, "frames": 48, "fps": 24.0, "duration_s": 2.0}
    return {
        "id": f"ast_{sha}", "sha256": sha, "size_bytes": 5, "filename": f"clip-{number}.mp4", "media_type": "video/mp4",
        "kind": "video", "info": info, "created_at": BEGAN + number, "owner": "",
    }  # fmt: skip


def _asset_owner(owners: Owners, number: int) -> dict[str, Any]:
    named = {"asset_id": _asset_id(number), "filename": f"clip-{number}.mp4", "created_at": BEGAN + number}
    return {"owner": owners.anna, **named}


def _tables(owners: Owners, jobs: int) -> dict[str, Rows]:
    numbers = range(jobs)
    planned = [i for i in numbers if _is_planned(i, jobs)]
    return {
        "jobs": (_job(owners, i, jobs) for i in numbers),
        "job_inputs": ({"job_id": job_id(i), "name": "video", "asset_id": ASSET} for i in numbers),
        "job_labels": ({"job_id": job_id(i), "name": "shot", "value": str(i % 50)} for i in numbers),
        "steps": (row for i in numbers for row in _steps(i, jobs)),
        "events": (_event(i, jobs) for i in numbers),
        "tasks": (_task(i, jobs) for i in planned),
        "attempts": (_attempt(i, jobs) for i in planned if state_of(i, jobs) is not RunState.QUEUED),
        "files": _files(jobs),
    }


def _job(owners: Owners, number: int, jobs: int) -> dict[str, Any]:
    state, at = state_of(number, jobs), BEGAN + number
    done = state is RunState.SUCCEEDED
    request = {
        "method": "multistyle", "inputs": {"video": ASSET}, "params": {}, "seed": number, "frames": None,
        "output": {"format": "mp4", "quality": 20, "artefacts": [], "report": False}, "priority": 0,
        "name": f"shot {number}", "labels": {"shot": str(number % 50)}, "webhook": "", "on_damage": "warn",
    }  # fmt: skip
    return {
        "id": job_id(number), "owner": _owner(owners, number), "method": "multistyle", "state": state.value,
        "priority": 0, "request": request, "params": {}, "step": 2 if done else 0, "step_count": 3,
        "planned": _is_planned(number, jobs), "doomed": False,
        "ready": int(state is RunState.QUEUED and number % 2 == 0), "last_seq": 1, "idempotency_key": None,
        "digest": "d", "created_at": at, "updated_at": at, "started_at": at if state is not RunState.QUEUED else None,
        "finished_at": at + 9 if done else None,
    }  # fmt: skip


def _steps(number: int, jobs: int) -> Iterator[dict[str, Any]]:
    state = state_of(number, jobs)
    for step, name in enumerate(STEPS):
        first = step == 0 and _is_planned(number, jobs)
        counts = dict.fromkeys((each.value for each in TaskState), 0)
        if first:
            counts[_task_state(state).value] = 1
        done = state is RunState.SUCCEEDED
        yield {
            "job_id": job_id(number), "step": step, "name": name, "title": name, **counts, "expected": 1.0,
            "weight": 1.0 if first or done else 0.0, "weight_done": 1.0 if done else 0.0, "busy_s": 3.0 * done,
            "stages": {},
        }  # fmt: skip


def _task_state(state: RunState) -> TaskState:
    states = {RunState.SUCCEEDED: TaskState.SUCCEEDED, RunState.RUNNING: TaskState.RUNNING}
    return states.get(state, TaskState.READY)


def _event(number: int, jobs: int) -> dict[str, Any]:
    data = {"state": state_of(number, jobs).value, "error": None}
    return {"job_id": job_id(number), "seq": 1, "at": BEGAN + number, "type": "job.state", "data": data}


def _task(number: int, jobs: int) -> dict[str, Any]:
    state = _task_state(state_of(number, jobs))
    return {
        "id": f"tsk_{number:026d}", "job_id": job_id(number), "step": 0, "position": 1, "key": "t", "args": {},
        "weight": 1.0, "chained": False, "state": state.value, "blockers": 0, "failures": 0, "interruptions": 0,
        "ready_at": 0.0, "progress": float(state is TaskState.SUCCEEDED), "reused": False,
        "attempt_id": f"att_{number:026d}" if state is TaskState.RUNNING else None,
    }  # fmt: skip


def _attempt(number: int, jobs: int) -> dict[str, Any]:
    running = state_of(number, jobs) is RunState.RUNNING
    return {
        "id": f"att_{number:026d}", "task_id": f"tsk_{number:026d}", "job_id": job_id(number), "number": 1,
        "dispatcher": "dsp_1", "worker": "w", "outcome": "running" if running else "succeeded", "log": "done",
        "started_at": BEGAN + number, "finished_at": None if running else BEGAN + number + 9,
    }  # fmt: skip


def _files(jobs: int) -> Iterator[dict[str, Any]]:
    for number in range(jobs):
        if state_of(number, jobs) is RunState.SUCCEEDED:
            yield _file(number, "result", ZIP)
    for name in ("poster", "sheet", "preview"):
        yield _file(0, name, "image/jpeg")


def _file(number: int, name: str, media_type: str) -> dict[str, Any]:
    row = {"key": f"jobs/{name}", "media_type": media_type, "created_at": BEGAN}
    return {"job_id": job_id(number), "name": name, **row}


def _archive() -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        archive.writestr("0000.png", b"picture")
    return made.getvalue()


def _project(owners: Owners, number: int) -> dict[str, Any]:
    return {
        "id": project_id(number), "owner": owners.anna, "name": f"film {number}", "version": 1,
        "created_at": BEGAN + number, "updated_at": BEGAN + number, "deleted_at": None, "share_epoch": 0,
    }  # fmt: skip


def _version(number: int) -> dict[str, Any]:
    document = (
        f'{{"schema":1,"name":"film {number}","assets":{{"clip":{{"id":"{ASSET}"}}}},'
        '"shots":[{"id":"s1","video":"clip","layers":[{"id":"l1","method":"multistyle"}]}]}'
    ).encode()
    return {
        "project_id": project_id(number), "version": 1, "at": BEGAN + number, "author": "", "label": "",
        "size_bytes": len(document), "body": zlib.compress(document), "thinned": False,
    }  # fmt: skip


def _project_job() -> dict[str, Any]:
    return {"project_id": project_id(0), "job_id": job_id(0), "shot": "s1", "variant": None, "version": 1, "at": BEGAN}


def _counts(connection: Connection) -> dict[str, int]:
    jobs, steps = schema.jobs, schema.steps
    by_state = dict(connection.execute(select(jobs.c.state, func.count()).group_by(jobs.c.state)).tuples().all())
    tasks = connection.execute(select(*(func.coalesce(func.sum(steps.c[each.value]), 0) for each in TaskState))).one()
    found = {f"jobs_{each.value}": int(by_state.get(each.value, 0)) for each in RunState}
    found |= {f"tasks_{each.value}": int(count) for each, count in zip(TaskState, tasks, strict=True)}
    return found | {"startable": int(connection.execute(select(func.coalesce(func.sum(jobs.c.ready), 0))).scalar_one())}
