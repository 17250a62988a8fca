"""kill -9 of the whole process tree at random points: the job ends, its bytes are those of an undisturbed run.

Three deaths of a small job here; `python -m benchmarks kill9` is the long version, ten deaths of each kind.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from impasto.cli.app import run
from tests.e2e.killing import RENDER, kill_points, render_killed, serve_killed
from tests.e2e.pages import make_two_shots

FRAMES = 240
"""Two shots of 120 frames: a chain of two tasks each."""


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
    deaths = render_killed(clip, out, tmp_path / "home", kill_points(3, 0.8 * FRAMES, 0.1, seed=2))
    assert out.read_bytes() == undisturbed
    assert deaths[-1].frames > 0, "one death at least was in the middle of the work"


def test_a_service_and_its_client_survive_kill_9(clip: Path, undisturbed: bytes, tmp_path: Path) -> None:
    out = tmp_path / "out.mp4"
    deaths = serve_killed(clip, out, tmp_path / "home", "local", kill_points(3, 0.8 * FRAMES, 0.1, seed=3))
    assert out.read_bytes() == undisturbed
    assert deaths[-1].frames > 0
