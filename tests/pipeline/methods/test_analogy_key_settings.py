"""Reach and weight of keyframes: the frames follow them exactly."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.analogy.key_intervals import gaps, split_intervals
from pipeline.methods.analogy.key_settings import KeySettings, key_settings, settings_document, weighted
from pipeline.methods.local import LocalContext, run_plan
from pipeline.methods.parts import PaintedKey
from tests.pipeline.methods.test_analogy import QUICK, SIZE, painting, palette, shot

RED, BLUE = (200, 30, 30), (30, 30, 200)


def flat(colour: tuple[int, int, int]) -> Frame:
    """A keyframe of one colour: it shows which keyframe a pixel comes from."""
    return np.full((SIZE[1], SIZE[0], 3), colour, np.uint8)


def film(rows: list[dict[str, Any]], count: int = 12, last: int = 11, **given: Any) -> dict[int, Frame]:
    """Frames between a red keyframe 0 and a blue keyframe `last`, by default in their colours only. `given`: parameters
    and inputs."""
    given = {"key_blend": 0} | given
    inputs: dict[str, Any] = {"keyframes": {0: flat(RED), last: flat(BLUE)}, "keyframe_settings": rows}
    inputs |= {"style_output": [painting()]} if given.pop("styled", False) else {}
    chosen = method("analogy")
    context = LocalContext(parse_params(chosen, QUICK | given), shot(count), inputs)
    run_plan(chosen, context)
    return {index: np.asarray(frame, np.uint8) for index, frame in context.emitted.items()}


def shares(frames: dict[int, Frame]) -> list[float]:
    """Share of blue pixels of each frame; the others are red."""
    assert palette(*frames.values()) <= {bytes(RED), bytes(BLUE)}
    return [float((frames[index] == BLUE).all(-1).mean()) for index in sorted(frames)]


@pytest.mark.parametrize("temporal", ["on", "off"])
def test_a_frame_has_the_colours_of_the_keyframes_that_reach_it(temporal: str) -> None:
    found = shares(film([{"frame": 0, "after": 7}, {"frame": 11, "before": 6}], temporal=temporal))
    assert found[:5] == [0.0] * 5, "only red reaches the frames 0 to 4"
    assert found[8:] == [1.0] * 4, "only blue reaches the frames 8 to 11"
    free = shares(film([], temporal=temporal))
    assert temporal == "on" or any(share > 0 for share in free[1:5]), "without limits, both would"


def test_keyframes_change_at_once_where_their_reaches_meet() -> None:
    assert shares(film([{"frame": 0, "after": 3}, {"frame": 11, "before": 7}])) == [0.0] * 4 + [1.0] * 8


def test_a_keyframe_that_reaches_no_other_frame_is_one_frame() -> None:
    assert shares(film([{"frame": 11, "before": 0}])) == [0.0] * 11 + [1.0]


@pytest.mark.parametrize("temporal", ["on", "off"])
def test_frames_that_no_keyframe_reaches_are_those_of_a_film_without_keyframes(temporal: str) -> None:
    rows = [{"frame": 0, "after": 2}, {"frame": 11, "before": 3}]
    found = film(rows, styled=True, temporal=temporal)
    assert palette(*(found[index] for index in range(3, 8))) <= palette(painting())
    chosen = method("analogy")
    context = LocalContext(
        parse_params(chosen, QUICK | {"temporal": temporal}), shot(12), {"style_output": [painting()]}
    )
    run_plan(chosen, context)
    if temporal == "off":
        for index in range(3, 8):
            np.testing.assert_array_equal(found[index], context.emitted[index])
    strokes = film(rows, temporal=temporal)
    assert len(palette(*(strokes[index] for index in range(3, 8)))) > 2, "without a painting: painted in strokes"


def test_a_heavier_keyframe_determines_more_frames() -> None:
    """Blue takes over where the distances to both keyframes relate as their weights."""

    def changed(weight: float) -> int:
        return next(index for index, share in enumerate(shares(film([{"frame": 0, "weight": weight}]))) if share > 0.5)

    early, even, late = (changed(weight) for weight in (0.2, 1, 5))
    assert early < even < late


def test_equal_weights_are_the_film_without_weights() -> None:
    plain, equal = film([], key_blend=1), film([{"frame": 0, "weight": 3}, {"frame": 11, "weight": 3}], key_blend=1)
    for index, frame in plain.items():
        np.testing.assert_array_equal(equal[index], frame)


def test_the_blend_of_colours_follows_the_weights() -> None:
    means = {weight: film([{"frame": 0, "weight": weight}], key_blend=1)[5][..., 0].mean() for weight in (0.2, 1, 5)}
    assert means[0.2] + 5 < means[1] < means[5] - 5, "red grows with its weight"


@given(share=st.floats(0, 1), before=st.floats(0.1, 10), after=st.floats(0.1, 10))
def test_weighted_shares_of_both_keyframes_have_a_sum_of_one(share: float, before: float, after: float) -> None:
    found = weighted(share, before, after)
    assert 0 <= found <= 1
    assert found + weighted(1 - share, after, before) == pytest.approx(1)
    assert weighted(before / (before + after), before, after) == pytest.approx(0.5)


_SETTINGS = st.builds(
    KeySettings,
    st.none() | st.integers(0, 90), st.none() | st.integers(0, 90), st.sampled_from([0.1, 0.5, 1.0, 4.0, 10.0]),
)  # fmt: skip


@settings(max_examples=300, deadline=None)
@given(
    keys=st.dictionaries(st.integers(0, 199), _SETTINGS, min_size=1, max_size=6),
    length=st.integers(200, 260), unit=st.sampled_from([1, 2]), share=st.booleans(),
)  # fmt: skip
def test_every_frame_is_painted_once_by_the_keyframes_that_reach_it(
    keys: dict[int, KeySettings], length: int, unit: int, share: bool
) -> None:
    """Parts come after the parts that they continue from, which have synthesised the frame that they share."""
    parts: dict[str, Any] = {}
    emitted: list[int] = []
    order = sorted(keys)
    for name, part in split_intervals(0, length, [(index, True) for index in order], 48, {}, unit, keys, share):
        for frame, start in part.fixed:
            before = parts[f"keyed-{start:07d}"]
            assert frame in (before.start, before.last) and before.start <= frame < before.stop
        assert name not in parts
        parts[name] = part
        emitted += range(part.first, part.last)
        for frame in range(part.first, part.last):
            shown = {index for index in part.keys if keys[index].reaches(frame - index)}
            fixed = {one for one, _ in part.fixed} | {*order} | ({part.last - 1} if part.last == length else set())
            assert shown == set(part.keys) or frame in fixed
    for first, end in gaps(0, length, order, keys):
        emitted += range(first, end)
        for frame in range(first, end):
            around = [
                max((k for k in order if k <= frame), default=None),
                min((k for k in order if k > frame), default=None),
            ]
            assert not any(k is not None and keys[k].reaches(frame - k) for k in around)
    assert sorted(emitted) == list(range(length))


@pytest.mark.parametrize(
    ("rows", "field"),
    [
        ({}, "inputs.keyframe_settings"),
        ([{"frame": 1, "weight": 0}], "inputs.keyframe_settings[0].weight"),
        ([{"frame": 1, "reach": 3}], "inputs.keyframe_settings[0].reach"),
        ([{"frame": 1}, {"frame": -1}], "inputs.keyframe_settings[1].frame"),
        ([{"frame": 1}, {"frame": 1}], "inputs.keyframe_settings[1].frame"),
        ([{"frame": 1, "before": True}], "inputs.keyframe_settings[0].before"),
    ],
)
def test_wrong_settings_are_refused_with_their_place(rows: Any, field: str) -> None:
    with pytest.raises(BadParameter) as refused:
        key_settings(rows)
    assert refused.value.field == field


def test_painted_keys_give_the_settings_that_differ_from_the_usual_ones() -> None:
    keys = [PaintedKey(frame=3, image="a"), PaintedKey(frame=9, image="b", after=4, weight=2)]
    assert settings_document(keys) == [{"frame": 9, "before": None, "after": 4, "weight": 2.0}]
    assert key_settings(settings_document(keys)) == {9: KeySettings(None, 4, 2.0)}
