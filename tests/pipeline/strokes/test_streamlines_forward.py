"""Forward streamlines: the same strokes as backward streamlines, and no pixel painted twice."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipeline.strokes.brush import Brush, Strokes, discs
from pipeline.strokes.raster import StrokeProfile
from pipeline.strokes.seeds import Seeds, place
from pipeline.strokes.streamlines_forward import (
    FrontToBack,
    RasterOptions,
    composite_over,
    empty_buffer,
    streamlines_forward,
)

SIZE = (91, 111)
EVEN = StrokeProfile((0, 0), streaks=0, dry=0, soft=0)


def dots(xy: list[tuple[float, float]], colours: list[tuple[int, int, int]], brush: Brush) -> Strokes:
    seeds = Seeds(np.array(xy, np.float32), np.arange(len(xy), dtype=np.uint64))
    return discs(seeds, brush, np.array(colours, np.float32))


def even(angle_rad: float) -> np.ndarray:
    return np.full((*SIZE, 2), [math.cos(2 * angle_rad), math.sin(2 * angle_rad)], np.float32)


def layer(
    buffer: FrontToBack, strokes: Strokes, field: np.ndarray, length: float, order: list[int], **more: object
) -> None:
    lengths = np.full(len(strokes), length, np.float32)
    options = RasterOptions(profile=EVEN, **more)  # type: ignore[arg-type]
    streamlines_forward(buffer, strokes, field, lengths, np.array(order, np.intp), options)


def many() -> tuple[Strokes, np.ndarray, np.ndarray]:
    """Strokes all over, a field that turns slowly, and an order that has nothing to do with places."""
    seeds = place(SIZE, 8, seed=4)
    rng = np.random.default_rng(5)
    strokes = discs(seeds, Brush(size_px=7, relief_px=2), rng.uniform(0, 255, (len(seeds), 3)).astype(np.float32))
    y, x = np.indices(SIZE, np.float32)
    field = np.dstack([np.cos(x / 60 + y / 80), np.sin(x / 60 + y / 80)]).astype(np.float32)
    return strokes, field, rng.permutation(len(seeds))


@pytest.mark.parametrize("degrees", [0, 30, 90, 135])
def test_a_stroke_has_the_requested_length_and_width(degrees: int) -> None:
    angle, buffer = math.radians(degrees), empty_buffer(SIZE)
    layer(buffer, dots([(55, 45)], [(200, 200, 200)], Brush(size_px=8)), even(angle), 40, [0])
    y, x = np.nonzero(buffer.paint[..., 4] < 0.5)
    along = (x - 55) * math.cos(angle) + (y - 45) * math.sin(angle)
    across = (y - 45) * math.cos(angle) - (x - 55) * math.sin(angle)
    assert np.abs(across).max() <= 4.6
    assert 22 <= along.max() <= 25 and -25 <= along.min() <= -22
    assert (1 - buffer.paint[..., 4]).sum() == pytest.approx(8 * 40 + math.pi * 16, rel=0.03)


def test_the_first_stroke_of_the_order_is_topmost() -> None:
    strokes = dots([(50, 45), (55, 45)], [(250, 0, 0), (0, 0, 250)], Brush(size_px=10))
    for order, top in (([0, 1], 0), ([1, 0], 2)):
        buffer = empty_buffer(SIZE)
        layer(buffer, strokes, even(0), 20, order)
        assert buffer.paint[45, 52, top] == pytest.approx(250, abs=1) and buffer.paint[45, 52, 2 - top] < 1


def test_earlier_layers_stay_on_top_of_the_ground() -> None:
    buffer = empty_buffer(SIZE)
    layer(buffer, dots([(30, 45)], [(9, 200, 9)], Brush(size_px=9)), even(0), 10, [0])
    before = buffer.paint.copy()
    layer(buffer, dots([(34, 45)], [(200, 9, 9)], Brush(size_px=20)), even(0), 30, [0])
    done = before[..., 4] < 0.004
    np.testing.assert_array_equal(buffer.paint[done], before[done])
    np.testing.assert_array_equal(buffer.finished, buffer.paint[..., 4] <= np.float32(0.03))
    picture = composite_over(buffer, np.full((*SIZE, 3), 77, np.float32))
    assert (picture[5, 5, :3] == 77).all() and picture[45, 30, 1] == pytest.approx(200, abs=1)


def test_thin_paint_adds_up() -> None:
    buffer = empty_buffer(SIZE)
    layer(
        buffer,
        dots([(50, 45), (50, 45)], [(200, 0, 0), (0, 0, 200)], Brush(size_px=9, opacity=0.5)),
        even(0),
        20,
        [0, 1],
    )
    np.testing.assert_allclose(buffer.paint[45, 50, [0, 2, 4]], [100, 50, 0.25], atol=0.5)


def test_each_stroke_covers_colours_within_its_own_tolerance() -> None:
    guide = np.full((*SIZE, 3), 20, np.uint8)
    guide[:, 60:] = 60
    strokes = dots([(50, 20), (50, 70)], [(20, 20, 20)] * 2, Brush(size_px=9))
    buffer = empty_buffer(SIZE)
    layer(buffer, strokes, even(0), 60, [0, 1], guide=guide, tolerance=np.array([30, 90], np.float32))
    paint = buffer.paint
    assert (paint[20, 60:, 4] == 1).all() and paint[20, 55, 4] < 0.01 and paint[70, 65, 4] < 0.01


def test_soft_edges_fade_over_their_width_and_leave_a_stroke_as_wide_as_it_is() -> None:
    """A stroke of radius 8 along x; how many rows lie between wholly painted and bare."""
    made = {}
    for soft in (0.0, 0.5):
        buffer, strokes = empty_buffer(SIZE), dots([(55, 45)], [(200, 200, 200)], Brush(size_px=16))
        options = RasterOptions(profile=StrokeProfile((0, 0), streaks=0, dry=0, soft=soft))
        streamlines_forward(buffer, strokes, even(0), np.array([30], np.float32), np.array([0], np.intp), options)
        share = 1 - buffer.paint[:, 55, 4]
        made[soft] = ((share > 0.02) & (share < 0.98)).sum() / 2, share.sum()
    assert made[0.0][0] <= 1 and 4 <= made[0.5][0] <= 6
    assert made[0.5][1] == pytest.approx(made[0.0][1], abs=0.3)


@pytest.mark.parametrize("threads", [2, 3, 7])
def test_threads_do_not_change_the_result(threads: int) -> None:
    strokes, field, order = many()
    pictures = []
    for n in (1, threads):
        buffer = empty_buffer(SIZE)
        lengths = np.full(len(strokes), 25, np.float32)
        streamlines_forward(buffer, strokes, field, lengths, order, RasterOptions(threads=n))
        pictures.append(buffer.paint.tobytes() + buffer.finished.tobytes())
    assert pictures[0] == pictures[1]


def test_no_strokes_paint_nothing() -> None:
    buffer = empty_buffer(SIZE)
    none = Strokes(*(getattr(dots([(1, 1)], [(0, 0, 0)], Brush()), k)[:0] for k in Strokes.__dataclass_fields__))
    streamlines_forward(buffer, none, even(0), np.zeros(0, np.float32), np.zeros(0, np.intp))
    assert all((mine == theirs).all() for mine, theirs in zip(buffer, empty_buffer(SIZE), strict=True))


def test_a_denser_texture_has_finer_bristles() -> None:
    """Changes of lightness across a stroke of 40 px, relative to its variation."""
    changes = []
    for bristles in (1, 5, 15):
        buffer, brush = empty_buffer(SIZE), Brush(size_px=40, grain=1.0)
        options = RasterOptions(profile=StrokeProfile((0, 0), streaks=40, dry=0, soft=0, bristles=bristles))
        strokes = dots([(55, 45)], [(120, 120, 120)], brush)
        streamlines_forward(buffer, strokes, even(0), np.array([60], np.float32), np.array([0], np.intp), options)
        across = buffer.paint[30:60, 40:70, 0]
        changes.append(np.abs(np.diff(across, axis=0)).mean() / across.std())
    assert changes[0] < 0.75 * changes[1] and changes[1] < 0.8 * changes[2]
