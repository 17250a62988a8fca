"""Implicit strokes: who covers whom, and what a disc becomes along a known field."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipeline.compute import device, report
from pipeline.strokes.brush import Brush, Canvas, Strokes, blank, discs
from pipeline.strokes.raster import Touch
from pipeline.strokes.seeds import Seeds, place
from pipeline.strokes.sweep import OPEN, colour_order, sweep

SIZE = (91, 111)
PLAIN = Touch(streaks=0)


def dots(xy: list[tuple[float, float]], colours: list[tuple[int, int, int]], brush: Brush) -> Strokes:
    seeds = Seeds(np.array(xy, np.float32), np.arange(len(xy), dtype=np.uint64))
    return discs(seeds, brush, np.array(colours, np.float32))


def even(angle_rad: float) -> np.ndarray:
    return np.full((*SIZE, 2), [math.cos(2 * angle_rad), math.sin(2 * angle_rad)], np.float32)


def white() -> Canvas:
    return blank(np.full((*SIZE, 3), 255, np.uint8))


def test_the_order_is_total_and_the_papers() -> None:
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
    whose = sweep(canvas, dots([(55, 45)], [(0, 0, 0)], Brush(size_px=8)), even(angle), 40, touch=PLAIN)
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
    whose = sweep(white(), dots([(85, 45)], [(9, 9, 9)], Brush(size_px=6)), field, 80)
    radius = np.hypot(x, y)[whose == 0]
    assert radius.min() > 30 - 4 and radius.max() < 30 + 4.5
    assert np.arctan2(y, x)[whose == 0].max() == pytest.approx(44.5 / 30, abs=0.08)


def test_the_smaller_colour_covers_whatever_the_order_of_the_seeds() -> None:
    xy, colours = [(40.0, 45.0), (55.0, 45.0), (70.0, 45.0)], [(200, 0, 0), (90, 90, 90), (10, 20, 30)]
    brush, turn = Brush(size_px=10), [2, 0, 1]
    one, other = white(), white()
    whose = sweep(one, dots(xy, colours, brush), even(0), 60, touch=PLAIN)
    again = sweep(other, dots([xy[k] for k in turn], [colours[k] for k in turn], brush), even(0), 60, touch=PLAIN)
    np.testing.assert_array_equal(np.array([*turn, OPEN])[np.minimum(again, 3)], np.where(whose == OPEN, OPEN, whose))
    np.testing.assert_array_equal(one, other)
    assert whose[45, 60] == 2 and whose[45, 30] == 1 and whose[45, 12] == 0 and whose[5, 5] == OPEN
    light = sweep(white(), dots(xy, colours, brush), even(0), 60, light_first=True)
    assert light[45, 60] == 0


def test_inside_a_stroke_there_is_one_colour() -> None:
    canvas = white()
    sweep(canvas, dots([(55, 45)], [(30, 60, 90)], Brush(size_px=12)), even(0.4), 50, touch=PLAIN)
    inside = canvas[np.abs(canvas[..., 0] - 30) < 1]
    assert len(inside) > 400
    np.testing.assert_array_equal(inside[:, :3], np.broadcast_to(np.float32([30, 60, 90]), (len(inside), 3)))


def test_strokes_keep_off_other_colours() -> None:
    guide = np.full((*SIZE, 3), 20, np.uint8)
    guide[:, 60:] = 250
    whose = sweep(white(), dots([(50, 45)], [(20, 20, 20)], Brush(size_px=9)), even(0), 60, guide=guide, tolerance=50)
    assert (whose[45, 30:60] == 0).all() and (whose[:, 60:] == OPEN).all()


@pytest.mark.parametrize("length", [0.0, 17.0, 60.0])
def test_threads_and_skipped_walks_change_no_byte(length: float, monkeypatch: pytest.MonkeyPatch) -> None:
    seeds = place(SIZE, 9, seed=3)[np.arange(0, 60, 7)]
    brush = Brush(size_px=7, grain=0.7, relief_px=2, jitter=0.3)
    strokes = discs(seeds, brush, np.full((len(seeds), 3), 99, np.float32))
    y, x = np.indices(SIZE, np.float32)
    field = np.dstack([np.cos(x / 20 + y / 31), np.sin(x / 20 + y / 31)]).astype(np.float32)
    one, three = white(), white()
    whose = sweep(one, strokes, field, length)
    np.testing.assert_array_equal(whose, sweep(three, strokes, field, length, threads=3))
    assert one.tobytes() == three.tobytes()
    monkeypatch.setattr("pipeline.strokes.sweep._distance", lambda first: np.zeros(first.shape, np.float32))
    np.testing.assert_array_equal(whose, sweep(white(), strokes, field, length))


@pytest.mark.real("opencl")
@pytest.mark.parametrize("length", [0.0, 17.0, 60.0])
@pytest.mark.parametrize("guided", [False, True])
@pytest.mark.parametrize("size", [(37, 53), (91, 111), (1, 9), (9, 1)])
def test_kernels_do_what_the_specification_says(size: tuple[int, int], guided: bool, length: float) -> None:
    rng = np.random.default_rng(5)
    seeds = place(size, 6, seed=3)
    brush = Brush(size_px=7, grain=0.7, relief_px=2, jitter=0.3)
    strokes = discs(seeds, brush, rng.uniform(60, 200, (len(seeds), 3)).astype(np.float32))
    y, x = np.indices(size, np.float32)
    field = np.dstack([np.cos(x / 20 + y / 31), np.sin(x / 20 + y / 31)]).astype(np.float32)
    field[y + x < 6] = 0
    guide = rng.integers(60, 200, (*size, 3), np.uint8) if guided else None
    for row in report(fresh=False):
        if row["works"]:
            specified, got = (blank(np.full((*size, 3), 240, np.uint8)) for _ in range(2))
            whose = sweep(specified, strokes, field, length, guide=guide, tolerance=90)
            on = device(str(row["platform"]))
            same = whose == sweep(got, strokes, field, length, guide=guide, tolerance=90, device=on)
            if row["kind"] == "cpu":
                assert same.all() and got.tobytes() == specified.tobytes(), str(row["platform"])
            assert same.mean() > 0.99, str(row["platform"])
            np.testing.assert_allclose(got[same], specified[same], atol=0.1, err_msg=str(row["platform"]))


def test_no_strokes_paint_nothing() -> None:
    canvas = white()
    none = Strokes(*(getattr(dots([(1, 1)], [(0, 0, 0)], Brush()), k)[:0] for k in Strokes.__dataclass_fields__))
    assert (sweep(canvas, none, even(0), 20) == OPEN).all() and (canvas[..., :3] == 255).all()
