"""Progress and time left, over recorded lives of real jobs and invented bad ones.

`timelines/*.json` hold [seconds since the job was submitted, the fields of every step's StepMeter] at each change, as
recorded on two busy cores: a process that starts cold, so that the first task of a step reports little at first.
"""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from workers.store.progress import StepMeter, job_eta_s, job_progress, recent_pace_s

TIMELINES = sorted((Path(__file__).parent / "timelines").glob("*.json"))
Timeline = list[tuple[float, list[StepMeter]]]


@pytest.fixture(params=TIMELINES, ids=lambda path: path.stem)
def timeline(request: pytest.FixtureRequest) -> Timeline:
    return [(at, [StepMeter(*step) for step in steps]) for at, steps in json.loads(request.param.read_text())]


def unplanned(expected: float) -> StepMeter:
    return StepMeter(expected, 0.0, 0.0, 0.0, planned=False, done=False)


def done(weight: float, seconds: float, expected: float | None = None) -> StepMeter:
    return StepMeter(weight if expected is None else expected, weight, weight, seconds, planned=True, done=True)


def running(weight: float, part: float, seconds: float, at_once: int = 1, expected: float | None = None) -> StepMeter:
    known = weight if expected is None else expected
    return StepMeter(known, weight, 0.0, 0.0, True, False, at_once, weight * part, seconds)


def test_progress_of_recorded_jobs_never_decreases(timeline: Timeline) -> None:
    shown = [job_progress(steps) for _, steps in timeline]
    assert all(earlier <= later + 1e-9 for earlier, later in pairwise(shown))
    assert shown[0] == 0
    assert shown[-1] == 1


def test_the_time_left_of_recorded_jobs_converges(timeline: Timeline) -> None:
    end = timeline[-1][0]
    estimates = [(at, job_progress(steps), job_eta_s(steps)) for at, steps in timeline]
    wrong = [(at, done, abs(eta - (end - at))) for at, done, eta in estimates if eta is not None]
    assert max(error for _, _, error in wrong) < max(20.0, 2 * end), "a cold start is no reason for minutes"
    assert max(error for _, done, error in wrong if done > 0.5) < 0.4 * end + 1
    assert max(error for _, done, error in wrong if done > 0.9) < 0.1 * end + 0.5


def test_a_step_counts_by_its_weight() -> None:
    steps = [done(5, 1), running(100, 0.5, 10), unplanned(5)]
    assert job_progress(steps) == pytest.approx(55 / 110)
    assert job_eta_s(steps) == pytest.approx(55 * 0.2)


def test_more_work_than_expected_does_not_lower_progress() -> None:
    before = [replace(running(5, 0.99, 1)), unplanned(100), unplanned(5)]
    after = [done(5, 1), running(400, 0.0, 0.0, expected=100), unplanned(5)]
    assert job_progress(before) < job_progress(after) < 0.06
    end = [done(5, 1), done(400, 100, expected=100), running(20, 1.0, 1.0, expected=5)]
    assert job_progress(end) == pytest.approx(1)


def test_progress_skips_a_step_without_tasks() -> None:
    assert job_progress([done(5, 1), StepMeter(0, 0, 0, 0, True, True), unplanned(100)]) == pytest.approx(5 / 105)


def test_there_is_no_estimate_before_a_measurement() -> None:
    assert job_eta_s([running(5, 0.0, 3.0), unplanned(100)]) is None
    assert job_eta_s([running(5, 0.1, 3.0), unplanned(100)]) is None, "half a percent of the job"
    assert job_eta_s([done(5, 1), done(100, 9)]) == 0


def test_concurrent_tasks_divide_the_remaining_time() -> None:
    one, two = [running(100, 0.5, 10)], [running(100, 0.5, 10, at_once=2)]
    assert job_eta_s(one) == pytest.approx(10)
    assert job_eta_s(two) == pytest.approx(5)


def test_a_slow_first_frame_does_not_set_the_rate() -> None:
    cold = [done(5, 0.5), running(100, 0.01, 2.0), unplanned(5)]
    eta = job_eta_s(cold)
    assert eta is not None
    assert eta < 0.15 * 104 * 2 + 3, "200 s, if that frame were believed"


@pytest.mark.parametrize("later_s", [8.0, 2.0])
def test_the_time_left_of_a_long_job_follows_the_load(later_s: float) -> None:
    """1,000 tasks of 4 s; after half of them, other work begins or ends, and each takes twice or half as long."""
    step, at = StepMeter(1000, 1000, 0.0, 0.0, True, False, 1), 0.0
    seconds = [4.0] * 500 + [later_s] * 500
    wrong = []
    for number, each in enumerate(seconds):
        at += each
        pace = recent_pace_s(step.pace_s, each, 1.0)
        step = replace(step, weight_done=step.weight_done + 1, busy_s=step.busy_s + each, pace_s=pace)
        eta = job_eta_s([step])
        if 650 <= number < 990:
            assert eta is not None
            wrong.append(abs(eta - (sum(seconds) - at)) / (sum(seconds) - at))
    assert max(wrong) < 0.15, "the mean over the whole step is 20 to 70 % wrong"
