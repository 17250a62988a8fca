"""Points on the ridges of a line response."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.lines.ridges import find_ridges
from tests.pipeline.lines.drawn import stroked, traced


@pytest.mark.parametrize("slope", [0.0, 0.3, 1.0])
def test_points_lie_on_the_axis_of_a_dark_line(slope: float) -> None:
    points, _, _ = traced(stroked([[(5.3, 10.4), (75.3, 10.4 + 70 * slope)]], (90, 90)))
    inside = (points["x"] > 12) & (points["x"] < 68)
    off = (points["y"] - 10.4 - slope * (points["x"] - 5.3)) / np.hypot(1, slope)
    near = inside & (np.abs(off) < 3)
    assert near.sum() > 50 and np.abs(off[near]).max() < 0.15
    along = points[near]
    np.testing.assert_allclose(np.abs(along["along_x"] + along["along_y"] * slope), np.hypot(1, slope), atol=0.02)


def test_a_broad_line_has_a_broader_ridge() -> None:
    narrow, broad = (
        np.median(traced(stroked([[(5, 20), (75, 20)]], (80, 40), width))[0]["half_width"]) for width in (1.5, 3.5)
    )
    assert broad > 1.15 * narrow


def test_the_threshold_falls_with_importance() -> None:
    response = np.zeros((20, 40), np.float32)
    response[9:12] = [[0.8], [1.0], [0.8]]
    importance = np.zeros_like(response)
    importance[:, 20:] = 1
    points, index = find_ridges(response, importance, 1.0, 0.1)
    assert points["x"].min() >= 20 and len(points) == (index >= 0).sum() == 19


def test_a_flat_response_has_none() -> None:
    assert not len(find_ridges(np.full((20, 20), 5, np.float32), np.ones((20, 20), np.float32), 1.0, 0.1)[0])
