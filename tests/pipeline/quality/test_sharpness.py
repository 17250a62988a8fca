"""Edge widths of steps whose blur is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.frames import Frame
from pipeline.quality.sharpness import edge_widths


def tilted_step(sigma_px: float) -> Frame:
    """A straight edge at about 20 degrees, drawn at eight times the size, reduced, and blurred."""
    big = np.zeros((1024, 1024), np.uint8)
    cv2.fillPoly(big, [np.array([[300, 0], [1024, 0], [1024, 1024], [680, 1024]])], 200)
    small = cv2.resize(big, (128, 128), interpolation=cv2.INTER_AREA).astype(np.float32)
    soft = cv2.GaussianBlur(small, (0, 0), sigma_px) if sigma_px else small
    return np.repeat(np.round(soft).astype(np.uint8)[..., None], 3, axis=2)


@pytest.mark.parametrize("sigma_px", [1.0, 1.5, 2.0])
def test_the_width_of_a_blurred_step(sigma_px: float) -> None:
    assert np.median(edge_widths(tilted_step(sigma_px))) == pytest.approx(np.hypot(1, 2.56 * sigma_px), rel=0.08)


def test_an_antialiased_step_is_about_one_pixel_wide() -> None:
    assert 0.7 < np.median(edge_widths(tilted_step(0))) < 1.4


def test_a_picture_without_edges_has_none() -> None:
    assert edge_widths(np.full((64, 64, 3), 90, np.uint8)).shape == (0,)
