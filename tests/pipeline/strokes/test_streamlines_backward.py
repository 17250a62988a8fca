"""Backward streamlines: painting order, and the shape of a disc drawn along a known field."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipeline.strokes.brush import Brush, Canvas, Strokes, blank, discs
from pipeline.strokes.raster import StrokeProfile
from pipeline.strokes.seeds import Seeds, place
from pipeline.strokes.streamlines_backward import UNCOVERED, colour_order, streamlines_backward
from pipeline.strokes.streamlines_forward import RasterOptions

SIZE = (91, 111)
PLAIN = RasterOptions(profile=StrokeProfile(streaks=0))


def dots(xy: list[tuple[float, float]], colours: list[tuple[int, int, int]], brush: Brush) -> Strokes:
    seeds = Seeds(np.array(xy, np.float32), np.arange(len(xy), dtype=np.uint64))
    return discs(seeds, brush, np.array(colours, np.float32))


def even(angle_rad: float) -> np.ndarray:
    return np.full((*SIZE, 2), [math.cos(2 * angle_rad), math.sin(2 * angle_rad)], np.float32)


def white() -> Canvas:
    return blank(np.full((*SIZE, 3), 255, np.uint8))


def test_the_order_is_the_total_order_of_the_paper() -> None:
    rows = np.array(
        [[5, 0, 0], [0, 5, 0], [3, 4, 0], [4, 3, 0], [0, 3, 4], [0, 4, 3], [1, 1, 1], [0, 0, 5]], np.float32
    )
    order = colour_order(rows).tolist()
    assert [rows[k].astype(int).tolist() for k in order] == [
        [1, 1, 1], [0, 0, 5], [5, 0, 0], [0, 3, 4], [4, 3, 0], [0, 4, 3], [3, 4, 0], [0, 5, 0],
    ]  # fmt: skip
    again = np.random.default_rng(1).permutation(8)
    assert rows[again][colour_order(rows[again])].tolist() == rows[order].tolist()


@pytest.mark.parametrize("degrees", [0, 30, 90, 135])
def test_a_disc_on_an_even_field_becomes_a_straight_stroke(degrees: int) -> None:
    angle = math.radians(degrees)
    canvas = white()
    whose = streamlines_backward(
        canvas, dots([(55, 45)], [(0, 0, 0)], Brush(size_px=8)), even(angle), 40, options=PLAIN
    )
    y, x = np.nonzero(whose == 0)
    along = (x - 55) * math.cos(angle) + (y - 45) * math.sin(angle)
    across = (y - 45) * math.cos(angle) - (x - 55) * math.sin(angle)
    assert np.abs(across).max() <= 4.6
    assert 20 <= along.max() <= 26 and -26 <= along.min() <= -20
    assert (255 - canvas[..., 0]).sum() / 255 == pytest.approx(8 * 46, rel=0.1)


def test_on_a_circular_field_the_stroke_is_an_arc() -> None:
    y, x = np.indices(SIZE) - np.array([45, 55]).reshape(2, 1, 1)
    angle = 2 * (np.arctan2(y, x) + math.pi / 2)
    field = np.dstack([np.cos(angle), np.sin(angle)]).astype(np.float32)
    whose = streamlines_backward(white(), dots([(85, 45)], [(9, 9, 9)], Brush(size_px=6)), field, 80)
    radius = np.hypot(x, y)[whose == 0]
    assert radius.min() > 30 - 4 and radius.max() < 30 + 4.5
    assert np.arctan2(y, x)[whose == 0].max() == pytest.approx(44.5 / 30, abs=0.08)


def test_the_smaller_colour_covers_in_any_order_of_seeds() -> None:
    xy, colours = [(40.0, 45.0), (55.0, 45.0), (70.0, 45.0)], [(200, 0, 0), (90, 90, 90), (10, 20, 30)]
    brush, turn = Brush(size_px=10), [2, 0, 1]
    one, other = white(), white()
    whose = streamlines_backward(one, dots(xy, colours, brush), even(0), 60, options=PLAIN)
    again = streamlines_backward(
        other, dots([xy[k] for k in turn], [colours[k] for k in turn], brush), even(0), 60, options=PLAIN
    )
    np.testing.assert_array_equal(
        np.array([*turn, UNCOVERED])[np.minimum(again, 3)], np.where(whose == UNCOVERED, UNCOVERED, whose)
    )
    np.testing.assert_array_equal(one, other)
    assert whose[45, 60] == 2 and whose[45, 30] == 1 and whose[45, 12] == 0 and whose[5, 5] == UNCOVERED


def test_inside_a_stroke_there_is_one_colour() -> None:
    canvas = white()
    streamlines_backward(canvas, dots([(55, 45)], [(30, 60, 90)], Brush(size_px=12)), even(0.4), 50, options=PLAIN)
    inside = canvas[np.abs(canvas[..., 0] - 30) < 1]
    assert len(inside) > 400
    np.testing.assert_array_equal(inside[:, :3], np.broadcast_to(np.float32([30, 60, 90]), (len(inside), 3)))


def test_strokes_do_not_cover_other_colours() -> None:
    guide = np.full((*SIZE, 3), 20, np.uint8)
    guide[:, 60:] = 250
    whose = streamlines_backward(
        white(),
        dots([(50, 45)], [(20, 20, 20)], Brush(size_px=9)),
        even(0),
        60,
        options=RasterOptions(guide=guide, tolerance=50),
    )
    assert (whose[45, 30:60] == 0).all() and (whose[:, 60:] == UNCOVERED).all()


@pytest.mark.parametrize("length", [0.0, 17.0, 60.0])
def test_threads_and_skipped_walks_do_not_change_the_result(length: float, monkeypatch: pytest.MonkeyPatch) -> None:
    seeds = place(SIZE, 9, seed=3)[np.arange(0, 60, 7)]
    brush = Brush(size_px=7, grain=0.7, relief_px=2, jitter=0.3)
    strokes = discs(seeds, brush, np.full((len(seeds), 3), 99, np.float32))
    y, x = np.indices(SIZE, np.float32)
    field = np.dstack([np.cos(x / 20 + y / 31), np.sin(x / 20 + y / 31)]).astype(np.float32)
    one, three = white(), white()
    whose = streamlines_backward(one, strokes, field, length)
    np.testing.assert_array_equal(
        whose, streamlines_backward(three, strokes, field, length, options=RasterOptions(threads=3))
    )
    assert one.tobytes() == three.tobytes()
    monkeypatch.setattr("pipeline.strokes.streamlines_backward._gap", lambda ranks: np.zeros(ranks.shape, np.float32))
    np.testing.assert_array_equal(whose, streamlines_backward(white(), strokes, field, length))


def test_no_strokes_paint_nothing() -> None:
    canvas = white()
    none = Strokes(*(getattr(dots([(1, 1)], [(0, 0, 0)], Brush()), k)[:0] for k in Strokes.__dataclass_fields__))
    assert (streamlines_backward(canvas, none, even(0), 20) == UNCOVERED).all() and (canvas[..., :3] == 255).all()
