"""A render finds its job again by its key, whatever the state of the job."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from impasto.cli import private_farm
from impasto.cli.console import Interrupted
from impasto.cli.input_files import gather
from impasto_client.errors import JobFailed
from workers.contract.record import RunState
from workers.contract.request import JobRequest
from workers.farm import Farm, open_farm
from workers.settings import FarmSettings

REQUEST = JobRequest("abstraction", {}, {"lines": "off"})


def submit(farm: Farm, clip: Path, scratch: Path) -> Any:
    return private_farm.submit(farm, REQUEST, {"video": gather("IN", clip, scratch)}, "key")


def test_inputs_are_checked_two_at_a_time(
    tiny_clip: Path, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    picture = tmp_path / "reference.png"
    cv2.imwrite(str(picture), np.full((48, 64, 3), 90, np.uint8))
    farm, together = open_farm(FarmSettings(home=home, pool="none")), threading.Barrier(2, timeout=20)
    add = farm.assets.add

    def added(path: Path, filename: str, **known: Any) -> Any:
        together.wait()
        return add(path, filename, **known)

    monkeypatch.setattr(farm.assets, "add", added)
    paths = {"video": tiny_clip, "reference": picture}
    job = private_farm.submit(farm, REQUEST, {name: gather(name, path, tmp_path) for name, path in paths.items()}, "k")
    assert set(job.request.inputs) == {"video", "reference"}
    farm.stop()


def test_a_cancelled_job_is_resumed(tiny_clip: Path, home: Path, tmp_path: Path) -> None:
    idle = open_farm(FarmSettings(home=home, pool="none"))
    job = submit(idle, tiny_clip, tmp_path)
    assert submit(idle, tiny_clip, tmp_path).id == job.id
    idle.jobs.cancel(job.id)
    idle.stop()
    shown: list[float] = []
    with private_farm.opened(home, 1) as farm:
        again = submit(farm, tiny_clip, tmp_path)
        assert again.id == job.id
        done = private_farm.follow(farm, job.id, lambda now: shown.append(now["progress"]))
    assert done.state is RunState.SUCCEEDED
    assert shown == sorted(shown)
    assert shown[-1] == 1.0


def test_a_job_without_a_result_is_a_failure_with_its_reason(tiny_clip: Path, home: Path, tmp_path: Path) -> None:
    farm = open_farm(FarmSettings(home=home, pool="none"))
    job = submit(farm, tiny_clip, tmp_path)
    farm.jobs.cancel(job.id)
    with pytest.raises(JobFailed) as caught:
        private_farm.follow(farm, job.id, lambda now: None)
    assert caught.value.job["state"] == "cancelled"
    farm.stop()


def test_ctrl_c_reports_progress_and_how_to_resume(
    tiny_clip: Path, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    farm = open_farm(FarmSettings(home=home, pool="none"))
    job = submit(farm, tiny_clip, tmp_path)

    def ctrl_c(*_: object, **__: object) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(farm.jobs, "wait_for_event", ctrl_c)
    with pytest.raises(Interrupted, match="0%") as caught:
        private_farm.follow(farm, job.id, lambda now: None)
    assert "same command" in caught.value.remedy
    assert farm.jobs.get(job.id).state is RunState.QUEUED
    farm.stop()
