"""A whole farm over real PostgreSQL and real S3: several processes, faults, backup and restore."""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import make_url

from pipeline.errors import StorageError
from tests.real.postgres import Postgres
from tests.real.swift import Swift
from tests.workers.conftest import finished, request_on, result, until
from tests.workers.real_farm import Worker, real_settings
from tests.workers.toy import ToyRunner
from workers.blobs.opened import open_blobs
from workers.local_pool import LocalPool
from workers.model import Job
from workers.settings import FarmSettings
from workers.studio import Studio
from workers.tidy import Swept, Tidier

SHAPES: list[dict[str, Any]] = [
    {"tasks": 10, "chain": True, "sleep_s": 0.05},
    {"tasks": 16, "sleep_s": 0.1},
    {"tasks": 8, "chain": True, "sleep_s": 0.1},
]


@pytest.fixture
def real(postgres: Postgres, s3: Swift, tmp_path: Path) -> FarmSettings:
    return real_settings(postgres, s3, tmp_path / "home")


@pytest.fixture
def opened() -> Iterator[Callable[..., Studio]]:
    """Opens farms, working ones unless told otherwise; stops them at the end."""
    farms: list[Studio] = []

    def open_one(settings: FarmSettings, works: bool = True) -> Studio:
        blobs = open_blobs(settings)
        pool = LocalPool(lambda: ToyRunner(blobs), settings.workers) if works else None
        farms.append(Studio(settings, pool))
        farms[-1].start()
        return farms[-1]

    yield open_one
    for farm in farms:
        farm.stop()


@pytest.fixture
def expected(open_studio: Callable[..., Studio], data: Path) -> list[bytes]:
    """What undisturbed jobs of these shapes make, on disk and SQLite."""
    farm = open_studio()
    jobs = [farm.submit(request_on(farm, data, params={**shape, "sleep_s": 0.0})) for shape in SHAPES]
    return [result(farm, finished(farm, job.id).id) for job in jobs]


def _submit(farm: Studio, data: Path) -> list[str]:
    return [farm.submit(request_on(farm, data, params=shape)).id for shape in SHAPES]


def _ended(farm: Studio, job_id: str, timeout_s: float = 90.0) -> Job:
    """The job once it is final, however often the store is away meanwhile."""
    deadline = time.monotonic() + timeout_s
    while True:
        try:
            if (job := farm.job(job_id)).state.final:
                return job
        except StorageError:
            pass
        assert time.monotonic() < deadline, "the job did not end"
        time.sleep(0.1)


def test_two_farms_share_the_work_and_the_bytes_are_those_of_one(
    real: FarmSettings, opened: Callable[..., Studio], data: Path, tmp_path: Path, expected: list[bytes]
) -> None:
    asking = opened(real, works=False)
    jobs = _submit(asking, data)
    for name in ("one", "two"):
        opened(real.model_copy(update={"home": tmp_path / name}))
    assert [result(asking, _ended(asking, job).id) for job in jobs] == expected
    found = [attempt for job in jobs for task in asking.tasks(job).items for attempt in task.attempts]
    assert {attempt["outcome"] for attempt in found} == {"succeeded"}
    with asking._store._db.read() as connection:
        doers = set(connection.exec_driver_sql("SELECT DISTINCT dispatcher FROM attempts").scalars())
    assert len(doers) == 2, "both have worked"


def test_faults_of_every_part_lose_nothing(
    real: FarmSettings,
    opened: Callable[..., Studio],
    data: Path,
    tmp_path: Path,
    expected: list[bytes],
    postgres: Postgres,
    s3: Swift,
) -> None:
    """Seeded: workers killed and frozen beyond their lease, PostgreSQL crashed, S3's object server stopped."""
    asking, chance = opened(real, works=False), random.Random(7)
    jobs = _submit(asking, data)
    workers = [Worker(real, tmp_path / name) for name in ("one", "two")]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.wait_up()

    def kill_worker() -> None:
        chosen = chance.choice(workers)
        chosen.kill()
        chosen.start()

    def freeze_worker() -> None:
        chosen = chance.choice(workers)
        chosen.freeze()
        time.sleep(real.lease_s + 1)
        chosen.thaw()

    def crash_postgres() -> None:
        postgres.stop(signal.SIGQUIT)
        time.sleep(chance.uniform(0.5, 2))
        postgres.start()

    def stop_s3() -> None:
        s3.stop("object")
        time.sleep(chance.uniform(0.5, 2))
        s3.start("object")

    faults = [kill_worker, freeze_worker, crash_postgres, stop_s3]
    chance.shuffle(faults)
    try:
        for fault in faults:
            time.sleep(chance.uniform(0.1, 0.4))
            fault()
        ended = [_ended(asking, job) for job in jobs]
    finally:
        for worker in workers:
            worker.thaw()
            worker.kill()
    assert [(job.state, job.error) for job in ended] == [("succeeded", None)] * 3
    assert [result(asking, job.id) for job in ended] == expected
    tasks = [task for job in jobs for task in asking.tasks(job).items]
    assert all([a["outcome"] for a in task.attempts].count("succeeded") == 1 for task in tasks)
    _tidier(asking).sweep()
    kept = {key for job in jobs for key in asking._store.jobs.blob_keys(job)}
    assert set(asking._blobs.keys("jobs/")) == kept, "no orphans"


