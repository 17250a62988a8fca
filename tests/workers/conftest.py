"""A farm with the toy method, and helpers that advance time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pipeline.video.probe import probe
from tests.databases import migrated_sqlite
from tests.waiting import until
from tests.workers.toy import Toy, ToyRunner
from workers.blobs.disk import DiskBlobs
from workers.contract.record import Job
from workers.contract.request import JobRequest
from workers.farm import Farm
from workers.pools.local_pool import LocalPool
from workers.settings import FarmSettings


@pytest.fixture(autouse=True)
def only_toy(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {"toy": Toy()}
    monkeypatch.setattr("pipeline.methods.methods", lambda: found)


@pytest.fixture(autouse=True)
def quick_probe(monkeypatch: pytest.MonkeyPatch) -> None:
    """Decode in this process: starting a child that imports every decoder takes longer than these tests."""
    monkeypatch.setattr("workers.farm.probe_guarded", probe)


@pytest.fixture
def settings(tmp_path: Path) -> FarmSettings:
    return FarmSettings(home=tmp_path / "home", workers=2, retry_delay_s=0.02, reserve_bytes=0)


@pytest.fixture
def open_farm(settings: FarmSettings) -> Iterator[Callable[..., Farm]]:
    """Opens and starts farms; stops them at the end."""
    opened: list[Farm] = []

    def open_one(start: bool = True, **changes: Any) -> Farm:
        chosen = settings.model_copy(update=changes)
        if not (chosen.home / "impasto.db").exists():
            migrated_sqlite(chosen.home / "impasto.db")
        blobs = DiskBlobs(chosen.blobs_at)
        farm = Farm(chosen, LocalPool(lambda number: ToyRunner(blobs), chosen.workers))
        opened.append(farm)
        if start:
            farm.start()
        return farm

    yield open_one
    for farm in opened:
        farm.stop()


@pytest.fixture
def farm(open_farm: Callable[..., Farm]) -> Farm:
    return open_farm()


@pytest.fixture
def data(tmp_path: Path) -> Path:
    path = tmp_path / "data.json"
    path.write_text('{"cat": 1}')
    return path


def request_on(farm: Farm, data: Path, owner: str = "", **changes: Any) -> JobRequest:
    """A request of the toy method on `data`, as an asset of `owner`."""
    asset = farm.assets.add(data, "data.json", owner)
    return JobRequest(**{"method": "toy", "inputs": {"data": asset.id}, "seed": 7, **changes})


def finished(farm: Farm, job_id: str, timeout_s: float = 20.0) -> Job:
    """The job once it is final."""
    return until(lambda: (job := farm.jobs.get(job_id)).state.final and job, timeout_s)


def result(farm: Farm, job_id: str) -> bytes:
    return b"".join(farm.files.read(farm.files.get(job_id, "result")))
