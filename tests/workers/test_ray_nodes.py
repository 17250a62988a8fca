"""A real Ray cluster of several nodes: drained and lost nodes, and resources of tasks."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.processes import started
from tests.waiting import until
from tests.workers.conftest import finished, request_on, result
from tests.workers.toy import runner_after
from workers.blobs.disk import DiskBlobs
from workers.farm import Farm
from workers.operator_views import DrainScope
from workers.settings import FarmSettings

pytestmark = [pytest.mark.real("ray"), pytest.mark.slow]

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A head that runs no tasks, and two nodes of two processors, one with a GPU (Ray only counts it)."""
    from ray.cluster_utils import Cluster

    handler = signal.getsignal(signal.SIGTERM)  # Ray's test cluster takes it
    made = Cluster(
        initialize_head=True, head_node_args={"num_cpus": 0, "node_name": "head", "include_dashboard": False}
    )
    made.named = {
        name: made.add_node(num_cpus=2, num_gpus=gpus, node_name=name, object_store_memory=80 << 20, memory=2200 << 20)
        for name, gpus in (("east", 0), ("west", 1))
    }
    made.wait_for_nodes()
    signal.signal(signal.SIGTERM, handler)
    yield made
    made.shutdown()
    signal.signal(signal.SIGTERM, handler)


