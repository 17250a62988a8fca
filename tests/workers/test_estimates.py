"""Estimates from frames and pixels of finished jobs, or from the method's own figures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from pipeline.methods import method
from pipeline.methods.base import PROCESS_BYTES
from pipeline.video.media import SourceOptions
from tests.workers.projects.documents import asset
from workers.contract.record import AnyOwner, Asset, Job, RunState, StepView
from workers.contract.request import JobRequest
from workers.jobs.estimates import Estimate, MeasuredJob, estimate_from, measured

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
