"""Estimates: by frames and pixels of finished jobs, and none without."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from tests.workers.projects.documents import asset
from workers.model import Job, JobRequest, RunState
from workers.projects.estimates import Estimate, estimate

ASSETS = {found.id: found for found in (
    asset("a", "video", frames=100, width=640, height=360), asset("b", "video", frames=50, width=1280, height=720),
    asset("c", "video", frames=50, width=64, height=36),
)}  # fmt: skip


def _request(letter: str) -> JobRequest:
    return JobRequest("multistyle", {"video": "ast_" + letter * 64})


def _job(letter: str, seconds: float) -> Job:
    given: dict[str, Any] = {"id": "job_1", "state": RunState.SUCCEEDED, "request": _request(letter), "owner": ""}
    times = {"created_at": 0.0, "updated_at": 0.0, "started_at": 10.0, "finished_at": 10.0 + seconds}
    return Job(**given, **times, progress=1.0, eta_s=None, counts={}, steps=(), error=None, results=(), warnings=())


def test_the_estimate_scales_with_frames_and_pixels() -> None:
    finished = [_job("a", 20.0), _job("a", 60.0), _job("a", 40.0)]
    assert estimate(_request("b"), finished, ASSETS.__getitem__) == Estimate(50, 80.0, 3)


def test_the_estimate_ignores_unfinished_jobs() -> None:
    begun = replace(_job("a", 1.0), finished_at=None)
    assert estimate(_request("b"), [_job("c", 1.0), begun], ASSETS.__getitem__) == Estimate(50, None, 0)