@pytest.fixture(scope="module")
def farm(cluster: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    from workers.pools.ray_pool import RayPool

    home = tmp_path_factory.mktemp("nodes")
    settings = FarmSettings(
        home=home, pool="ray", workers=3, ray_address=cluster.address, reserve_bytes=0, retry_delay_s=0.02,
        task_memory_bytes=64 << 20, capacity_wait_s=8,
    )  # fmt: skip
    blobs = DiskBlobs(settings.blobs_at)
    farm = Farm(settings, RayPool(blobs, settings, partial(runner_after, home / "slow")))
    farm.start()
    until(lambda: len(_slots(farm)) == 3, 60)
    yield farm
    farm.stop()


def _slots(farm: Farm) -> list[Any]:
    return [slot for worker in farm.workers.workers().items for slot in worker.slots]


def _bars(farm: Farm, job: str) -> list[Any]:
    return [bar for bar in farm.workers.timeline(job).items if bar.step == "draw"]


def _nodes_of(farm: Farm, bars: list[Any], known: dict[str, str]) -> set[str]:
    known.update({slot.name: slot.node for slot in _slots(farm)})
    return {known[bar.slot] for bar in bars}


def test_actors_of_a_drained_node_move_to_other_nodes(farm: Farm, data: Path) -> None:
    known = {slot.name: slot.node for slot in _slots(farm)}
    assert set(known.values()) == {"east", "west"}
    running = farm.jobs.submit(request_on(farm, data, params={"tasks": 6, "sleep_s": 1.0})).id
    until(lambda: farm.jobs.get(running).counts["running"] == 3, 30)
    farm.workers.drain(DrainScope.NODE, "east", reason="a new kernel")
    until(lambda: {slot.node for slot in _slots(farm)} == {"west"}, 60)
    assert [node.state for node in farm.workers.nodes() if node.name == "east"] == ["drained"]
    assert finished(farm, running, 60).state == "succeeded"
    assert {bar.outcome for bar in _bars(farm, running)} == {"succeeded"}, "what ran there was finished"
    job = finished(farm, farm.jobs.submit(request_on(farm, data, seed=8, params={"tasks": 4, "sleep_s": 0.3})).id, 60)
    assert _nodes_of(farm, _bars(farm, job.id), known) == {"west"}
    farm.workers.resume(DrainScope.NODE, "east")
    until(lambda: len(_slots(farm)) == 3, 60)
    assert {slot.node for slot in _slots(farm)} == {"east", "west"}


def test_a_task_runs_on_a_node_with_its_resources(farm: Farm, data: Path) -> None:
    params = {"tasks": 2, "sleep_s": 0.5, "gpus": 0.5, "memory_mib": 64}
    job = finished(farm, farm.jobs.submit(request_on(farm, data, seed=9, params=params)).id, 60)
    assert job.state == "succeeded", job.error
    slots = [slot for slot in _slots(farm) if slot.gpus == 0.5]
    assert slots and {slot.node for slot in slots} == {"west"}
    assert {(slot.cpus, slot.memory_bytes) for slot in slots} == {(1.0, 512 << 20)}


def test_no_machine_is_overcommitted(farm: Farm, data: Path) -> None:
    """Two machines of 2.2 GiB, three workers, tasks of 2 GiB: one on each machine, while the third waits."""
    params = {"tasks": 200, "sleep_s": 0.5, "memory_mib": 2048}
    job = farm.jobs.submit(request_on(farm, data, seed=13, params=params)).id

    def machines_of_large_slots() -> list[str]:
        large = [slot.node for slot in _slots(farm) if slot.memory_bytes == 2 << 30]
        assert len(large) == len(set(large)), "two large tasks on one machine"
        return large

    until(lambda: len(machines_of_large_slots()) == 2, 60)
    done = farm.jobs.get(job).counts["succeeded"]
    until(lambda: machines_of_large_slots() and farm.jobs.get(job).counts["succeeded"] >= done + 6, 60)
    farm.jobs.cancel(job)
    until(lambda: farm.jobs.get(job).state.final, 60)


def test_a_task_too_large_for_every_machine_fails_and_the_farm_continues(farm: Farm, data: Path) -> None:
    job = farm.jobs.submit(request_on(farm, data, seed=14, params={"tasks": 2, "memory_mib": 64 << 10})).id

    def waits() -> bool:
        attempts = [attempt for task in farm.tasks.page(job).items for attempt in task.attempts]
        return any("65536 MiB: no machine has that" in attempt["worker"] for attempt in attempts)

    until(waits, 30)
    ended = finished(farm, job, 60)
    assert ended.state == "failed" and ended.error is not None
    assert ended.error.code == "no-room" and "65536 MiB" in ended.error.message and "east" in ended.error.message
    after = finished(farm, farm.jobs.submit(request_on(farm, data, seed=15)).id, 60)
    assert after.state == "succeeded"
    until(lambda: len(_slots(farm)) == 3, 60)


def test_a_node_joins_works_and_leaves_without_loss(farm: Farm, cluster: Any, data: Path, tmp_path: Path) -> None:
    """`impasto worker --ray-address` as an operator starts and stops it."""
    command = [sys.executable, "-m", "impasto", "worker", "--ray-address", cluster.address, "--name", "north"]
    database = f"sqlite:///{farm._settings.home.absolute() / 'impasto.db'}"
    more = ["--workers", "3", "--gpus", "0", "--database", database, "--home", str(tmp_path / "north")]
    for name in ("east", "west"):
        farm.workers.drain(DrainScope.NODE, name)
    with started([*command, *more], cwd=ROOT, stdout=subprocess.PIPE, text=True) as node:
        until(lambda: [slot.node for slot in _slots(farm)] == ["north"] * 3, 90)
        before = finished(farm, farm.jobs.submit(request_on(farm, data, seed=10)).id, 60)
        running = farm.jobs.submit(request_on(farm, data, seed=11, params={"tasks": 6, "sleep_s": 2})).id
        until(lambda: farm.jobs.get(running).counts["running"] == 3, 30)
        node.terminate()
        assert node.wait(60) == 0
    for name in ("east", "west"):
        farm.workers.resume(DrainScope.NODE, name)
    assert before.state == finished(farm, running, 90).state == "succeeded"
    assert {bar.outcome for bar in _bars(farm, running)} == {"succeeded"}
    assert [node.name for node in farm.workers.nodes() if node.drain] == []


def test_an_actor_that_starts_slowly_ends_no_idle_actor(farm: Farm, data: Path) -> None:
    """If the machine has capacity for both actors, starting one does not end the other."""
    until(lambda: len(_slots(farm)) == 3, 60)
    idle = {slot.name for slot in _slots(farm)}
    slow = farm._settings.home / "slow"
    slow.touch()
    job = farm.jobs.submit(request_on(farm, data, seed=16, params={"tasks": 1, "memory_mib": 1024}))
    assert finished(farm, job.id, 60).state == "succeeded"
    slow.unlink()
    assert len(idle & {slot.name for slot in _slots(farm)}) == 2, "one was exchanged for one with more memory"


def test_tasks_of_a_dead_node_run_on_other_nodes(farm: Farm, cluster: Any, data: Path) -> None:
    until(lambda: len(_slots(farm)) == 3, 60)
    params = {"tasks": 6, "sleep_s": 3}
    job = farm.jobs.submit(request_on(farm, data, seed=12, params=params)).id
    until(lambda: farm.jobs.get(job).counts["running"] == 3, 30)
    until(lambda: all(work.node for worker in farm.workers.workers().items for work in worker.at_work), 10)
    busy = {work.node for worker in farm.workers.workers().items for work in worker.at_work}
    cluster.remove_node(cluster.named[min(busy)], allow_graceful=False)
    ended = finished(farm, job, 120)
    assert ended.state == "succeeded", ended.error
    assert {"failed", "succeeded"} == {bar.outcome for bar in _bars(farm, job)}
    again = finished(farm, farm.jobs.submit(request_on(farm, data, seed=12, params=params)).id, 120)
    assert result(farm, job) == result(farm, again.id)
