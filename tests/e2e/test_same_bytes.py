"""One worker and two, in this process and on Ray, write the same file byte for byte."""

from __future__ import annotations

from pathlib import Path

import pytest

from impasto.cli.app import run
from tests.e2e.pages import make_two_shots
from tests.e2e.processes import Service

FRAMES = 240
"""Two shots of 120 frames: a chain of two tasks each, so that two workers always have something each."""


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_two_shots(tmp_path_factory.mktemp("bytes") / "cut.mp4", FRAMES)


def render(clip: Path, out: Path, workers: int) -> bytes:
    words = ["render", str(clip), "-o", str(out), "--workers", str(workers), "--seed", "5", "--quiet"]
    assert run([*words, "--home", f"{out}.home"]) == 0
    return out.read_bytes()


@pytest.fixture(scope="module")
def by_one(clip: Path) -> bytes:
    """The result of one worker in this process."""
    return render(clip, clip.with_name("one.mp4"), 1)


def test_two_workers_give_the_same_bytes(clip: Path, by_one: bytes, tmp_path: Path) -> None:
    assert render(clip, tmp_path / "two.mp4", 2) == by_one


@pytest.mark.real("ray")
def test_two_workers_on_ray_give_the_same_bytes(clip: Path, by_one: bytes, tmp_path: Path) -> None:
    service = Service(tmp_path / "home", "ray", 2)
    service.start()
    try:
        service.wait_ready()
        with service.client() as client:
            video = client.upload(clip)
            job = client.submit("abstraction", {"video": video["id"]}, seed=5)
            ended = client.wait(job["id"])
            assert ended["steps"][2]["counts"]["succeeded"] == 4
            assert client.download(job["id"], tmp_path / "out.mp4").read_bytes() == by_one
    finally:
        service.stop()
