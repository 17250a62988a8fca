"""Layers: each reduces the error where it is requested."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from pipeline.strokes.brush import Brush, Canvas, blank
from pipeline.strokes.layers import (
    FARTHEST,
    LayerScheme,
    StillPainting,
    area_error,
    colour_error,
    layer_brush,
    layer_threshold,
    paint_still,
)

SIZE = (81, 107)
FIELD = np.full((*SIZE, 2), [math.cos(1.0), math.sin(1.0)], np.float32)
BRUSH = Brush(size_px=12, length_px=40, relief_px=1, grain=0.5)


def scene() -> np.ndarray:
    y, x = np.indices(SIZE)
    picture = np.dstack([90 + x, 60 + y, 120 + 0 * x]).astype(np.uint8)
    cv2.circle(picture, (60, 40), 22, (230, 210, 40), -1)
    cv2.circle(picture, (55, 36), 5, (10, 10, 40), -1)
    return picture


def error(canvas: Canvas) -> float:
    return float(colour_error(scene(), canvas).mean())


def test_each_layer_reduces_the_error() -> None:
    errors = [
        error(paint_still(scene(), FIELD, StillPainting(BRUSH, LayerScheme(most=n), threshold=10))) for n in (1, 2, 3)
    ]
    assert errors[0] > 1.15 * errors[1] > 1.15 * errors[2]


def test_shifted_colours_add_no_strokes() -> None:
    shifted = Brush(size_px=12, length_px=40, hue_deg=90, jitter=0.8)
    plain = Brush(size_px=12, length_px=40)
    one, other = (paint_still(scene(), FIELD, StillPainting(b, seed=3)) for b in (plain, shifted))
    assert np.abs(one[..., :3] - other[..., :3]).mean() > 30
    np.testing.assert_array_equal(one[..., 4:], other[..., 4:])


def test_equal_seeds_give_equal_bytes_and_other_seeds_others() -> None:
    a, b, other = (paint_still(scene(), FIELD, StillPainting(BRUSH, seed=seed)) for seed in (5, 5, 6))
    assert a.tobytes() == b.tobytes() != other.tobytes()


@pytest.mark.parametrize("shape", [(16, 16), (17, 61), (53, 19)])
def test_odd_sizes_are_accepted(shape: tuple[int, int]) -> None:
    picture = np.ascontiguousarray(scene()[: shape[0], : shape[1]])
    canvas = paint_still(picture, np.ascontiguousarray(FIELD[: shape[0], : shape[1]]), StillPainting(BRUSH))
    assert canvas.shape == (*shape, 7) and np.isfinite(canvas).all()
    assert np.abs(canvas[..., 4:] - picture).mean() < 40


def test_the_threshold_is_continuous() -> None:
    layers = np.linspace(1, 3, 201, dtype=np.float32)[None].repeat(2, axis=0)
    second, third = (layer_threshold(layers, 30.0, k, layers.shape)[0] for k in (1, 2))
    assert (layer_threshold(layers, 30.0, 0, layers.shape) < 0).all()
    assert (second[layers[0] <= 1.5] == FARTHEST).all() and (second[layers[0] >= 2] == 30).all()
    assert (third[layers[0] <= 2.5] == FARTHEST).all() and third[-1] == 30
    assert (np.diff(second) <= 0).all() and np.abs(np.diff(second)).max() < 17


def test_strokes_of_a_fractional_layer_appear_one_by_one() -> None:
    counts = []
    for layers in (1.4, 1.86, 1.91, 1.95, 2.0):
        canvas = paint_still(scene(), FIELD, StillPainting(BRUSH, LayerScheme(most=2), layers=layers, threshold=10))
        counts.append(error(canvas))
    assert counts[0] == error(paint_still(scene(), FIELD, StillPainting(BRUSH, LayerScheme(most=1))))
    assert counts == sorted(counts, reverse=True) and len(set(counts)) >= 4


def test_area_error_is_the_mean_over_the_clipped_square() -> None:
    values = np.random.default_rng(2).uniform(0, 200, (21, 33)).astype(np.float32)
    points = np.array([[10, 9], [0, 0], [32, 20]], np.float32)
    found = area_error(values, points, np.array([6, 4, 8], np.float32))
    wanted = [values[6:13, 7:14].mean(), values[:3, :3].mean(), values[16:, 28:].mean()]
    np.testing.assert_allclose(found, wanted, rtol=1e-5)


def test_error_of_black_and_white() -> None:
    canvas = blank(np.zeros((16, 16, 3), np.uint8))
    np.testing.assert_allclose(colour_error(np.full((16, 16, 3), 255, np.uint8), canvas), 255 * math.sqrt(3), rtol=1e-6)


def test_finer_layers_have_smaller_strokes_and_less_jitter() -> None:
    fine = layer_brush(Brush(size_px=8, length_px=40, jitter=0.4, relief_px=2), 0.25, 1)
    assert (fine.size_px, fine.length_px, fine.relief_px) == (2, 20, 0.5) and fine.jitter == pytest.approx(0.1)
