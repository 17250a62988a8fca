"""The same farm on a real Ray cluster of one machine: same bytes, cancellation, worker death, own SIGTERM handler."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.waiting import until
from tests.workers.conftest import finished, request_on, result
from tests.workers.toy import ToyRunner, WatchedBlobs
from workers.farm import Farm
from workers.pools.artefact_cache import SharedArtefacts
from workers.settings import FarmSettings

pytestmark = pytest.mark.real("ray")


@pytest.fixture(scope="module")
def ray_farm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    """One cluster for all tests of this file, because it takes seconds to start."""
    from workers.pools.ray_pool import RayPool

    home = tmp_path_factory.mktemp("ray")
    settings = FarmSettings(home=home, pool="ray", workers=2, reserve_bytes=0, retry_delay_s=0.02)
    blobs = WatchedBlobs(settings.blobs_at)
    farm = Farm(settings, RayPool(blobs, settings, ToyRunner))
    farm.start()
    yield farm
    farm.stop()


def test_ray_and_the_local_pool_give_the_same_bytes(ray_farm: Farm, open_farm: Callable[..., Farm], data: Path) -> None:
    local = open_farm()
    results = set()
    for farm in (ray_farm, local):
        job = finished(farm, farm.jobs.submit(request_on(farm, data, params={"tasks": 6, "chain": True})).id, 60)
        assert job.state == "succeeded", job.error
        results.add(result(farm, job.id))
    assert len(results) == 1


def test_a_chain_passes_its_state_without_the_blob_store(
    ray_farm: Farm, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Artefacts pass through memory only if the store is remote, so the test pretends that it is."""
    fetched, pool = ray_farm._settings.home / "fetched", ray_farm._pool
    results = []
    for far, most_bytes in ((True, 1 << 20), (True, 0), (False, 1 << 20)):
        fetched.unlink(missing_ok=True)
        monkeypatch.setattr(ray_farm._dispatcher._orders, "_shares_memory", far)
        monkeypatch.setattr(pool, "_shared", SharedArtefacts(most_bytes))
        job = finished(
            ray_farm, ray_farm.jobs.submit(request_on(ray_farm, data, params={"tasks": 6, "chain": True})).id, 60
        )
        assert job.state == "succeeded", job.error
        results.append(result(ray_farm, job.id))
        assert fetched.exists() == (not far or not most_bytes)
    assert len(fetched.read_text().splitlines()) == 5, "each but the first loads its neighbour's"
    assert len(set(results)) == 1


def test_cancel_reaches_an_actor_within_a_second(ray_farm: Farm, data: Path) -> None:
    job = ray_farm.jobs.submit(request_on(ray_farm, data, params={"tasks": 2, "sleep_s": 30}))
    until(
        lambda: ray_farm.jobs.get(job.id).progress > 0 and ray_farm.jobs.get(job.id).steps[1].counts["running"] == 2, 30
    )
    ray_farm.jobs.cancel(job.id)
    until(lambda: ray_farm.snapshot()["pool"]["busy"] == {}, 1.5)


def test_a_dead_worker_is_replaced_and_its_task_is_retried(ray_farm: Farm, data: Path, tmp_path: Path) -> None:
    params = {"tasks": 3, "trouble": "die", "mark": str(tmp_path / "mark")}
    job = finished(ray_farm, ray_farm.jobs.submit(request_on(ray_farm, data, params=params)).id, 60)
    assert job.state == "succeeded", job.error
    task = next(task for task in ray_farm.tasks.page(job.id).items if task.key == "run-1")
    assert [attempt["outcome"] for attempt in task.attempts] == ["failed", "succeeded"]
    assert task.attempts[0]["error"]["code"] == "worker-lost"
    until(lambda: ray_farm.snapshot()["pool"]["workers"] == 2, 30)


def test_ray_does_not_replace_the_sigterm_handler(ray_farm: Farm) -> None:
    assert ray_farm.ready()["pool"] == "ok"
    assert signal.getsignal(signal.SIGTERM) in (signal.SIG_DFL, signal.default_int_handler), os.getpid()
