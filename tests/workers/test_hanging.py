"""Attempts that hang in a library: each is ended with its process, is not charged, and its slot returns."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import psutil
import pytest

from tests.waiting import until
from tests.workers.conftest import finished, request_on
from tests.workers.hangs import HANGS
from tests.workers.toy import METHODS, Toy, ToyRunner
from workers.blobs.disk import DiskBlobs
from workers.contract.order import ProgressReport, TaskOrder, TaskOutcome
from workers.farm import Farm
from workers.pools.child_runner import ChildRunner
from workers.pools.local_pool import LocalPool
from workers.settings import FarmSettings

STALL_S = 4.0


class HangingRunner(ToyRunner):
    """Hangs in the first attempt of the first task that draws, while `mark` does not exist."""

    def __init__(self, root: Path, mark: Path, hang: str) -> None:
        METHODS["toy"] = Toy
        super().__init__(DiskBlobs(root))
        self._mark, self._hang = mark, hang

    def run(self, order: TaskOrder, report: ProgressReport, cancelled: Callable[[], bool]) -> TaskOutcome:
        if order.step == "draw" and not self._mark.exists():
            self._mark.touch()
            report(0.5)
            HANGS[self._hang]()
        return super().run(order, report, cancelled)


@pytest.fixture
def farm(settings: FarmSettings, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Farm]:
    make = partial(HangingRunner, settings.blobs_at, tmp_path / "mark", request.param)
    chosen = settings.model_copy(update={"stall_s": STALL_S, "attempts": 1})
    farm = Farm(chosen, LocalPool(lambda number: ChildRunner(make), 1))
    farm.start()
    yield farm
    farm.stop()


@pytest.mark.parametrize("farm", HANGS, indirect=True)
def test_a_hanging_attempt_is_ended_with_its_process(
    farm: Farm, data: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture, request: pytest.FixtureRequest
) -> None:
    caplog.set_level(logging.WARNING)
    job = farm.jobs.submit(request_on(farm, data, params={"tasks": 2}))
    until((tmp_path / "mark").exists, 60)
    began = time.monotonic()
    before = set(psutil.Process().children())
    assert finished(farm, job.id, 60).state == "succeeded", "the attempt is not charged: a failure would be final"
    assert time.monotonic() - began < 60, "the slot returns"
    hung = [task.attempts for task in farm.tasks.page(job.id).items if len(task.attempts) > 1]
    assert [[attempt["outcome"] for attempt in attempts] for attempts in hung] == [["interrupted", "succeeded"]]
    assert "and its process was ended" in caplog.text
    spins = "spin" in request.node.callspec.params["farm"]
    assert ("spins" in caplog.text) == spins
    assert before - set(psutil.Process().children()), "the process has ended"
