"""What a task is given of a machine, and whether a machine has it: rules without any cluster."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.methods.base import Needs
from tests.workers.conftest import finished, request_on, until
from tests.workers.test_dispatcher import ByHand
from tests.workers.toy import Toy
from workers.blobs.disk import DiskBlobs
from workers.errors import NoRoom
from workers.faults import failed_outcome
from workers.model import JobRequest
from workers.planning import plan_step
from workers.pool import Report
from workers.room import Room, able, lacking, room_for, usual
from workers.settings import FarmSettings
from workers.studio import Studio

GIB = 1 << 30
FARM = FarmSettings(task_cpus=2, task_gpus=0.25, task_memory_bytes=GIB)


@pytest.mark.parametrize(
    ("needs", "room"),
    [
        (None, Room(2, 0.25, GIB)),
        (Needs(), Room(2, 0.25, GIB)),
        (Needs(gpus=0.0), Room(2, 0.0, GIB)),
        (Needs(cpus=1, gpus=1, memory_bytes=GIB // 4), Room(1, 1, GIB)),
        (Needs(memory_bytes=GIB), Room(2, 0.25, GIB)),
        (Needs(memory_bytes=GIB + 1), Room(2, 0.25, 2 * GIB)),
        (Needs(memory_bytes=5 * GIB), Room(2, 0.25, 8 * GIB)),
    ],
)
def test_a_task_is_given_what_it_needs_and_else_what_the_farm_says(needs: Needs | None, room: Room) -> None:
    assert room_for(needs, FARM) == room


def test_small_memory_is_rounded_up_where_the_farm_asks_for_none() -> None:
    none = FarmSettings(task_memory_bytes=0)
    assert room_for(Needs(memory_bytes=1), none).memory_bytes == GIB // 2
    assert room_for(Needs(), none).memory_bytes == 0


def test_a_worker_that_waits_for_work_holds_no_gpu() -> None:
    assert usual(FARM) == Room(2, 0.0, GIB)
    assert not usual(FARM).covers(room_for(None, FARM))
    assert room_for(None, FARM).covers(usual(FARM))


def test_machines_that_could_hold_a_task_and_what_is_said_if_none_can() -> None:
    machines = [("east", Room(4, 0, 8 * GIB)), ("west", Room(2, 1, 4 * GIB))]
    assert able(Room(1, 0, 4 * GIB), machines) == {"east", "west"}
    assert able(Room(1, 0.5, GIB), machines) == {"west"}
    assert able(Room(3, 0.5, GIB), machines) == set()
    said = lacking(Room(3, 0.5, GIB), machines)
    assert said == (
        "No machine of the cluster has 3 CPU, 0.5 GPU, 1024 MiB "
        "(east: 4 CPU, 8192 MiB; west: 2 CPU, 1 GPU, 4096 MiB)"
    )  # fmt: skip
    assert lacking(Room(1, 0, 0), []).endswith("(there are none)")


def test_what_a_method_says_of_a_step_goes_for_tasks_that_say_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    says = Needs(gpus=0.0, memory_bytes=3 * GIB)
    monkeypatch.setattr(Toy, "needs", staticmethod(lambda step, brief: says), raising=False)
    request, notes = JobRequest("toy", {}), {"look": {"all": {"found": 1}}}
    assert [task.needs for task in plan_step(1, request, {}, {}, notes)] == [says]
    (own,) = plan_step(1, request, {"memory_mib": 64}, {}, notes)
    assert own.needs == Needs(1.0, 0.0, 64 << 20)
    (join,) = plan_step(2, request, {}, {}, notes)
    assert join.needs is not None and join.needs.gpus == 0.0


def test_a_task_without_room_waits_with_a_reason_and_then_fails_its_job_at_once(
    settings: FarmSettings, data: Path
) -> None:
    pool, blobs = ByHand(), DiskBlobs(settings.blobs_at)
    farm = Studio(settings, pool)
    farm.start()
    try:
        job = farm.submit(request_on(farm, data, params={"tasks": 1}))
        pool.run(blobs, pool.next())
        order = pool.next()
        pool.listen(Report(order.attempt_id, worker="waiting for 99 CPU: no machine has that"))
        until(lambda: "no machine" in farm.task(order.task_id).attempts[0]["worker"])
        error = NoRoom("No machine has 99 CPU.", field="needs", remedy="Add such a machine.")
        pool.listen(Report(order.attempt_id, outcome=failed_outcome(order.attempt_id, error)))
        ended = finished(farm, job.id)
        assert ended.state == "failed" and ended.error is not None
        assert (ended.error.code, ended.error.remedy) == ("no-room", "Add such a machine.")
        assert pool.orders == [], "to try again cannot help"
    finally:
        farm.stop()


def test_readiness_says_that_no_worker_can_start(
    settings: FarmSettings, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    pool = ByHand(0)
    lack = {"kind": "ray", "workers": 0, "busy": {}, "lacking": "No machine."}
    monkeypatch.setattr(pool, "describe", lambda: lack)
    farm = Studio(settings, pool)
    farm.start()
    try:
        until(lambda: farm.ready()["pool"] == "No machine.")
    finally:
        farm.stop()
