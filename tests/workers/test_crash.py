"""kill -9 in the middle of a job: it resumes at once after the last finished task, with the same bytes."""

from __future__ import annotations

import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from tests.workers.conftest import finished, result
from tests.workers.crash_child import KEY, PARAMS
from workers.contract.request import JobRequest
from workers.farm import Farm

ROOT = Path(__file__).resolve().parents[2]


def _start(home: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "tests.workers.crash_child", str(home)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)


def _kill_after(home: Path, lines: int) -> None:
    """Kill the child after it has printed this many lines of progress."""
    child = _start(home)
    assert child.stdout is not None
    for _ in range(lines):
        child.stdout.readline()
    child.kill()
    child.wait(10)


def test_a_job_survives_repeated_kill_9(open_farm: Callable[..., Farm], tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir()
    delays = random.Random(5)
    for _ in range(4):
        _kill_after(home, delays.randint(2, 9))
    farm = open_farm(lease_s=600)
    job = farm.jobs.page().items[0]
    assert finished(farm, job.id, 20).state == "succeeded", "long before the lease is over"
    tasks = list(farm.tasks.page(job.id).items)
    done = [[a["outcome"] for a in task.attempts].count("succeeded") for task in tasks]
    assert done == [1] * len(tasks), "what was done was not done again"
    assert any(a["outcome"] == "interrupted" for task in tasks for a in task.attempts)

    quiet = open_farm(home=tmp_path / "quiet")
    asset = quiet.assets.add(home / "data.json", "data.json")
    other = quiet.jobs.submit(JobRequest("toy", {"data": asset.id}, PARAMS, seed=3), idempotency_key=KEY)
    finished(quiet, other.id)
    assert result(quiet, other.id) == result(farm, job.id)


def test_a_second_process_does_not_take_running_attempts(open_farm: Callable[..., Farm], tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir()
    child = _start(home)
    assert child.stdout is not None
    child.stdout.readline()
    child.stdout.readline()
    farm = open_farm()
    job = finished(farm, farm.jobs.page().items[0].id)
    assert child.wait(20) == 0
    outcomes = {a["outcome"] for task in farm.tasks.page(job.id).items for a in task.attempts}
    assert outcomes == {"succeeded"}
