"""Blend modes on known values."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.compositing import Blend, lay_over

BELOW, ABOVE = np.full((2, 2, 3), 100, np.uint8), np.full((2, 2, 3), 200, np.uint8)


@pytest.mark.parametrize(
    ("blend", "opacity", "expected"),
    [("over", 1.0, 200), ("over", 0.25, 125), ("multiply", 1.0, 78), ("screen", 1.0, 222), ("add", 1.0, 255),
     ("add", 0.5, 178)],
)  # fmt: skip
def test_values_of_a_blend(blend: Blend, opacity: float, expected: int) -> None:
    assert (lay_over(BELOW, ABOVE, opacity, blend) == expected).all()


def test_a_matte_limits_the_layer() -> None:
    matte = np.array([[255, 0], [128, 255]], np.uint8)
    assert lay_over(BELOW, ABOVE, 1.0, "over", matte)[..., 0].tolist() == [[200, 100], [150, 200]]
