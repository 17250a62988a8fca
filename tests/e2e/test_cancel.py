"""A cancellation reaches a running task within a second on an idle machine, from HTTP to the worker."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import av
import httpx
import pytest

from pipeline.scenes import scene
from service.settings import Settings
from tests.service.live import running
from tests.waiting import SLOWER
from workers.execution.warm_up import warm_up_process
from workers.farm import Farm, open_farm

pytestmark = pytest.mark.serial

FRAMES, SIZE = 12000, (320, 180)
"""Minutes of work, so that no step ends before it is cancelled: fast machines scan 3,000 frames in a second."""
WITHIN_S = 1.0


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene of 24 frames, looped."""
    path = tmp_path_factory.mktemp("cancel") / "long.mp4"
    pictures = [shot.image for shot in scene("shapes", size=SIZE, frames=24)]
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=24, options={"preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for index in range(FRAMES):
            out.mux(stream.encode(av.VideoFrame.from_ndarray(pictures[index % 24], format="rgb24")))
        out.mux(stream.encode(None))
    return path


@pytest.fixture(scope="module", params=["local", pytest.param("ray", marks=pytest.mark.real("ray"))])
def farm(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    warm_up_process()  # a worker that compiles kernels, once on a new machine, cannot stop before it has
    home = tmp_path_factory.mktemp(f"home-{request.param}")
    farm = open_farm(Settings(home=home, pool=request.param, workers=1))
    farm.start()
    yield farm
    farm.stop()


@pytest.fixture(scope="module")
def http(farm: Farm, tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    settings = Settings(home=tmp_path_factory.mktemp("service"))
    with running(settings, farm) as url, httpx.Client(base_url=url, timeout=60) as client:
        yield client


def until(ask: Callable[[], Any], timeout_s: float) -> float:
    """Seconds until `condition` is true for the first time."""
    began = time.monotonic()
    while not ask():
        assert time.monotonic() < began + timeout_s, "it did not happen in time"
        time.sleep(0.01)
    return time.monotonic() - began


@pytest.mark.parametrize(("step", "after"), [("scan", 0.1), ("abstract", 0.0), ("abstract", 0.004)])
def test_cancel_frees_the_worker_within_a_second(
    http: httpx.Client, farm: Farm, clip: Path, step: str, after: float
) -> None:
    """Cancel during the first pass, at the start of painting, and in the middle of painting."""
    with clip.open("rb") as file:
        video = http.post("/v1/assets", files={"file": ("long.mp4", file)}).json()["id"]
    job = http.post("/v1/jobs", json={"method": "abstraction", "inputs": {"video": video}}).json()["id"]
    until(lambda: reached(http.get(f"/v1/jobs/{job}").json(), step, after) and busy(farm), 120)
    assert http.post(f"/v1/jobs/{job}/cancel").json()["state"] == "cancelled"
    assert until(lambda: not busy(farm), 30) < SLOWER * WITHIN_S


def reached(job: dict[str, Any], step: str, after: float) -> bool:
    """True if the step is running and more than `after` (0..1) of it is done."""
    now = next(row for row in job["steps"] if row["name"] == step)
    return bool(now["counts"]["running"] and now["progress"] >= after)


def busy(farm: Farm) -> bool:
    return bool(farm.snapshot()["pool"]["busy"])
