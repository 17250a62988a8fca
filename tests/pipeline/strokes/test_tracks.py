"""Stroke tracks: advection, stable ids, gradual appearance and removal."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipeline.frames import Flow, Frame
from pipeline.strokes.brush import Brush, discs
from pipeline.strokes.seeds import place
from pipeline.strokes.tracks import LifecycleParams, StrokeTracks, advect, fade, start_tracks, update

SIZE = (67, 91)
GAP = 6.0


def even(dx: float, dy: float) -> Flow:
    return np.full((*SIZE, 2), [dx, dy], np.float32)


def gray(level: int = 120) -> Frame:
    return np.full((*SIZE, 3), level, np.uint8)


def run(frames: int, flow: Flow, picture: Frame | None = None) -> list[StrokeTracks]:
    picture = gray() if picture is None else picture
    states = [start_tracks(place(SIZE, GAP), picture, GAP)]
    for t in range(1, frames):
        states.append(update(advect(states[-1], flow), place(SIZE, GAP, birth=t), picture, GAP))
    return states


def test_strokes_follow_a_translation_and_keep_their_ids() -> None:
    states = run(8, even(1.3, -0.6))
    first, last = (dict(zip(s.seeds.ids.tolist(), s.seeds.xy, strict=True)) for s in (states[0], states[-1]))
    kept = set(first) & set(last)
    inner = [i for i, (x, y) in first.items() if x < SIZE[1] - 12 and y > 8]
    assert len(kept) >= 0.9 * len(inner)
    for i in kept:
        np.testing.assert_allclose(last[i] - first[i], [1.3 * 7, -0.6 * 7], atol=1e-3)


def test_missing_strokes_are_added_and_their_number_is_stable() -> None:
    states = run(15, even(2.0, 0.0))
    for state in states:
        assert not state.leaving.any() or state.presence[state.leaving].max() < 1
    full = len(states[0])
    assert all(0.75 * full < (~s.leaving).sum() < 1.35 * full for s in states)
    left = (states[-1].seeds.xy[:, 0] < 20).sum()
    assert left > 0.6 * (states[0].seeds.xy[:, 0] < 20).sum()
    assert len(np.unique(states[-1].seeds.ids)) == len(states[-1])


def test_a_still_picture_converges() -> None:
    states = run(12, even(0, 0))
    assert states[-1].seeds.ids.tobytes() == states[-2].seeds.ids.tobytes()
    np.testing.assert_array_equal(states[-1].presence, 1)


def test_of_crowded_strokes_the_younger_is_removed() -> None:
    y, x = np.indices(SIZE)
    squeeze = np.dstack([(45 - x) * 0.1, (33 - y) * 0.1]).astype(np.float32)
    states = run(12, squeeze)
    near = np.hypot(*(states[-1].seeds.xy - [45, 33]).T) < 12
    stay = near & ~states[-1].leaving
    assert states[-1].leaving.any() or near.sum() < 40
    apart = states[-1].seeds.xy[stay]
    distance = np.hypot(*(apart[:, None] - apart[None]).transpose(2, 0, 1)) + 99 * np.eye(len(apart))
    assert distance.min() >= LifecycleParams().crowd * GAP * 0.85


def test_hidden_strokes_fade_and_are_removed() -> None:
    state = start_tracks(place(SIZE, GAP), gray(), GAP)
    hidden = np.zeros(SIZE, np.bool_)
    hidden[:, 40:] = True
    names = set(state.seeds.ids[state.seeds.xy[:, 0] > 41].tolist())
    presence = []
    for t in range(1, 6):
        state = update(advect(state, even(0, 0), hidden if t == 1 else None), place(SIZE, GAP, birth=t), gray(), GAP)
        mine = [p for i, p in zip(state.seeds.ids.tolist(), state.presence, strict=True) if i in names]
        presence.append(max(mine, default=0.0))
    assert presence[:4] == pytest.approx([0.75, 0.5, 0.25, 0]) and presence[4] == 0
    assert (state.seeds.xy[:, 0] > 41).sum() > 0.6 * len(names)


def test_colours_follow_slowly_and_a_jump_removes_the_stroke() -> None:
    state = start_tracks(place(SIZE, GAP), gray(100), GAP)
    eased = update(state, place(SIZE, GAP, birth=1), gray(120), GAP, params=LifecycleParams(follow=0.25))
    share = 0.25 + 0.75 * 3 * 20**2 / 90**2
    np.testing.assert_allclose(eased.targets, 100 + 20 * share, rtol=1e-5)
    jumped = update(state, place(SIZE, GAP, birth=1), gray(250), GAP)
    nearly = update(state, place(SIZE, GAP, birth=1), gray(150), GAP)
    assert not nearly.leaving.any() and (nearly.targets > 145).all()
    assert jumped.leaving[: len(state)].all() and (jumped.targets[: len(state)] == 100).all()
    assert (jumped.targets[len(state) :] == 250).all() and len(jumped) > 1.6 * len(state)


def test_unwanted_strokes_are_removed() -> None:
    state = start_tracks(place(SIZE, GAP), gray(), GAP)
    wanted = np.arange(len(state)) % 2 == 0
    after = update(state, place(SIZE, GAP)[np.zeros(0, np.intp)], gray(), GAP, wanted=wanted)
    np.testing.assert_array_equal(after.leaving, ~wanted)


def test_presence_makes_strokes_fainter_and_narrower() -> None:
    state = start_tracks(place(SIZE, GAP), gray(), GAP)
    strokes = discs(state.seeds, Brush(size_px=8, opacity=0.8), state.targets)
    half = fade(strokes, np.full(len(state), 0.5, np.float32))
    assert half.opacity.max() == pytest.approx(0.4) and half.radius_px.max() == pytest.approx(2.8)
    np.testing.assert_array_equal(fade(strokes, state.presence).opacity, strokes.opacity)


def test_equal_inputs_give_equal_bytes() -> None:
    flow = even(math.pi / 3, 0.4)
    a, b = run(6, flow)[-1], run(6, flow)[-1]
    for name in ("targets", "presence", "leaving"):
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes()
    assert a.seeds.xy.tobytes() == b.seeds.xy.tobytes()


def test_revealed_surfaces_get_new_strokes_at_once() -> None:
    state, revealed = start_tracks(place(SIZE, GAP), gray(100), GAP), np.zeros(SIZE, np.bool_)
    revealed[:, 40:] = True
    for level, most_old in ((130, None), (250, 0)):
        found = update(state, place(SIZE, GAP, birth=1), gray(level), GAP, revealed=revealed)
        right = found.seeds.xy[:, 0] > 41
        np.testing.assert_array_equal(found.targets[right], level, "old strokes take the colour, or new ones have it")
        np.testing.assert_array_equal(found.presence[right], 1)
        assert found.leaving[right].sum() == 0 and (found.targets[~right] != level).any()
        if most_old is not None:
            assert np.isin(found.seeds.ids[right], state.seeds.ids).sum() == most_old
