"""Timing of a render, its work folder, and its progress display."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from impasto.cli import console
from impasto.cli.private_farm import forget, key_of, sweep, workspace
from impasto.cli.rendering import Timing, overlap
from workers.contract.record import Job, RunState, StepView, TaskState, TaskView
from workers.contract.request import JobRequest
from workers.errors import Conflict

# -- timing


@pytest.mark.parametrize(
    ("spans", "share"),
    [
        ([], 1.0),
        ([(0, 2), (2, 4)], 1.0),
        ([(0, 2), (0, 2)], 0.5),
        ([(0, 4), (1, 2), (3, 4)], 4 / 6),
        ([(3, 4), (0, 2), (1, 3)], 4 / 5),
        ([(1, 1)], 1.0),
    ],
)
def test_overlapping_intervals_count_once(spans: list[tuple[float, float]], share: float) -> None:
    assert overlap(spans) == pytest.approx(share)


def step(name: str, **stages: float) -> StepView:
    return StepView(name, name.title(), "succeeded", {"succeeded": 2}, 1.0, sum(stages.values()), stages)


def a_job(*steps: StepView, **changes: Any) -> Job:
    job = Job(
        id="job_1",
        state=RunState.SUCCEEDED,
        request=JobRequest("abstraction", {}),
        owner="",
        created_at=0.0,
        updated_at=9.0,
        started_at=0.0,
        finished_at=9.0,
        progress=1.0,
        eta_s=None,
        counts={},
        steps=steps,
        error=None,
        results=("result",),
        warnings=(),
    )
    return dataclasses.replace(job, **changes)


def a_task(name: str, *spans: tuple[float, float | None]) -> TaskView:
    attempts = tuple({"started_at": start, "finished_at": stop} for start, stop in spans)
    return TaskView(f"tsk_{name}", "job_1", name, "k", TaskState.SUCCEEDED, 1.0, attempts)


def test_timing_counts_only_the_time_of_the_method() -> None:
    job = a_job(step("paint", decode=1.0, method=4.0, encode=2.0), step("assemble", method=50.0, encode=3.0))
    tasks = [a_task("paint", (0, 1), (2, 6)), a_task("paint", (2, 6)), a_task("assemble", (6, 99))]
    timing = Timing.of(job, tasks)
    assert timing.seconds == pytest.approx(2.0)  # two at once: half of the summed four seconds
    assert timing.steps == {"paint": pytest.approx(2.0)}
    assert timing.stages == {"decode": 1.0, "method": 54.0, "encode": 5.0}


# -- workspace


def test_a_running_render_is_not_swept(home: Path) -> None:
    with workspace(home, "k") as place:
        script = (
            "from pathlib import Path\nfrom impasto.cli.private_farm import workspace\n"
            f"with workspace(Path({str(home)!r}), 'k'): pass"
        )
        other = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
        assert "running in another process" in other.stderr
        with pytest.raises(Conflict), workspace(home, "k"):
            pass
    with workspace(home, "k") as again:
        assert again == place
        forget(again.folder)
    assert not place.folder.exists()


def test_only_old_leftovers_are_swept(home: Path) -> None:
    for name in ("old", "new", "busy"):
        with workspace(home, name):
            pass
    long_ago = time.time() - 100
    with workspace(home, "busy"):
        for name in ("old", "busy"):
            os.utime(home / "renders" / name, (long_ago, long_ago))
        sweep(home, kept_s=50)
    assert sorted(path.name for path in (home / "renders").iterdir()) == ["busy", "new"]


def test_the_cache_key_depends_only_on_its_inputs() -> None:
    facts = {"params": {"a": 1, "b": 2.5}, "output": Path("/x/y.mp4")}
    assert key_of(facts) == key_of({"output": Path("/x/y.mp4"), "params": {"b": 2.5, "a": 1}})
    assert key_of(facts) != key_of(facts | {"params": {"a": 1, "b": 2}})


# -- progress


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.2, "0 s"), (59.4, "59 s"), (61, "1 min 01 s"), (3900, "1 h 05 min"), (-1, "0 s")]
)
def test_durations_are_formatted_for_people(seconds: float, text: str) -> None:
    assert console.duration(seconds) == text


def test_progress_in_a_log_prints_one_line_per_change(capsys: pytest.CaptureFixture[str]) -> None:
    running = dataclasses.replace(step("paint"), state="running", counts={"succeeded": 1, "running": 1})
    with console.progress() as show:
        for job in (a_job(running), a_job(running), a_job(step("paint"))):
            show(dataclasses.asdict(job))
    assert capsys.readouterr().err.splitlines() == ["Paint: running, 1 of 2 tasks", "Paint: succeeded, 2 of 2 tasks"]
