"""Changing parameters or frame size of a session without a jump."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

import pipeline.scenes
from pipeline.frames import Frame
from pipeline.methods.abstraction import Abstraction, AbstractionParams, AbstractionSession

SIZE, HALF = (192, 128), (96, 64)


@cache
def picture(index: int) -> Frame:
    """Frame `index`; it is shared and read-only."""
    made = pipeline.scenes.scene("portrait", SIZE, frames=12).image(index)
    made.setflags(write=False)
    return made


def scene(count: int) -> list[Frame]:
    return [picture(index) for index in range(count)]


def small(frame: Frame, size: tuple[int, int] = HALF) -> Frame:
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), np.uint8)


def apart(a: Frame, b: Frame) -> float:
    return float(np.abs(a.astype(np.int16) - b).mean())


def run(session: AbstractionSession, frames: list[Frame]) -> list[Frame]:
    return [session.step(frame) for frame in frames]


def test_the_same_parameters_and_size_change_nothing() -> None:
    frames = scene(6)
    plain = run(AbstractionSession(AbstractionParams(), SIZE), frames)
    session = AbstractionSession(AbstractionParams(), SIZE)
    first = run(session, frames[:3])
    rest = run(session.reconfigure(AbstractionParams(), SIZE), frames[3:])
    assert all(np.array_equal(a, b) for a, b in zip(plain, first + rest, strict=True))


def test_analyzing_ahead_equals_stepping() -> None:
    frames = scene(4)
    plain = run(AbstractionSession(AbstractionParams(), SIZE), frames)
    session = AbstractionSession(AbstractionParams(), SIZE)
    analyses = [session.analyze(frame) for frame in frames]
    assert all(np.array_equal(a, session.paint(b)) for a, b in zip(plain, analyses, strict=True))


def test_a_helper_thread_does_not_change_the_bytes() -> None:
    frames = scene(12)
    plain = run(AbstractionSession(AbstractionParams(), SIZE), frames)
    session = AbstractionSession(AbstractionParams(), SIZE)
    with ThreadPoolExecutor(1) as helper, ThreadPoolExecutor(1) as analyzer:
        session.use_helper(helper)
        analyses = [analyzer.submit(session.analyze, frame) for frame in frames[:8]]
        painted = [session.paint(later.result()) for later in analyses]
        session = session.reconfigure(AbstractionParams(), SIZE)
        painted += run(session, frames[8:])
    assert all(np.array_equal(a, b) for a, b in zip(plain, painted, strict=True))


@pytest.mark.parametrize(("before", "after"), [(SIZE, HALF), (HALF, SIZE)])
def test_a_change_of_size_keeps_regions_and_colours(before: tuple[int, int], after: tuple[int, int]) -> None:
    frames = scene(6)
    session = AbstractionSession(AbstractionParams(), before)
    last = run(session, [small(f, before) for f in frames[:5]])[-1]
    ids = set(_ids(session))
    resized = session.reconfigure(AbstractionParams(), after)
    painted = resized.step(small(frames[5], after))
    afresh = AbstractionSession(AbstractionParams(), after).step(small(frames[5], after))
    assert painted.shape == (after[1], after[0], 3)
    assert apart(small(painted), small(last)) < 0.75 * apart(small(afresh), small(last))
    assert len(ids & set(_ids(resized))) > len(ids) / 2


def _ids(session: AbstractionSession) -> list[int]:
    state = session.state()
    return [int(i) for i in np.unique(state["regions.segmenter.ids"][state["regions.segmenter.labels"]])]


@pytest.mark.parametrize(
    "params",
    [{"lines": "off"}, {"line_colour": "#ff0000"}, {"line_width": 6.0}, {"growing_limit": 30}, {"flow": "tvl1"},
     {"face_importance": 0.0}, {"temporal": "off"},
     {"edges": "sharp"}],
)  # fmt: skip
def test_any_parameter_may_change(params: dict[str, Any]) -> None:
    frames = scene(4)
    session = AbstractionSession(AbstractionParams(), SIZE)
    run(session, frames[:2])
    there = session.reconfigure(AbstractionParams(**params), SIZE)
    there.step(frames[2])
    back = there.reconfigure(AbstractionParams(), HALF)
    assert back.step(small(frames[3])).shape == (HALF[1], HALF[0], 3)


def test_sharp_edges_continue_at_another_size() -> None:
    frames = scene(4)
    session = AbstractionSession(AbstractionParams(edges="sharp"), SIZE)
    whole = run(session, frames[:3])[-1]
    resized = session.reconfigure(AbstractionParams(edges="sharp"), HALF)
    assert apart(resized.step(small(frames[2])), small(whole)) < 6, "the finest lines are relatively wider in 64 rows"


@pytest.mark.parametrize("edges", ["soft", "sharp"])
def test_frames_analysed_at_half_the_size_are_drawn_at_full_size(edges: Any) -> None:
    frames, params = scene(6), AbstractionParams(edges=edges)
    session = AbstractionSession(params, SIZE)
    last = run(session, frames[:3])[-1]
    drawn = run(session.reconfigure(params, HALF, None, SIZE), [small(frame) for frame in frames[3:]])
    enlarged = [cv2.resize(frame, SIZE) for frame in run(AbstractionSession(params, HALF), [small(f) for f in frames])]
    assert all(frame.shape == (SIZE[1], SIZE[0], 3) for frame in drawn)
    assert apart(drawn[0], last) < 12
    assert steepest(drawn[-1]) > 1.25 * steepest(np.asarray(enlarged[-1], np.uint8))


def steepest(frame: Frame) -> float:
    """Contrast of neighbouring pixels that one in two hundred pairs exceeds, gray levels."""
    gray = frame.mean(axis=2)
    return float(np.quantile(np.abs(np.diff(gray, axis=1)), 0.995))


def test_a_session_returns_from_half_the_size_to_full_size() -> None:
    frames = scene(5)
    session = AbstractionSession(AbstractionParams(edges="sharp"), SIZE)
    run(session, frames[:2])
    session = session.reconfigure(AbstractionParams(edges="sharp"), HALF, None, SIZE)
    last = session.step(small(frames[2]))
    session = session.reconfigure(AbstractionParams(edges="sharp"), SIZE, None, SIZE)
    assert apart(session.step(frames[3]), last) < 12


def test_a_reference_can_be_added_and_removed() -> None:
    frames = scene(5)
    green = np.full((8, 8, 3), (20, 160, 60), np.uint8)
    session = AbstractionSession(AbstractionParams(), SIZE)
    run(session, frames[:2])
    coloured = session.reconfigure(AbstractionParams(), SIZE, {"reference": iter([green])})
    assert coloured.regions.palette.reference is not None
    coloured.step(frames[2])
    kept = coloured.reconfigure(AbstractionParams(lines="off"), SIZE)
    assert kept.regions.palette.reference is coloured.regions.palette.reference
    kept.step(frames[3])
    plain = kept.reconfigure(AbstractionParams(), SIZE, {})
    assert plain.regions.palette.reference is None
    plain.step(frames[4])


def test_reconfiguring_before_the_first_frame() -> None:
    session = AbstractionSession(AbstractionParams(), SIZE).reconfigure(AbstractionParams(lines="off"), HALF)
    assert session.step(small(scene(1)[0])).shape == (HALF[1], HALF[0], 3)


def test_the_registered_method_supports_reconfiguring() -> None:
    session = Abstraction().stream(AbstractionParams(), SIZE, 0, {})
    session.paint(session.analyze(scene(1)[0]))
    assert isinstance(session.reconfigure(AbstractionParams(), HALF), AbstractionSession)
