"""Abstraction of large frames: analysed at half their size, drawn at their own."""

from __future__ import annotations

import io
import re
import zipfile
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.frames import Frame
from pipeline.methods import method
from pipeline.methods.abstraction import AbstractionParams, AbstractionSession, plan, sizes
from pipeline.methods.abstraction import session as abstraction_session
from pipeline.methods.abstraction.session import PipelinedRunner
from pipeline.methods.abstraction.sizes import sizes_of
from pipeline.methods.local import LocalContext, run_plan
from pipeline.scenes import scene
from tests.pipeline.methods.frames import painted

SIZE = (240, 160)
PARAMS = AbstractionParams(edges="sharp", line_width=10)
"""Lines of 1.6 px, which half the size can hold."""


@pytest.fixture(autouse=True)
def small_frames_are_large(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sizes, "HALVED_FROM_PX", SIZE[1])


@cache
def frames() -> list[Frame]:
    made = scene("portrait", SIZE, frames=8)
    return [made.image(index) for index in range(8)]


@cache
def stepped() -> list[Frame]:
    session = AbstractionSession(PARAMS, SIZE)
    assert session.sizes.work == (120, 80)
    return [session.step(frame) for frame in frames()]


@pytest.mark.parametrize(
    ("values", "frame", "output", "work"),
    [
        ({}, (1280, 720), None, (640, 360)),
        ({}, (1080, 1920), None, (540, 960)),
        ({}, (3841, 2161), None, (1920, 1080)),
        ({}, (1279, 719), None, (1279, 719)),
        ({"analysis": "full"}, (1280, 720), None, (1280, 720)),
        ({"edges": "soft"}, (1280, 720), None, (1280, 720)),
        ({"line_width": 1.9}, (1280, 720), None, (1280, 720)),
        ({"line_width": 1.9, "lines": "off"}, (1280, 720), None, (640, 360)),
        ({}, (960, 540), (1280, 720), (640, 360)),
        ({}, (480, 270), (1280, 720), (480, 270)),
    ],
)
def test_sizes(
    values: dict[str, Any], frame: tuple[int, int], output: tuple[int, int] | None, work: tuple[int, int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """The last two are a live session that works at a reduced size: it never analyses more pixels at a smaller size."""
    monkeypatch.setattr(sizes, "HALVED_FROM_PX", 720)
    assert sizes_of(AbstractionParams(**values), frame, output).work == work


def test_runs_of_any_length_equal_one_session(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "RUN_FRAMES", 3)
    context = LocalContext(PARAMS, frames())
    run_plan(method("abstraction"), context, shuffle=3)
    np.testing.assert_array_equal(painted(context), np.stack(stepped()))


@pytest.mark.parametrize("at", [1, 5])
def test_a_restored_session_continues_with_the_same_bytes(at: int) -> None:
    one, two = (AbstractionSession(PARAMS, SIZE) for _ in range(2))
    for frame in frames()[:at]:
        one.step(frame)
    two.restore({key: array.copy() for key, array in one.state().items()})
    for frame, wanted in zip(frames()[at:], stepped()[at:], strict=True):
        np.testing.assert_array_equal(two.step(frame), wanted)


@pytest.mark.parametrize("from_px", [100, 1000], ids=["large frames", "small frames"])
def test_pipelining_does_not_change_the_bytes(from_px: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(abstraction_session, "THIRD_THREAD_FROM_PX", from_px)
    session, one = AbstractionSession(PARAMS, SIZE), AbstractionSession(PARAMS, SIZE)
    with PipelinedRunner(session) as runner:
        made = [painting.frame for painting in runner.run(frames())]
    np.testing.assert_array_equal(np.stack(made), np.stack([one.step(frame) for frame in frames()]))
    state, wanted = session.state(), one.state()
    assert state.keys() == wanted.keys()
    for name, array in state.items():
        np.testing.assert_array_equal(array, wanted[name], err_msg=name)


def test_edges_are_as_sharp_as_of_a_full_analysis() -> None:
    session = AbstractionSession(PARAMS.model_copy(update={"analysis": "full"}), SIZE)
    full = [session.step(frame) for frame in frames()][-1]
    half = stepped()[-1]
    blurred = np.asarray(cv2.resize(cv2.resize(full, (120, 80), interpolation=cv2.INTER_AREA), SIZE), np.uint8)
    assert steepest(half) > 0.9 * steepest(full) > 1.3 * steepest(blurred)
    assert np.abs(half.astype(int) - full).mean() < 12


def steepest(frame: Frame) -> float:
    """Contrast of neighbouring pixels that one in two hundred pairs exceeds, gray levels."""
    return float(np.quantile(np.abs(np.diff(frame.mean(axis=2), axis=1)), 0.995))


def test_svg_pages_have_the_size_of_the_frames() -> None:
    context = LocalContext(PARAMS, frames()[:2], artefacts=frozenset({"svg"}))
    run_plan(method("abstraction"), context)
    (data,) = context.files.values()
    with zipfile.ZipFile(io.BytesIO(data)) as pages:
        page = pages.read("00001.svg").decode()
    assert f'viewBox="0 0 {SIZE[0]} {SIZE[1]}"' in page
    starts = np.array(re.findall(r"M([\d.]+) ([\d.]+)", page.split('id="lines"')[0]), float)
    assert SIZE[0] / 2 < starts[:, 0].max() <= SIZE[0] and SIZE[1] / 2 < starts[:, 1].max() <= SIZE[1]


def test_a_change_of_the_size_keeps_faces_in_place() -> None:
    session = AbstractionSession(PARAMS, SIZE)
    for frame in frames()[:2]:
        session.step(frame)
    before = session.state()["analyzer.importance.faces"]
    assert len(before)
    after = session.reconfigure(PARAMS, (120, 80), None, SIZE).state()["analyzer.importance.faces"]
    np.testing.assert_allclose(after[:, :8], before[:, :8] / 2)
