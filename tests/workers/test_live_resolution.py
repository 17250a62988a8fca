"""The working resolution, on timelines: a client at a constant rate, and a machine with given frame times."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from workers.live.resolution import FITTING_S, SCALES, FrameCost, FrameRateMeter, ResolutionLadder, deadline_s, scaled

FPS = 30.0


def drive(
    ladder: ResolutionLadder,
    seconds: float,
    cost_s: Callable[[float, float], float],
    start_s: float = 0.0,
    fps: float = FPS,
) -> list[tuple[float, float, float]]:
    """Frames at `fps` that cost `cost_s(scale, now)`, half in each stage; stages overlap as in `FramePolicy`.

    Gives (time, scale, latency) of those that were painted.
    """
    analysis_free, paint_free, answers = 0.0, 0.0, []
    for number in range(int(seconds * fps)):
        came = start_s + number / fps
        begins = max(came, analysis_free)
        if begins > came + 1 / fps:
            continue  # a newer one took its place
        rung, half = ladder.rung, cost_s(ladder.scale, came) / 2
        analysis_free = begins + half
        paint_free = max(analysis_free, paint_free) + half
        analysis_free = max(analysis_free, paint_free - half)
        answers.append((came, ladder.scale, paint_free - came))
        ladder.painted(paint_free, 1 / fps, paint_free - came, split_cost(2 * half), rung)
    return answers


def split_cost(whole_s: float) -> FrameCost:
    return FrameCost(0.0, whole_s / 2, whole_s / 2)


def by_side(full_s: float) -> Callable[[float, float], float]:
    return lambda scale, now: full_s * scale


def test_a_fast_machine_stays_at_full_size() -> None:
    ladder = ResolutionLadder()
    assert {scale for _, scale, _ in drive(ladder, 20, by_side(0.025))} == {1.0}


def test_at_60_fps_analysis_and_painting_may_overlap_for_two_periods() -> None:
    ladder = ResolutionLadder()
    drive(ladder, 10, by_side(0.026), fps=60)
    assert ladder.scale == 1.0
    drive(ladder, 3, by_side(0.040), start_s=10, fps=60)
    assert ladder.scale < 1.0, "a half takes more than a period"


def test_the_deadline_depends_on_the_frame_rate() -> None:
    assert [round(1000 * deadline_s(1 / fps), 1) for fps in (15, 30, 60, 120)] == [66.7, 33.3, 33.3, 16.7]


def test_decoding_does_not_get_cheaper_at_a_smaller_size() -> None:
    smaller = FrameCost(0.01, 0.02, 0.03).at(0.5)
    assert smaller.decode_s == 0.01
    assert smaller.analyze_s < 0.01 and smaller.paint_s < 0.015
    assert FrameCost.of({"decode": 1, "analyze": 2, "paint": 3, "encode": 4}) == FrameCost(1, 2, 7)


def test_an_overloaded_machine_steps_down_within_a_second_and_stays_below_two_periods() -> None:
    ladder = ResolutionLadder()
    answers = drive(ladder, 10, by_side(0.1))
    later = [latency for came, _, latency in answers if came > 1.0]
    assert max(later) <= 2 / FPS
    assert ladder.scale <= 0.375


def test_without_adaptive_the_size_stays() -> None:
    ladder = ResolutionLadder(adaptive=False)
    drive(ladder, 5, by_side(0.2))
    assert ladder.scale == 1.0


def test_slow_first_frames_do_not_lower_the_size() -> None:
    ladder = ResolutionLadder()
    drive(ladder, 5, lambda scale, now: 0.12 if now < 0.2 else 0.02)
    assert ladder.scale == 1.0


@pytest.mark.parametrize(("every", "stays"), [(400, True), (60, False)])
def test_rare_slow_frames_are_tolerated_below_one_percent(every: int, stays: bool) -> None:
    ladder = ResolutionLadder()
    answers = drive(ladder, 30, lambda scale, now: 0.06 if round(now * FPS) % every == every - 1 else 0.02)
    assert ({scale for _, scale, _ in answers} == {1.0}) == stays


def test_a_size_that_lasts_only_seconds_has_failed() -> None:
    ladder = ResolutionLadder()
    answers = drive(ladder, 600, lambda scale, now: 0.03 + 0.01 * (int(now) % 12 == 11) if scale == 1 else 0.018)
    rises = sum(scale > before for (_, scale, _), (_, before, _) in zip(answers[1:], answers, strict=False))
    late = sum(latency > 1 / FPS for _, _, latency in answers)
    assert rises <= 10
    assert late < 0.01 * len(answers)


def test_the_size_rises_again_after_the_load_ends() -> None:
    ladder = ResolutionLadder()
    drive(ladder, 3, by_side(0.08))
    assert ladder.scale < 1
    drive(ladder, 4 * FITTING_S, by_side(0.02), start_s=3)
    assert ladder.scale == 1.0


def test_failed_steps_up_become_less_frequent() -> None:
    """Full size costs far more than extrapolation from the smaller size predicts."""
    ladder = ResolutionLadder()
    answers = drive(ladder, 240, lambda scale, now: 0.06 if scale == 1 else 0.015)
    tries = [came for (came, scale, _), (_, before, _) in zip(answers[1:], answers, strict=False) if scale > before]
    waits = [b - a for a, b in pairwise(tries)]
    assert 3 <= len(tries) <= 8
    assert waits[-1] > 4 * waits[0]


@pytest.mark.parametrize("adaptive", [True, False])
@pytest.mark.parametrize(("whole_s", "hurried"), [(0.020, False), (0.050, True)])
def test_frames_overlap_only_when_the_cost_requires_it(whole_s: float, hurried: bool, adaptive: bool) -> None:
    ladder = ResolutionLadder(adaptive)
    assert not ladder.is_behind(0.0, 1 / FPS), "nothing is known"
    for i in range(20):
        ladder.painted(i / FPS, 1 / FPS, 0.03, split_cost(whole_s), 0)
    assert ladder.is_behind(20 / FPS, 1 / FPS) == hurried


def test_the_reason_is_reported() -> None:
    ladder = ResolutionLadder()
    ladder.painted(0.0, 1 / FPS, 0.1, split_cost(0.1), 0)
    changes = [ladder.painted(1.0 + i / FPS, 1 / FPS, 0.1, split_cost(0.1), ladder.rung) for i in range(2)]
    assert changes == [None, "slow"]
    began = 2.0
    changes = [
        ladder.painted(began + i / FPS, 1 / FPS, 0.004, split_cost(0.004), ladder.rung) for i in range(int(5 * FPS))
    ]
    assert "room" in changes


def test_frames_begun_at_another_size_are_not_counted() -> None:
    ladder = ResolutionLadder(rung=2)
    for i in range(100):
        ladder.painted(i / FPS, 1 / FPS, 1.0, split_cost(1.0), 0)
    assert ladder.rung == 2


@given(st.floats(0.001, 0.5), st.floats(0.3, 2.0))
def test_the_delay_falls_until_the_smallest_size_is_reached(full_s: float, power: float) -> None:
    ladder = ResolutionLadder()
    answers = drive(ladder, 8, lambda scale, now: full_s * scale**power)
    tail = [latency for came, _, latency in answers if came > 6]
    assert ladder.rung == len(SCALES) - 1 or max(tail) <= 2 / FPS


@pytest.mark.parametrize("scale", SCALES)
def test_sizes_below_full_are_even(scale: float) -> None:
    for size in ((640, 480), (641, 359), (17, 16), (1280, 720)):
        width, height = scaled(size, scale)
        assert (width, height) == size if scale == 1 else width % 2 == height % 2 == 0
        assert min(width, height) >= 16


def test_the_measured_frame_rate_is_limited_by_the_announced_one() -> None:
    def period(fps: float, count: int = 90) -> float:
        pace = FrameRateMeter(30)
        for i in range(count):
            pace.arrived(i / fps)
        return pace.period_s

    assert period(15) == pytest.approx(1 / 15)
    assert period(90) == pytest.approx(1 / 30)
    assert period(15, count=1) == pytest.approx(1 / 30)
