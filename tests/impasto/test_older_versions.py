"""Farms that older versions of Impasto left in the middle of their work: this one finishes it with its own frames."""

from __future__ import annotations

import dataclasses
import tarfile
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.waiting import until
from workers.farm import Farm, open_farm
from workers.settings import FarmSettings

OLDER = ROOT / "tests" / "workers" / "older"
"""Made by its `make.py`, one file for each version."""
LIMIT_S = 300.0


def _finished(farm: Farm, job_id: str) -> bytes:
    job = until(lambda: (job := farm.jobs.get(job_id)).state.final and job, LIMIT_S)
    assert job.state == "succeeded", (job.request.method, job.error)
    return b"".join(farm.files.read(farm.files.get(job_id, "result")))


@pytest.mark.parametrize("version", sorted(path.name.partition(".")[0] for path in OLDER.glob("*.tar.xz")))
def test_the_work_of_an_older_version_is_finished(version: str, tmp_path: Path) -> None:
    with tarfile.open(OLDER / f"{version}.tar.xz") as archive:
        archive.extractall(tmp_path, filter="data")
    settings = FarmSettings(home=tmp_path, workers=2, reserve_bytes=0, warm_up=False)
    farm = open_farm(settings)
    begun = farm.jobs.page(limit=50).items
    assert {"abstraction", "multistyle", "patches", "analogy"} <= {job.request.method for job in begun}
    lost = {job.id for job in begun if any(step.counts["succeeded"] for step in job.steps)}
    farm.start()
    try:
        for job in begun:
            fresh = farm.jobs.submit(dataclasses.replace(job.request, name="fresh")).id
            assert _finished(farm, job.id) == _finished(farm, fresh), job.request.method
            told = [warning.code for warning in farm.jobs.get(job.id).warnings]
            assert told == (["planned-again"] if job.id in lost else told)
            failed = [task for task in farm.tasks.page(job.id).items if len(task.attempts) != 1]
            assert not failed, "no attempt is charged"
        assert farm.validate_state() == []
    finally:
        farm.stop()
