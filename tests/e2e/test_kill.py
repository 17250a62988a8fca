"""kill -9 of the whole process tree at random points: the job ends, its bytes are those of an undisturbed run.

Three deaths of a small job here; `python -m benchmarks kill9` is the long version, ten deaths of each kind.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from impasto.cli.app import run
from pipeline.methods import methods
from tests.e2e.killing import RENDER, KillPoint, job_words, kill_points, render_killed, serve_killed
from tests.e2e.pages import make_two_shots

FRAMES = 240
"""Two shots of 120 frames: a chain of two tasks each."""
FEW_FRAMES = 28
"""For the other methods: two shots, of two runs each where runs have twelve frames."""


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_two_shots(tmp_path_factory.mktemp("kill") / "cut.mp4", FRAMES)


@pytest.fixture(scope="module")
def undisturbed(clip: Path) -> bytes:
    out = clip.with_name("undisturbed.mp4")
    assert run(["render", str(clip), "-o", str(out), "--home", f"{out}.home", *RENDER]) == 0
    return out.read_bytes()


def test_a_render_survives_kill_9(clip: Path, undisturbed: bytes, tmp_path: Path) -> None:
    out = tmp_path / "out.mp4"
    points = [KillPoint(0, 1.0), *kill_points(2, 0.8 * FRAMES, 0.1, seed=2)]
    deaths = render_killed(clip, out, tmp_path / "home", points)
    assert out.read_bytes() == undisturbed
    assert deaths[-1].frames > 0, "one death at least was in the middle of the work"


@pytest.mark.parametrize("method", sorted({*methods()} - {"abstraction"}))
def test_a_render_of_every_method_survives_kill_9(method: str, tmp_path: Path) -> None:
    clip, out, whole = make_two_shots(tmp_path / "cut.mp4", FEW_FRAMES), tmp_path / "out.mp4", tmp_path / "whole.mp4"
    words = ["render", str(clip), "-o", str(whole), "--home", f"{whole}.home", *job_words(method, clip), *RENDER]
    assert run([*words, "--workers", "1"]) == 0
    deaths = render_killed(clip, out, tmp_path / "home", [KillPoint(0.3 * FEW_FRAMES, 0.0)], method)
    assert out.read_bytes() == whole.read_bytes(), "two workers, one of them killed, paint what one paints"
    assert deaths[-1].frames > 0


def test_a_service_and_its_client_survive_kill_9(clip: Path, undisturbed: bytes, tmp_path: Path) -> None:
    out = tmp_path / "out.mp4"
    deaths = serve_killed(clip, out, tmp_path / "home", "local", kill_points(3, 0.8 * FRAMES, 0.1, seed=3))
    assert out.read_bytes() == undisturbed
    assert deaths[-1].frames > 0
