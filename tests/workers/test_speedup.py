"""The simulation of `benchmarks.speedup`: hand-made plans with known times, and lower bounds of all plans."""

from __future__ import annotations

import random

import pytest

from benchmarks.speedup import METHODS, Recorded, explain, film, larger, load, simulate
from workers.jobs.replay import TimedTask as Timed


def _job(*tasks: Timed, dispatch_s: float = 0.0) -> Recorded:
    steps = tuple(f"s{n}" for n in range(1 + max(task.step for task in tasks)))
    return Recorded("toy", "clip", 10, (64, 36), steps, dispatch_s, tasks)


def test_tasks_are_assigned_to_workers_in_plan_order() -> None:
    job = _job(*(Timed(0, f"t{n}", seconds) for n, seconds in enumerate((3.0, 1.0, 1.0, 1.0))))
    assert [simulate(job, workers) for workers in (1, 2, 3, 4)] == [6.0, 3.0, 3.0, 3.0]


def test_a_chain_is_no_faster_with_more_workers() -> None:
    job = _job(Timed(0, "a", 1.0), Timed(0, "b", 2.0, ("a",)), Timed(0, "c", 3.0, ("b",)), Timed(0, "d", 1.0))
    assert [simulate(job, workers) for workers in (1, 2, 64)] == [7.0, 6.0, 6.0]
    assert explain(job, 64).limit == "`s0`, the longest chain of 4 tasks: 100 % of the longest path"


def test_a_step_waits_for_the_whole_step_before() -> None:
    job = _job(Timed(0, "a", 1.0), Timed(0, "b", 4.0), Timed(1, "c", 1.0), Timed(1, "d", 1.0))
    assert [simulate(job, workers) for workers in (1, 2, 9)] == [7.0, 5.0, 5.0]


def test_claims_are_serialised_by_the_database() -> None:
    job = _job(*(Timed(0, f"t{n}", 1.0) for n in range(100)), dispatch_s=0.1)
    assert simulate(job, 100) == pytest.approx(100 * 0.1 + 1.0)
    assert explain(job, 512).limit == "the database's claims"
    assert explain(job, 2).limit == "workers"


@pytest.mark.parametrize("seed", range(20))
def test_simulated_runs_respect_their_lower_bounds(seed: int) -> None:
    draw = random.Random(seed)
    tasks = [
        Timed(step, f"t{step}-{n}", draw.uniform(0.1, 3), (f"t{step}-{draw.randrange(n)}",) if n % 3 else ())
        for step in range(3)
        for n in range(12)
    ]
    job = _job(*tasks)
    for workers in (1, 2, 3, 8, 100):
        assert simulate(job, workers) >= job.work_s / workers - 1e-9
        assert simulate(job, workers) >= simulate(job, 1000) - 1e-9
        assert simulate(job, workers) <= job.work_s + 1e-9
    assert simulate(job, 1) == pytest.approx(job.work_s)


@pytest.mark.parametrize("name", METHODS)
def test_a_longer_film_has_a_higher_speedup(name: str) -> None:
    clip = load(name)
    long = film(larger(clip, 1280), 10)
    assert len({(task.step, task.key) for task in long.tasks}) == len(long.tasks)
    assert long.frames == 10 * clip.frames
    assert simulate(long, 1) / simulate(long, 16) > simulate(clip, 1) / simulate(clip, 16)
    assert simulate(long, 1) / simulate(long, 2) > 1.8, "two workers"
