"""One worker and several, in this process and on Ray, write the same file byte for byte."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from impasto.cli.app import run
from pipeline.methods import methods
from tests.e2e.killing import job_words
from tests.e2e.pages import make_two_shots
from tests.e2e.processes import Service

FRAMES = 240
"""Two shots of 120 frames: a chain of two tasks each, so that two workers always have something each."""
FEW_FRAMES = 28
"""For every method: two shots, of two runs each where runs have twelve frames. tests/e2e/test_kill.py compares two
workers with one."""


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_two_shots(tmp_path_factory.mktemp("bytes") / "cut.mp4", FRAMES)


def render(clip: Path, out: Path, workers: int, method: str = "abstraction") -> bytes:
    words = ["render", str(clip), "-o", str(out), *job_words(method, clip), "--seed", "5", "--quiet"]
    assert run([*words, "--workers", str(workers), "--home", f"{out}.home"]) == 0
    return out.read_bytes()


@pytest.fixture(scope="module")
def by_one(clip: Path) -> bytes:
    """The result of one worker in this process."""
    return render(clip, clip.with_name("one.mp4"), 1)


def test_two_workers_give_the_same_bytes(clip: Path, by_one: bytes, tmp_path: Path) -> None:
    assert render(clip, tmp_path / "two.mp4", 2) == by_one


@pytest.mark.parametrize("method", sorted(methods()))
def test_three_workers_and_the_threads_of_a_large_machine_give_the_bytes_of_one(
    method: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = make_two_shots(tmp_path / "cut.mp4", FEW_FRAMES)
    one = render(clip, tmp_path / "one.mp4", 1, method)
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(range(8)))
    assert render(clip, tmp_path / "three.mp4", 3, method) == one


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
