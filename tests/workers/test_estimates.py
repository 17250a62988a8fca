"""Estimates from frames and pixels of finished jobs, or from the method's own figures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from impasto.cli.estimating import estimate_render
from pipeline.methods import method
from pipeline.methods.base import PROCESS_BYTES, Task
from pipeline.video.media import SourceOptions
from tests.workers.projects.documents import asset
from workers.contract.record import AnyOwner, Asset, Job, RunState, StepView
from workers.contract.request import JobRequest
from workers.jobs.estimates import Estimate, MeasuredJob, MeasuredPreview, estimate_from, measured
from workers.jobs.wall_time import OneByOne
from workers.previews import costs
from workers.previews.costs import StepCost, TaskClock, longest_chain, whole_cost

ASSETS = {found.id: found for found in (
    asset("a", "video", frames=100, width=640, height=360), asset("b", "video", frames=50, width=1280, height=720),
    asset("c", "video", frames=50, width=64, height=36),
)}  # fmt: skip


def _find(asset_id: str, owner: str | AnyOwner) -> Asset:
    assert owner == "", "each job's own owner"
    return ASSETS[asset_id]


def _request(letter: str) -> JobRequest:
    return JobRequest("toy", {"video": "ast_" + letter * 64})


def _job(letter: str, seconds: float) -> Job:
    given: dict[str, Any] = {"id": "job_1", "state": RunState.SUCCEEDED, "request": _request(letter), "owner": ""}
    times = {"created_at": 0.0, "updated_at": 0.0, "started_at": 10.0, "finished_at": 10.0 + seconds}
    return Job(**given, **times, progress=1.0, eta_s=None, counts={}, steps=(), error=None, results=(), warnings=())


def _estimate(request: JobRequest, finished: list[Job]) -> Estimate:
    found = (measured(job, _find) for job in finished)
    video = ASSETS.get(request.inputs.get("video", ""))
    return estimate_from(request, video.info if video else None, [each for each in found if each is not None])


def test_the_estimate_scales_with_frames_and_pixels() -> None:
    finished = [_job("a", 20.0), _job("a", 60.0), _job("a", 40.0)]
    found = _estimate(_request("b"), finished)
    assert (found.frames, found.samples) == (50, 3)
    assert found.seconds == pytest.approx(2 * 36.3, abs=0.2), "twice the frames times pixels, geometric mean"


def test_cpu_time_and_memory_are_those_of_the_steps_of_finished_jobs() -> None:
    steps = tuple(
        StepView(name, name, "succeeded", {}, 1.0, 1.0, {}, cpu_s=cpu_s, peak_bytes=peak)
        for name, cpu_s, peak in (("scan", 3.0, 700), ("paint", 17.0, 500))
    )
    found = _estimate(_request("b"), [replace(_job("a", 9.0), steps=steps)])
    assert found.cpu_s == pytest.approx(40.0) and found.memory_bytes == 700, "twice the frames times pixels"


def test_without_similar_jobs_the_estimate_is_the_methods_own() -> None:
    begun = replace(_job("a", 1.0), finished_at=None)
    found = _estimate(_request("b"), [_job("c", 1.0), begun])
    rate = method("toy").cpu_s_per_megapixel
    assert (found.frames, found.samples) == (50, 0)
    assert found.cpu_s == found.seconds == pytest.approx(1 + rate * 50 * 1280 * 720 / 1e6, abs=0.1)
    assert found.memory_bytes == PROCESS_BYTES, "the toy declares none"
    assert found.disk_bytes is not None and found.disk_bytes > 50 * 1280 * 720 * 0.1


def test_jobs_with_the_same_parameters_are_preferred() -> None:
    dear = replace(_request("a"), params={"tasks": 9})
    finished = [_job("a", 10.0), replace(_job("a", 90.0), request=dear), _job("a", 12.0)]
    asked = replace(_request("a"), params={"tasks": 9})
    assert _estimate(asked, finished).seconds == 90.0
    assert _estimate(_request("a"), finished).seconds == pytest.approx(11.0, abs=0.1)


def _measured(frames: int, width: int, seconds: float) -> MeasuredJob:
    return MeasuredJob({}, frames, width * width, seconds, seconds, 1)


def _cpu_s(history: list[MeasuredJob], frames: int, width: int, name: str = "toy") -> float:
    found = estimate_from(JobRequest(name, {}), {"frames": frames, "width": width, "height": width}, history)
    assert found.cpu_s is not None
    return found.cpu_s


def test_time_grows_with_pixels_as_the_method_says_until_jobs_of_several_sizes_tell_more() -> None:
    assert _cpu_s([_measured(10, 200, 2.0)], 10, 400) == pytest.approx(8.0), "the toy's time is proportional"
    growth = method("patches").cpu_growth
    assert growth < 1
    assert _cpu_s([_measured(10, 200, 2.0)], 10, 400, "patches") == pytest.approx(2 * 4**growth, rel=0.01)
    flat = [_measured(10, width, 2.0) for width in (150, 250, 350, 450)]
    assert _cpu_s(flat, 10, 450) < 3, "four jobs whose time does not grow with pixels"


def test_two_jobs_whose_content_differs_do_not_tell_how_time_grows_with_pixels() -> None:
    """Similar frame sizes, of which the larger was cheaper: extrapolating that to small frames would be absurd."""
    assert _cpu_s([_measured(30, 416, 4.4), _measured(24, 554, 3.5)], 40, 277) < 4.0


def test_short_jobs_tell_what_a_job_costs_once() -> None:
    history = [_measured(frames, 300, 1.0 + 0.1 * frames) for frames in (2, 5, 10, 100, 200)]
    for frames in (3, 50, 400):
        assert _cpu_s(history, frames, 300) == pytest.approx(1.0 + 0.1 * frames, rel=0.3)


def test_a_tiny_job_does_not_tell_what_a_large_one_takes() -> None:
    start_up = _measured(6, 160, 4.4)
    assert _cpu_s([start_up], 24, 352) == pytest.approx(_cpu_s([], 24, 352)), "the method's own figure"
    assert _cpu_s([start_up], 12, 200) > 2 * _cpu_s([], 12, 200)


def test_an_unknown_video_gives_no_estimate() -> None:
    assert _estimate(JobRequest("toy", {}), []) == Estimate(None, None, 0)


def test_the_estimate_is_of_the_picture_that_is_read() -> None:
    """Of a file with several pictures, and of a piece of it."""
    streams = [{"frames": 100, "width": 640, "height": 360}, {"frames": 60, "width": 64, "height": 36}]
    info = {"frames": 100, "width": 640, "height": 360, "streams": streams}
    first, second = (
        estimate_from(JobRequest("abstraction", {"video": "a"}, source=SourceOptions(picture)), info, [])
        for picture in (0, 1)
    )
    assert (first.frames, second.frames) == (100, 60)
    assert first.cpu_s is not None and second.cpu_s is not None and first.cpu_s > 3 * second.cpu_s
    piece = JobRequest("abstraction", {"video": "a"}, frames=(50, 90), source=SourceOptions(1))
    assert estimate_from(piece, info, []).frames == 10


def _previewed(
    request: JobRequest, shown: list[MeasuredPreview], history: list[MeasuredJob], slots: int = 1
) -> Estimate:
    return estimate_from(request, {"frames": 100, "width": 800, "height": 400}, history, shown, slots)


def _shown(seconds: float, width: float = 1.0, idle: float = 0.0) -> MeasuredPreview:
    """A preview of half the size with 8 CPU seconds."""
    return MeasuredPreview({}, 100, 400 * 200, seconds, 8.0, 0, OneByOne(width, idle))


def test_a_preview_of_the_same_film_tells_more_than_other_jobs() -> None:
    other = MeasuredPreview({"tasks": 5}, 100, 400 * 200, 99.0, 99.0, 0, OneByOne(1.0, 0.0))
    alone = _previewed(JobRequest("toy", {}), [other, _shown(10.0)], [])
    assert (alone.samples, alone.cpu_s, alone.seconds) == (1, 32.0, 41.0), "four times the pixels; a second to start"
    jobs = [MeasuredJob({}, 100, 800 * 400, 30.0, 60.0, 700)]
    beside = _previewed(JobRequest("toy", {}), [_shown(10.0)], jobs)
    assert (beside.cpu_s, beside.seconds, beside.memory_bytes) == (32.0, 41.0, 700), "jobs ran at other times"
    assert _previewed(JobRequest("toy", {}, {"tasks": 9}), [_shown(10.0)], []).samples == 0, "it has other parameters"


@pytest.mark.parametrize(
    ("seconds", "width", "idle", "slots", "expected"),
    [
        (8.0, 9.0, 1.0, 2, 16.0),  # one processor was idle: two tasks at once take half of the time
        (8.0, 1.0, 1.0, 2, 32.0),  # each task waits for the one before it
        (8.0, 9.0, 3.0, 4, 8.0),
        (20.0, 9.0, 0.0, 2, 80 / (2 / 1.2)),  # 0.4 of a processor: four threads of others on two processors, later 2:4
        (4.0, 9.0, 0.0, 2, 16.0),  # a task that uses all processors
    ],
)
def test_wall_seconds_are_those_of_tasks_that_run_at_once_beside_other_work(
    seconds: float, width: float, idle: float, slots: int, expected: float
) -> None:
    found = _previewed(JobRequest("toy", {}), [_shown(seconds, width, idle)], [], slots)
    assert found.seconds == pytest.approx(1 + expected, abs=0.1)


def test_the_longest_chain_of_tasks_that_wait_for_each_other() -> None:
    tasks = [Task("a", weight=2), Task("b", after=("a", "scan/video"), weight=3), Task("c", weight=4)]
    assert longest_chain({task.key: task for task in tasks}) == 5 and longest_chain({}) == 0


def test_layers_cost_what_their_methods_cost_together(tiny_clip: Path, tmp_path: Path) -> None:
    rows: Any = [{"method": "abstraction", "params": {}}, {"method": "patches", "params": {"temporal": "off"}}]
    requests = [JobRequest("layers", {}, {"layers": rows})]
    requests += [JobRequest(row["method"], {}, row["params"]) for row in rows]
    together, *alone = (estimate_render(request, tiny_clip, tmp_path) for request in requests)
    assert together["cpu_s"] == pytest.approx(sum(one["cpu_s"] for one in alone))
    assert together["memory_bytes"] == max(one["memory_bytes"] for one in alone)


def test_a_frame_of_which_less_is_analysed_costs_less() -> None:
    chosen = method("abstraction")
    below, above = (chosen.relative_cost(chosen.Params(), size) for size in ((960, 540), (1280, 720)))
    assert above < below < chosen.relative_cost(chosen.Params(analysis="full"), (1280, 720))  # type: ignore[call-arg]


def test_the_cost_of_a_film_is_that_of_its_tasks_by_weight() -> None:
    steps = {"scan": StepCost(2.0, 1.0, 0.5), "paint": StepCost(10.0, 20.0, 10.0)}
    found = whole_cost(steps, {"scan": 2.0, "paint": 40.0, "finish": 12.0})
    assert found is not None and (found.seconds, found.cpu_s) == pytest.approx((81 + 21, 40.5 + 10.5))
    assert whole_cost({}, {"scan": 2.0}) is None


def test_a_task_that_makes_another_one_run_counts_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter([0.0, 1.0, 4.0, 10.0, 11.0, 12.0])
    monkeypatch.setattr(costs.time, "perf_counter", lambda: next(times))
    clock, outer, inner = TaskClock(), StepCost(), StepCost()
    with clock.measured(outer, 5.0), clock.measured(inner, 2.0):
        pass
    assert (outer.weight, outer.seconds, inner.weight, inner.seconds) == (5.0, 7.0, 2.0, 3.0)
    with pytest.raises(KeyError), clock.measured(inner, 2.0):
        raise KeyError
