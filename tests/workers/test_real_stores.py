"""A whole farm on real PostgreSQL and real S3: several processes, faults, backup and restore."""

from __future__ import annotations

import os
import signal
import sqlite3
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from sqlalchemy import make_url

from pipeline.video.probe import probe
from tests.chaos import run as chaos
from tests.chaos.__main__ import undisturbed
from tests.chaos.faults import SHAPES
from tests.chaos.run import submit
from tests.real.postgres import Postgres
from tests.real.swift import Swift
from tests.waiting import until
from tests.workers.conftest import finished, request_on, result
from tests.workers.real_farm import real_settings
from tests.workers.toy import Toy, ToyRunner
from workers.blobs.open import open_blobs
from workers.farm import Farm
from workers.faults import failed_outcome, is_final
from workers.pools.local_pool import LocalPool
from workers.scheduling.garbage_collector import GarbageCollector, Removed
from workers.settings import FarmSettings


@pytest.fixture
def real(postgres: Postgres, s3: Swift, tmp_path: Path) -> FarmSettings:
    return real_settings(postgres, s3, tmp_path / "home")


@pytest.fixture
def opened() -> Iterator[Callable[..., Farm]]:
    """Opens farms, by default with workers, and stops them at the end."""
    farms: list[Farm] = []

    def open_one(settings: FarmSettings, works: bool = True) -> Farm:
        blobs = open_blobs(settings)
        pool = LocalPool(lambda number: ToyRunner(blobs), settings.workers) if works else None
        farms.append(Farm(settings, pool))
        farms[-1].start()
        return farms[-1]

    yield open_one
    for farm in farms:
        farm.stop()


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    """Results of undisturbed jobs with these shapes, on disk and SQLite."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.methods.methods", lambda: {"toy": Toy()})
        patch.setattr("workers.farm.probe_guarded", probe)
        return undisturbed(tmp_path_factory.mktemp("quiet"))


def _submit(farm: Farm, folder: Path) -> list[str]:
    return [submit(farm, folder, shape) for shape in SHAPES]


def test_two_farms_share_the_work_and_give_the_bytes_of_one(
    real: FarmSettings, opened: Callable[..., Farm], tmp_path: Path, expected: list[bytes]
) -> None:
    asking = opened(real, works=False)
    jobs = _submit(asking, tmp_path)
    for name in ("one", "two"):
        opened(real.model_copy(update={"home": tmp_path / name}))
    assert [result(asking, finished(asking, job, 150).id) for job in jobs] == expected
    found = [attempt for job in jobs for task in asking.tasks.page(job).items for attempt in task.attempts]
    assert {attempt["outcome"] for attempt in found} == {"succeeded"}
    with asking.store.database.read() as connection:
        doers = set(connection.exec_driver_sql("SELECT DISTINCT dispatcher FROM attempts").scalars())
    assert len(doers) == 2, "both have worked"


@pytest.mark.parametrize("seed", [1, 4])
def test_injected_faults_in_every_component_lose_no_work(
    real: FarmSettings, tmp_path: Path, expected: list[bytes], postgres: Postgres, s3: Swift, seed: int
) -> None:
    """This is a short run; `make chaos` makes many long ones."""
    shown = chaos.run(real, tmp_path, postgres, s3, expected, chaos.Plan(seed, times=3))
    assert (shown.lost, shown.running, shown.twice, shown.orphans) == (0, 0, 0, 0), shown


def _collector(farm: Farm) -> GarbageCollector:
    return farm._collector


def test_readiness_answers_while_postgres_is_down(
    real: FarmSettings, opened: Callable[..., Farm], postgres: Postgres, monkeypatch: pytest.MonkeyPatch
) -> None:
    farm = opened(real, works=False)
    until(lambda: farm.ready() == {"store": "ok", "blobs": "ok"})
    monkeypatch.setattr("workers.farm_parts.health.TIMEOUT_S", 1.5)
    (backend,) = {
        row[0] for row in postgres.execute("SELECT pid FROM pg_stat_activity WHERE application_name='impasto'")
    }
    postgres.process.send_signal(signal.SIGSTOP)
    _signal(backend, signal.SIGSTOP)
    try:
        began = time.monotonic()
        assert farm.ready()["store"].startswith("No answer")
        assert time.monotonic() - began < 6
        until(lambda: farm.ready()["blobs"] == "ok")
    finally:
        _signal(backend, signal.SIGCONT)
        postgres.process.send_signal(signal.SIGCONT)
    until(lambda: farm.ready()["store"] == "ok")


def _signal(pid: object, which: signal.Signals) -> None:
    os.kill(int(str(pid)), which)


def test_only_orphaned_blobs_are_swept(real: FarmSettings, opened: Callable[..., Farm], data: Path) -> None:
    farm = opened(real)
    done = finished(farm, farm.jobs.submit(request_on(farm, data)).id)
    failed = finished(farm, farm.jobs.submit(request_on(farm, data, params={"trouble": "raise"})).id)
    until(lambda: len(list(farm.blobs.keys(f"jobs/{done.id}/"))) == 1)
    _collector(farm).stop()  # its thread could sweep at any time
    before = list(farm.blobs.keys(""))
    for key in ("jobs/job_gone/att_1/segment", f"jobs/{done.id}/late", "assets/" + "0" * 64):
        farm.blobs.put(key, b"left")
    farm.blobs.put(f"jobs/{failed.id}/kept", b"may be retried")
    assert _collector(farm).sweep() == Removed(0, 2, 1)
    assert list(farm.blobs.keys("")) == sorted([*before, f"jobs/{failed.id}/kept"])
    assert _collector(farm).sweep() == Removed()


def test_an_input_without_bytes_is_reported(farm: Farm, data: Path) -> None:
    request = request_on(farm, data)
    farm.blobs.delete(f"assets/{request.inputs['data'].removeprefix('ast_')}")
    fault = failed_outcome("att_1", _raised(lambda: farm.blobs.get("assets/gone"))).fault
    assert fault is not None and is_final(fault)
    assert (fault.code, fault.value, bool(fault.remedy)) == ("not-found", "assets/gone", True)


def _raised(act: Callable[[], object]) -> BaseException:
    with pytest.raises(KeyError) as error:
        act()
    return error.value


# -- backup and restore as in docs/operations.md


def test_a_restored_backup_of_postgres_continues_the_work(
    real: FarmSettings, opened: Callable[..., Farm], tmp_path: Path, postgres: Postgres, expected: list[bytes]
) -> None:
    farm = opened(real, works=False)
    jobs = _submit(farm, tmp_path)
    dump = str(postgres.folder / "impasto.dump")
    postgres.run("pg_dump", "--format=custom", f"--file={dump}", _name(real.database_url))
    restored = postgres.empty()
    postgres.run("pg_restore", "--exit-on-error", "--dbname", _name(restored), dump)
    other = opened(real.model_copy(update={"database_url": restored}))
    assert [result(other, finished(other, job, 150).id) for job in jobs] == expected


def _name(url: str) -> str:
    return str(make_url(url).database)


def test_a_backup_of_sqlite_is_taken_while_it_works(
    open_farm: Callable[..., Farm], tmp_path: Path, expected: list[bytes]
) -> None:
    farm = open_farm(home=tmp_path / "old", lease_s=1)
    jobs = _submit(farm, tmp_path)
    until(lambda: farm.jobs.get(jobs[0]).counts["succeeded"] >= 2)
    new = tmp_path / "new"
    new.mkdir()
    with sqlite3.connect(tmp_path / "old" / "impasto.db") as database:
        database.execute("VACUUM INTO ?", (str(new / "impasto.db"),))
    farm.stop()
    (tmp_path / "old" / "blobs").rename(new / "blobs")
    other = open_farm(home=new)
    assert [result(other, finished(other, job).id) for job in jobs] == expected
