"""Borders that move fast are steepened; slow and distant pixels keep their bytes."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.colour.memory import BLEND, moving_borders
from pipeline.methods.abstraction.fast_borders import STEEP, steepen_fast_borders
from pipeline.strokes.steepen import steepen

HEIGHT, WIDTH = 96, 160


def ramp() -> NDArray[np.uint8]:
    """A vertical edge, about five pixels wide, in the middle of a picture, and a horizontal one below."""
    picture = np.full((HEIGHT, WIDTH, 3), 40, np.uint8)
    picture[:, WIDTH // 2 :] = (200, 180, 160)
    picture[80:] = (90, 200, 90)
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 2), np.uint8)


def speeds(pixels_per_frame: float, scale: int = 1) -> NDArray[np.uint8]:
    """Speed of the vertical border, on a grid of 1/`scale` of the sides."""
    labels = np.ones((HEIGHT // scale, WIDTH // scale), np.int32)
    labels[:, labels.shape[1] // 2 :] = 2
    flow = np.zeros((*labels.shape, 2), np.float32)
    flow[..., 0] = pixels_per_frame / scale
    return moving_borders(labels, flow)


def widest_step(picture: NDArray[np.uint8]) -> int:
    """Largest change between two adjacent pixels of a row through the vertical edge."""
    return int(np.abs(np.diff(picture[20, :, 0].astype(int))).max())


def test_speeds_are_those_of_the_flow() -> None:
    assert speeds(3.0).max() == 3 * BLEND.speed_steps and speeds(1000.0).max() == 255 and speeds(0.001).max() == 1


@pytest.mark.parametrize("scale", [1, 2])
def test_a_fast_border_becomes_steeper(scale: int) -> None:
    picture = ramp()
    steepen_fast_borders(picture, speeds(STEEP.fast_px, scale))
    assert widest_step(picture) > 1.5 * widest_step(ramp())


@pytest.mark.parametrize("scale", [1, 2])
def test_a_slow_border_keeps_its_bytes(scale: int) -> None:
    picture = ramp()
    steepen_fast_borders(picture, speeds(STEEP.slow_px, scale))
    np.testing.assert_array_equal(picture, ramp())


def test_only_pixels_near_the_border_change() -> None:
    picture = ramp()
    steepen_fast_borders(picture, speeds(STEEP.fast_px))
    columns = np.flatnonzero((picture != ramp()).any((0, 2)))
    assert columns.min() >= WIDTH // 2 - STEEP.reach_px - 2 and columns.max() <= WIDTH // 2 + STEEP.reach_px + 1


def test_blocks_leave_no_seam() -> None:
    """If all borders move, steepening in parts gives the same pixels as steepening the whole picture."""
    rng = np.random.default_rng(3)
    cells = rng.integers(0, 255, (12, 20, 3), np.uint8)
    squares = cv2.resize(cells, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)
    blurred = np.asarray(cv2.GaussianBlur(squares, (0, 0), 2), np.uint8)
    picture = blurred.copy()
    steepen_fast_borders(picture, np.full((HEIGHT, WIDTH), 255, np.uint8))
    share = round(256 * STEEP.most) // 2
    expected = blurred + ((share * (steepen(blurred, STEEP.steps).astype(int) - blurred) + 64) >> 7)
    np.testing.assert_array_equal(picture, expected)
