"""Eight pixels at a time: in kernels, the numbers are those of the Python versions, bit by bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.intrinsics import LANES
from pipeline.jit import kernel
from pipeline.strokes.bristles import fine_tile
from pipeline.strokes.eight_pixels import cover_even, cover_tapered, lay, shade, with_spare


@kernel
def _covered_evenly(
    boxes: Any, at: int, finished: Any, pixel: int, x: int, count: int, segment: Any, ends: bool
) -> Any:
    return cover_even(boxes, at, finished, pixel, x, count, segment, ends)


@kernel
def _covered_tapered(
    boxes: Any, at: int, finished: Any, pixel: int, x: int, count: int, segment: Any, ends: bool
) -> Any:
    return cover_tapered(boxes, at, finished, pixel, x, count, segment, ends)


@kernel
def _shaded(boxes: Any, at: int, image: Any, pixel: int, tile: Any, stroke: Any, offsets: Any, guided: bool) -> None:
    shade(boxes, at, image, pixel, tile, stroke, offsets, guided)


@kernel
def _laid(paint: Any, index: int, opacity: np.float32, light: np.float32, ridge: np.float32, colour: Any) -> Any:
    return lay(paint, index, opacity, light, ridge, colour)


def floats(*values: float) -> tuple[np.float32, ...]:
    return tuple(np.float32(value) for value in values)


def boxes(seed: int) -> list[NDArray[np.float32]]:
    """Coverage, position along and across of 32 pixels, half of which are covered."""
    random = np.random.default_rng(seed)
    coverage = np.where(random.random(32) < 0.5, 0, random.random(32)).astype(np.float32)
    return [coverage, random.uniform(-2, 30, 32).astype(np.float32), random.uniform(-1, 1, 32).astype(np.float32)]


@pytest.mark.parametrize("count", [1, 5, 8, 20])
@pytest.mark.parametrize("ends", [False, True])
@pytest.mark.parametrize(("inside", "outside"), [(_covered_evenly, cover_even), (_covered_tapered, cover_tapered)])
def test_pixels_are_covered_as_outside_of_kernels(inside: Any, outside: Any, ends: bool, count: int) -> None:
    covered = 0
    for seed in range(30):
        random = np.random.default_rng(seed)
        angle = random.uniform(0, 2 * np.pi)
        s_row, t_row, length, before, r = random.uniform([-4, -3, 1, 0, 0.5], [6, 3, 12, 9, 4])
        segment = floats(
            100 + random.uniform(-3, 9), np.cos(angle), np.sin(angle), s_row, t_row, length, before, 1 / 25, r, 1 / r,
            0.9, 0.6, 0.7,
        )  # fmt: skip
        finished = random.random(64) < 0.3
        made, expected = boxes(seed), boxes(seed)
        found = inside(tuple(made), 9, finished, 30, 100, count, segment, ends)
        assert found == outside(tuple(expected), 9, finished, 30, 100, count, segment, ends)
        np.testing.assert_array_equal(made, expected)
        covered += found[1] >= 0
    assert covered > 5


@pytest.mark.parametrize("guided", [False, True])
@pytest.mark.parametrize("grain", [0.0, 0.8])
def test_paint_is_shaded_as_outside_of_kernels(guided: bool, grain: float) -> None:
    tile = fine_tile(3).reshape(-1)
    for seed in range(30):
        image = np.random.default_rng(seed).integers(90, 150, 300, dtype=np.uint8)
        stroke = floats(0.8, 30**2, 37.5**2, 37.5, 7.5, 120, 115, 125, grain, 40, 0.9, 1 / 25, 1.3, 4.5)
        made, expected = boxes(seed), boxes(seed)
        _shaded(tuple(made), 7, image, 50, tile, stroke, (12, 1000), guided)
        shade(tuple(expected), 7, image, 50, tile, stroke, (12, 1000), guided)
        np.testing.assert_array_equal(made, expected)


def test_paint_is_laid_as_outside_of_kernels() -> None:
    random = np.random.default_rng(0)
    for _ in range(20):
        made = random.uniform(0, 200, 40).astype(np.float32)
        expected, values = made.copy(), floats(*random.uniform(0, 1, 3))
        colour = floats(*random.uniform(0, 255, 4))
        assert _laid(made, 15, *values, colour) == lay(expected, 15, *values, colour)
        np.testing.assert_array_equal(made, expected)


def test_a_picture_with_spare_pixels_is_the_same_picture() -> None:
    picture = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    made = with_spare(picture)
    np.testing.assert_array_equal(made, picture)
    assert made.flags.c_contiguous and made.base is not None and made.base.size == picture.size + 3 * LANES