def _tidier(farm: Studio) -> Tidier:
    return farm._tidier


def test_readiness_answers_while_postgres_does_not(
    real: FarmSettings, opened: Callable[..., Studio], postgres: Postgres, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("workers.checks.PATIENCE_S", 0.5)
    farm = opened(real, works=False)
    assert farm.ready() == {"store": "ok", "blobs": "ok"}
    (backend,) = {row[0] for row in postgres.say("SELECT pid FROM pg_stat_activity WHERE application_name='impasto'")}
    postgres.process.send_signal(signal.SIGSTOP)
    _signal(backend, signal.SIGSTOP)
    try:
        began = time.monotonic()
        assert farm.ready()["store"].startswith("No answer")
        assert farm.ready()["blobs"] == "ok"
        assert time.monotonic() - began < 3
    finally:
        _signal(backend, signal.SIGCONT)
        postgres.process.send_signal(signal.SIGCONT)
    until(lambda: farm.ready()["store"] == "ok")


def _signal(pid: object, which: signal.Signals) -> None:
    os.kill(int(str(pid)), which)


def test_orphans_are_swept_and_all_else_is_spared(
    real: FarmSettings, opened: Callable[..., Studio], data: Path
) -> None:
    farm = opened(real)
    done = finished(farm, farm.submit(request_on(farm, data)).id)
    failed = finished(farm, farm.submit(request_on(farm, data, params={"trouble": "raise"})).id)
    until(lambda: len(list(farm._blobs.keys(f"jobs/{done.id}/"))) == 1)
    before = list(farm._blobs.keys(""))
    for key in ("jobs/job_gone/att_1/segment", f"jobs/{done.id}/late", "assets/" + "0" * 64):
        farm._blobs.put(key, b"left")
    farm._blobs.put(f"jobs/{failed.id}/kept", b"may be retried")
    assert _tidier(farm).sweep() == Swept(0, 2, 1)
    assert list(farm._blobs.keys("")) == sorted([*before, f"jobs/{failed.id}/kept"])
    assert _tidier(farm).sweep() == Swept()


# -- backup and restore, as docs/operations.md says


def test_a_backup_of_postgres_is_restored_and_the_work_goes_on(
    real: FarmSettings, opened: Callable[..., Studio], data: Path, postgres: Postgres, expected: list[bytes]
) -> None:
    farm = opened(real, works=False)
    jobs = _submit(farm, data)
    dump = str(postgres.folder / "impasto.dump")
    postgres.run("pg_dump", "--format=custom", f"--file={dump}", _name(real.database_url))
    restored = postgres.empty()
    postgres.run("pg_restore", "--exit-on-error", "--dbname", _name(restored), dump)
    other = opened(real.model_copy(update={"database_url": restored}))
    assert [result(other, finished(other, job, 60).id) for job in jobs] == expected


def _name(url: str) -> str:
    return str(make_url(url).database)


def test_a_backup_of_sqlite_is_taken_while_it_works(
    open_studio: Callable[..., Studio], data: Path, tmp_path: Path, expected: list[bytes]
) -> None:
    farm = open_studio(home=tmp_path / "old", lease_s=1)
    jobs = _submit(farm, data)
    until(lambda: farm.job(jobs[0]).counts["succeeded"] >= 2)
    new = tmp_path / "new"
    new.mkdir()
    with sqlite3.connect(tmp_path / "old" / "impasto.db") as database:
        database.execute("VACUUM INTO ?", (str(new / "impasto.db"),))
    farm.stop()
    (tmp_path / "old" / "blobs").rename(new / "blobs")
    other = open_studio(home=new)
    assert [result(other, finished(other, job).id) for job in jobs] == expected
