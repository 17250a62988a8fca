"""Resources of a task and the machines that can run it, without a cluster."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.methods.base import Resources
from tests.waiting import until
from tests.workers.conftest import finished, request_on
from tests.workers.test_dispatcher import ManualPool
from tests.workers.toy import Toy
from workers.blobs.disk import DiskBlobs
from workers.contract.request import JobRequest
from workers.errors import NoCapacity
from workers.farm import Farm
from workers.faults import failed_outcome
from workers.pools.base import Report
from workers.pools.capacity import Capacity, capacity_for, default_capacity, has_capacity, machines_with, shortage
from workers.scheduling.planning import plan_step
from workers.settings import FarmSettings

GIB = 1 << 30
FARM = FarmSettings(task_cpus=2, task_gpus=0.25, task_memory_bytes=GIB)


@pytest.mark.parametrize(
    ("resources", "capacity"),
    [
        (None, Capacity(2, 0.25, GIB)),
        (Resources(), Capacity(2, 0.25, GIB)),
        (Resources(gpus=0.0), Capacity(2, 0.0, GIB)),
        (Resources(cpus=1, gpus=1, memory_bytes=GIB // 4), Capacity(1, 1, GIB)),
        (Resources(memory_bytes=GIB), Capacity(2, 0.25, GIB)),
        (Resources(memory_bytes=GIB + 1), Capacity(2, 0.25, 2 * GIB)),
        (Resources(memory_bytes=5 * GIB), Capacity(2, 0.25, 8 * GIB)),
    ],
)
def test_a_task_gets_what_it_declares_and_else_the_farms_default(
    resources: Resources | None, capacity: Capacity
) -> None:
    assert capacity_for(resources, FARM) == capacity


def test_small_memory_requests_are_rounded_up_without_a_farm_default() -> None:
    none = FarmSettings(task_memory_bytes=0)
    assert capacity_for(Resources(memory_bytes=1), none).memory_bytes == GIB // 2
    assert capacity_for(Resources(), none).memory_bytes == 0


def test_an_idle_worker_reserves_no_gpu() -> None:
    assert default_capacity(FARM) == Capacity(2, 0.0, GIB)
    assert not default_capacity(FARM).covers(capacity_for(None, FARM))
    assert capacity_for(None, FARM).covers(default_capacity(FARM))


def test_room_beside_what_is_taken_of_a_machine() -> None:
    machines = [("east", Capacity(4, 0, 8 * GIB)), ("west", Capacity(2, 1, 4 * GIB))]
    taken = [("east", Capacity(2, 0, GIB)), ("east", Capacity(1, 0, GIB)), ("west", Capacity(1, 1, GIB))]
    assert has_capacity(Capacity(1, 0, 6 * GIB), machines, taken)
    assert not has_capacity(Capacity(1, 0, 7 * GIB), machines, taken)
    assert not has_capacity(Capacity(2, 0, GIB), machines, taken)
    assert not has_capacity(Capacity(1, 0.5, GIB), machines, taken)
    assert has_capacity(Capacity(1, 0.5, GIB), machines, taken[:2])


def test_machines_large_enough_for_a_task_and_the_message_if_none_is() -> None:
    machines = [("east", Capacity(4, 0, 8 * GIB)), ("west", Capacity(2, 1, 4 * GIB))]
    assert machines_with(Capacity(1, 0, 4 * GIB), machines) == {"east", "west"}
    assert machines_with(Capacity(1, 0.5, GIB), machines) == {"west"}
    assert machines_with(Capacity(3, 0.5, GIB), machines) == set()
    message = shortage(Capacity(3, 0.5, GIB), machines)
    assert message == (
        "No machine of the cluster has 3 CPU, 0.5 GPU, 1024 MiB "
        "(east: 4 CPU, 8192 MiB; west: 2 CPU, 1 GPU, 4096 MiB)"
    )  # fmt: skip
    assert shortage(Capacity(1, 0, 0), []).endswith("(there are none)")


def test_resources_of_a_step_apply_to_tasks_that_declare_none(monkeypatch: pytest.MonkeyPatch) -> None:
    declared = Resources(gpus=0.0, memory_bytes=3 * GIB)
    monkeypatch.setattr(Toy, "resources", staticmethod(lambda step, context: declared), raising=False)
    request, results = JobRequest("toy", {}), {"analyze": {"all": {"found": 1}}}
    assert [task.resources for task in plan_step(1, request, {}, {}, results)] == [declared]
    (own,) = plan_step(1, request, {"memory_mib": 64}, {}, results)
    assert own.resources == Resources(1.0, 0.0, 64 << 20)
    (join,) = plan_step(2, request, {}, {}, results)
    assert join.resources is not None and join.resources.gpus == 0.0


def test_a_task_without_capacity_waits_with_a_reason_and_then_fails_its_job(settings: FarmSettings, data: Path) -> None:
    pool, blobs = ManualPool(), DiskBlobs(settings.blobs_at)
    farm = Farm(settings, pool)
    farm.start()
    try:
        job = farm.jobs.submit(request_on(farm, data, params={"tasks": 1}))
        pool.run(blobs, pool.next())
        order = pool.next()
        pool.listen(Report(order.attempt_id, worker="waiting for 99 CPU: no machine has that"))
        until(lambda: "no machine" in farm.tasks.get(order.task_id).attempts[0]["worker"])
        error = NoCapacity("No machine has 99 CPU.", field="needs", remedy="Add such a machine.")
        pool.listen(Report(order.attempt_id, outcome=failed_outcome(order.attempt_id, error)))
        ended = finished(farm, job.id)
        assert ended.state == "failed" and ended.error is not None
        assert (ended.error.code, ended.error.remedy) == ("no-room", "Add such a machine.")
        assert pool.orders == [], "to try again cannot help"
    finally:
        farm.stop()


def test_readiness_reports_that_no_worker_can_start(
    settings: FarmSettings, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    pool = ManualPool(0)
    lack = {"kind": "ray", "workers": 0, "busy": {}, "lacking": "No machine."}
    monkeypatch.setattr(pool, "describe", lambda: lack)
    farm = Farm(settings, pool)
    farm.start()
    try:
        until(lambda: farm.ready()["pool"] == "No machine.")
    finally:
        farm.stop()
