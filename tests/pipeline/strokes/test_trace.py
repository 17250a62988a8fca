"""Strokes along fields whose streamlines are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.strokes.brush import Brush, Direction, blank, colours_at, discs
from pipeline.strokes.seeds import Seeds
from pipeline.strokes.trace import TraceRules, trace, trace_along, trace_from, unit_tangents

SIZE = (121, 141)
GRAY = np.full((1, 3), 128, np.float32)


def one(x: float, y: float) -> Seeds:
    return Seeds(np.array([[x, y]], np.float32), np.array([7], np.uint64))


def even(angle_rad: float) -> Direction:
    return np.full((*SIZE, 2), [math.cos(2 * angle_rad), math.sin(2 * angle_rad)], np.float32)


def round_about(x0: float, y0: float) -> Direction:
    y, x = np.indices(SIZE)
    angle = 2 * (np.arctan2(y - y0, x - x0) + math.pi / 2)
    return np.dstack([np.cos(angle), np.sin(angle)]).astype(np.float32)


def length(points: NDArray[np.float32]) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


@pytest.mark.parametrize("radius", [20, 35, 50])
def test_on_a_circular_field_a_stroke_stays_on_its_circle(radius: int) -> None:
    strokes = trace(one(70 + radius, 60), round_about(70, 60), Brush(size_px=6, length_px=2.5 * radius), GRAY)
    points = strokes.points[0, : strokes.counts[0]]
    assert np.abs(np.hypot(*(points - [70, 60]).T) - radius).max() < 1
    assert length(points) == pytest.approx(2.5 * radius, rel=0.01)


@pytest.mark.parametrize("degrees", range(0, 180, 20))
def test_on_an_even_field_a_stroke_is_straight_and_centred(degrees: int) -> None:
    angle = math.radians(degrees)
    strokes = trace(one(70, 60), even(angle), Brush(size_px=4, length_px=50), GRAY)
    points = strokes.points[0, : strokes.counts[0]] - [70, 60]
    across = points @ [-math.sin(angle), math.cos(angle)]
    along = points @ [math.cos(angle), math.sin(angle)]
    assert np.abs(across).max() < 0.01
    assert sorted(np.round([along.min(), along.max()])) == [-25, 25]


def test_without_direction_a_stroke_goes_straight_on() -> None:
    field = even(math.pi / 2)
    field[:50] = 0
    strokes = trace(one(70, 60), field, Brush(size_px=4, length_px=60), GRAY)
    assert np.abs(strokes.points[0, : strokes.counts[0], 0] - 70).max() < 0.01
    assert strokes.points[0, : strokes.counts[0], 1].min() == pytest.approx(30, abs=0.1)


def test_streamlines_along_tangents_have_the_same_points() -> None:
    draw = np.random.default_rng(4)
    field = round_about(70, 60) * draw.uniform(0.01, 2, (*SIZE, 1)).astype(np.float32)
    field[20:40, 30:60] = 0
    xy = draw.uniform(0, [SIZE[1] - 1, SIZE[0] - 1], (300, 2)).astype(np.float32)
    starts = discs(Seeds(xy, np.arange(300, dtype=np.uint64)), Brush(size_px=5), np.full((300, 3), 90, np.float32))
    lengths = draw.choice([0, 9, 40, 150], 300).astype(np.float32)
    one_by_one, fast = trace_from(starts, lengths, field), trace_along(starts, lengths, field, unit_tangents(field))
    assert fast.counts.tolist() == one_by_one.counts.tolist() and len(set(fast.counts)) > 5
    for k, count in enumerate(fast.counts):
        np.testing.assert_array_equal(fast.points[k, :count], one_by_one.points[k, :count])


def test_strokes_end_at_an_edge() -> None:
    picture = np.full((*SIZE, 3), 40, np.uint8)
    picture[:, 90:] = 220
    seeds = one(70, 60)
    strokes = trace(
        seeds, even(0), Brush(size_px=4, length_px=100), colours_at(seeds, picture), TraceRules(picture, edge=60)
    )
    x = strokes.points[0, : strokes.counts[0], 0]
    assert 85 < x.max() < 90 and x.min() == pytest.approx(20, abs=0.1)


def test_strokes_end_where_the_canvas_is_better_after_their_least_length() -> None:
    ramp = np.repeat(np.linspace(60, 160, SIZE[1]).astype(np.uint8)[None, :, None], 3, axis=2)
    picture = np.ascontiguousarray(np.repeat(ramp, SIZE[0], axis=0))
    seeds, brush, canvas = one(70, 60), Brush(size_px=4, length_px=80), blank(picture)
    targets = colours_at(seeds, picture)
    ends = [trace(seeds, even(0), brush, targets, TraceRules(picture, canvas, 200, least)) for least in (0.0, 0.5, 1.0)]
    spans = [length(strokes.points[0, : strokes.counts[0]]) for strokes in ends]
    assert spans[0] <= 4 and 40 <= spans[1] <= 48 and spans[2] == pytest.approx(80, abs=0.1)


def test_without_curvature_a_stroke_stays_straight() -> None:
    rules = TraceRules(curvature=0)
    straight = trace(one(105, 60), round_about(70, 60), Brush(size_px=4, length_px=40), GRAY, rules)
    assert np.abs(straight.points[0, : straight.counts[0], 0] - 105).max() < 0.01


def test_points_stay_in_the_picture() -> None:
    xy = np.array([[0, 0], [140, 120], [0, 120], [140, 0], [70, 0]], np.float32)
    seeds = Seeds(xy, np.arange(5, dtype=np.uint64))
    strokes = trace(seeds, even(0.7), Brush(size_px=3, length_px=90), np.repeat(GRAY, 5, axis=0))
    for points, count in zip(strokes.points, strokes.counts, strict=True):
        used = points[:count]
        assert count >= 1 and used.min() >= -0.5 and (used <= [140.5, 120.5]).all()


def test_no_seeds_give_no_strokes() -> None:
    none = Seeds(np.empty((0, 2), np.float32), np.empty(0, np.uint64))
    assert len(trace(none, even(0), Brush(jitter=0.5, hue_deg=20), np.empty((0, 3), np.float32))) == 0
