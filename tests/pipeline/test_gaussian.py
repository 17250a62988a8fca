"""Large blurs at a fraction of the size differ little from exact ones."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.frames import Frame
from pipeline.gaussian import sigma_in_cells, wide_gaussian
from pipeline.scenes import scene


@pytest.fixture(scope="module")
def picture() -> Frame:
    return scene("harbour", (331, 187), frames=1).image(0)


@pytest.mark.parametrize("sigma_px", [0.8, 3.9, 4.0, 7.3, 16.0])
def test_a_wide_blur_is_nearly_the_exact_one(picture: Frame, sigma_px: float) -> None:
    exact = np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma_px), np.int16)
    off = np.abs(wide_gaussian(picture, sigma_px) - exact)
    assert off.mean() < 0.7 and off.max() < 16
    if sigma_px < 4:
        assert not off.any()


def test_pictures_smaller_than_two_cells_are_blurred_exactly(picture: Frame) -> None:
    small = picture[:9, :14]
    np.testing.assert_array_equal(wide_gaussian(small, 16.0), cv2.GaussianBlur(small, (0, 0), 16.0))


@pytest.mark.parametrize(("sigma_px", "cell"), [(4.0, 2), (9.0, 4), (2.0, 1)])
def test_the_variance_of_cells_and_gaussian_adds_up(sigma_px: float, cell: int) -> None:
    cells = np.arange(cell) - (cell - 1) / 2
    assert (cells**2).mean() + (cell * sigma_in_cells(sigma_px, cell)) ** 2 == pytest.approx(sigma_px**2)
