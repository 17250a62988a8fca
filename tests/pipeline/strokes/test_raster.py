"""Rasterisation of strokes: width, area, compositing, borders."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pipeline.strokes.brush import Brush, Canvas, Strokes, blank, discs, tint
from pipeline.strokes.raster import StrokeProfile, paint, painting_order, slopes_of
from pipeline.strokes.seeds import Seeds

PLAIN = StrokeProfile(taper=(0, 0), streaks=0, dry=0)
ODD = (61, 83)


def black(shape: tuple[int, int] = ODD) -> Canvas:
    return blank(np.zeros((*shape, 3), np.uint8))


def line(points: list[tuple[float, float]], size: float = 8, opacity: float = 1.0, name: int = 1) -> Strokes:
    seeds = Seeds(np.array(points[:1], np.float32), np.array([name], np.uint64))
    start = discs(seeds, Brush(size_px=size, opacity=opacity, relief_px=2), np.array([[200, 100, 50]], np.float32))
    return replace(start, points=np.array([points], np.float32), counts=np.array([len(points)], np.int32))


def both(a: Strokes, b: Strokes) -> Strokes:
    return Strokes(**{k: np.concatenate([getattr(a, k), getattr(b, k)]) for k in vars(a)})


@pytest.mark.parametrize("size", [3.0, 6.5, 10.0])
@pytest.mark.parametrize("degrees", [0, 17, 45, 90, 133])
def test_width_and_area_of_a_straight_stroke(size: float, degrees: int) -> None:
    dx, dy = 17 * math.cos(math.radians(degrees)), 17 * math.sin(math.radians(degrees))
    points = [(41.3 + k * dx, 30.2 + k * dy) for k in (-1, -0.3, 0.4, 1)]
    cover = paint(black(), line(points, size), profile=PLAIN)[..., 0] / 200
    assert cover.sum() == pytest.approx(34 * size + math.pi * size**2 / 4, rel=0.03)
    if degrees == 0:
        assert cover[:, 41].sum() == pytest.approx(size, rel=0.02)


def test_a_disc_has_its_area() -> None:
    assert paint(black(), line([(40.4, 30.7)], 11), profile=PLAIN)[..., 0].sum() / 200 == pytest.approx(
        math.pi * 5.5**2, rel=0.02
    )


def test_a_taper_narrows_the_ends_only() -> None:
    points = [(20.0 + 5 * k, 30.0) for k in range(9)]
    cover = paint(black(), line(points, 10), profile=StrokeProfile(taper=(0.2, 0.8), streaks=0))[..., 0] / 200
    assert cover[:, 40].sum() == pytest.approx(10, rel=0.02)
    assert cover[:, 60].sum() < 3 and 6 < cover[:, 20].sum() < 9


def test_opacity_composites_exactly() -> None:
    canvas = blank(np.full((*ODD, 3), 40, np.uint8))
    paint(canvas, line([(20, 30), (60, 30)], 12, 0.25, 1), profile=PLAIN)
    paint(canvas, line([(40, 10), (40, 50)], 12, 0.5, 2), profile=PLAIN)
    once = 40 + 0.25 * (200 - 40)
    np.testing.assert_allclose(canvas[30, 25, :3], [80, 40 + 15, 40 + 2.5], atol=1e-4)
    assert canvas[30, 40, 0] == pytest.approx(once + 0.5 * (200 - once), abs=1e-4)
    np.testing.assert_array_equal(canvas[..., :3], canvas[..., 4:])


def test_a_stroke_that_crosses_itself_does_not_cover_twice() -> None:
    loop = [(20.0, 30.0), (60.0, 30.0), (60.0, 45.0), (40.0, 45.0), (40.0, 15.0)]
    canvas = paint(black(), line(loop, 8, 0.5), profile=PLAIN)
    assert canvas[..., 0].max() == pytest.approx(100, abs=1e-3)


def test_strokes_do_not_cover_other_colours() -> None:
    guide = np.full((*ODD, 3), (200, 100, 50), np.uint8)
    guide[:, 50:] = 0
    canvas = paint(black(), line([(20, 30), (70, 30)]), profile=PLAIN, guide=guide, tolerance=60)
    assert canvas[30, 49, 0] == 200 and not canvas[:, 50:].any()


def test_shifted_colours_are_not_another_surface() -> None:
    guide = np.full((*ODD, 3), (200, 100, 50), np.uint8)
    stroke = replace(line([(20, 30), (70, 30)]), colours=np.array([[0, 0, 255]], np.float32))
    canvas = paint(black(), stroke, profile=PLAIN, guide=guide, tolerance=10)
    np.testing.assert_array_equal(canvas[30, 40, :3], [0, 0, 255])
    np.testing.assert_array_equal(canvas[30, 40, 4:], [200, 100, 50])


def test_bristles_leave_streaks_along_the_stroke() -> None:
    hairy = replace(line([(10.0 + 6 * k, 30.0) for k in range(11)], 16), grain=np.ones(1, np.float32))
    canvas = paint(black(), hairy, profile=StrokeProfile(taper=(0, 0), streaks=40, dry=0))
    inside = canvas[24:37, 25:60, 3]
    assert np.abs(np.diff(inside, axis=0)).mean() > 3 * np.abs(np.diff(inside, axis=1)).mean()
    assert 0 < inside.min() < inside.max() <= 2


def test_a_denser_texture_has_finer_bristles() -> None:
    wide = replace(line([(10.0 + 6 * k, 30.0) for k in range(11)], 40), grain=np.ones(1, np.float32))
    changes = []
    for bristles in (1, 5):
        profile = StrokeProfile(taper=(0, 0), streaks=40, dry=0, bristles=bristles)
        across = paint(black(), wide, profile=profile)[14:46, 25:60, 0]
        changes.append(np.abs(np.diff(across, axis=0)).mean() / across.std())
    assert changes[0] < 0.5 * changes[1]


@pytest.mark.parametrize("shape", [(16, 17), (61, 83), (17, 130)])
def test_strokes_across_every_border_stay_inside(shape: tuple[int, int]) -> None:
    h, w = shape
    framed = np.zeros((h + 20, w + 20, 7), np.float32)
    window = framed[10:-10, 10:-10]
    for name, ends in enumerate([[(-30, -20), (w + 30, h + 25)], [(-5, h), (w, h + 3)], [(w + 9, -9)], [(w / 2, -40)]]):
        paint(window, line([(float(x), float(y)) for x, y in ends], 9, name=name), profile=PLAIN)
    assert window.any() and np.isfinite(framed).all()
    window[:] = 0
    assert not framed.any()


def test_the_painting_order_is_by_id() -> None:
    ids = np.array([5, 9, 1, 44], np.uint64)
    assert ids[painting_order(ids)].tolist() == ids[::-1][painting_order(ids[::-1].copy())].tolist()


def test_colour_shift_and_jitter() -> None:
    n = 400
    seeds = Seeds(np.zeros((n, 2), np.float32), np.arange(n, dtype=np.uint64))
    aims = np.tile(np.array([[180, 60, 60]], np.float32), (n, 1))
    np.testing.assert_array_equal(tint(aims, seeds, Brush()), aims)
    np.testing.assert_allclose(tint(aims, seeds, Brush(hue_deg=120))[0], [60, 180, 60], atol=0.1)
    gray = np.full((n, 3), 90, np.float32)
    assert np.ptp(tint(gray, seeds, Brush(saturation=0.5)), axis=1).max() < 0.1
    stray = tint(aims, seeds, Brush(jitter=0.5)) - aims
    assert np.abs(stray.mean(axis=0)).max() < 2.5 and 5 < stray.std() < 20
    assert stray.tobytes() != (tint(aims, seeds, Brush(jitter=0.5), seed=1) - aims).tobytes()


def test_jitter_changes_the_lightness_of_grays_and_the_hue_of_colours() -> None:
    seeds, brush = Seeds(np.zeros((400, 2), np.float32), np.arange(400, dtype=np.uint64)), Brush(jitter=0.5)
    gray, grayish, coloured = (
        tint(np.tile(np.array([[120, 120 - chroma, 120]], np.float32), (400, 1)), seeds, brush) for chroma in (0, 8, 16)
    )
    assert np.ptp(gray, axis=1).max() == 0 and gray[:, 0].std() > 5
    strays = [np.ptp(colours - colours.mean(axis=1, keepdims=True), axis=1).std() for colours in (grayish, coloured)]
    assert 0.3 * strays[1] < strays[0] < 0.7 * strays[1]


def test_black_paint_has_no_jitter() -> None:
    seeds = Seeds(np.zeros((400, 2), np.float32), np.arange(400, dtype=np.uint64))
    black, dark, gray = (
        np.abs(tint(np.full((400, 3), value, np.float32), seeds, Brush(jitter=0.5)) - value).mean()
        for value in (0, 12, 48)
    )
    assert black == 0
    assert dark == pytest.approx(gray / 2, rel=0.1)


def test_slopes_remove_steps_of_a_slanted_silhouette() -> None:
    """The end of the stroke, measured per row to a fraction of a px, lies on a straight line."""
    y, x = np.mgrid[: ODD[0], : ODD[1]].astype(float)
    inside = np.clip((40 + 0.3 * (y - 30) - x) / 3 + 0.5, 0, 1)  # an edge as soft as a camera's, three px wide
    guide = np.rint(inside[..., None] * (200, 100, 50)).astype(np.uint8)
    rows, off = np.arange(20, 41), []
    for slopes in (None, slopes_of(guide)):
        canvas = paint(black(), line([(10, 30), (75, 30)], 30), profile=PLAIN, guide=guide, tolerance=60, slopes=slopes)
        ends = canvas[rows, 20:60, 0].sum(axis=1) / 200
        off.append(np.abs(ends - np.polyval(np.polyfit(rows, ends, 1), rows)).max())
    assert off[1] < 0.1 < 0.3 < off[0]


def test_slopes_are_the_change_per_px() -> None:
    ramp = np.zeros((*ODD, 3), np.uint8)
    ramp[..., 0] = np.arange(ODD[1]) * 3
    np.testing.assert_allclose(slopes_of(ramp)[:, 1:-1], 3)
    np.testing.assert_array_equal(slopes_of(np.full((*ODD, 3), 7, np.uint8)), 0)
