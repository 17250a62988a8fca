"""Blend modes on known values."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from psd_tools.composite.blend import BLEND_FUNC
from psd_tools.constants import BlendMode

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


@pytest.mark.parametrize("blend", get_args(Blend))
def test_blends_are_those_of_photoshop(blend: Blend) -> None:
    """psd-tools is the judge: it composites as Photoshop does."""
    draw = np.random.default_rng(3)
    a, b = (draw.integers(0, 256, (64, 64, 3)).astype(np.uint8) for _ in range(2))
    for row, value in enumerate((0, 1, 127, 128, 254, 255)):
        a[row], b[:, row] = value, value
    mode = {"over": BlendMode.NORMAL, "add": BlendMode.LINEAR_DODGE}.get(blend) or BlendMode[
        blend.upper().replace("-", "_")
    ]
    judged = BLEND_FUNC[mode](b.astype(np.float32) / 255, a.astype(np.float32) / 255) * 255
    found = lay_over(b, a, 1.0, blend)
    assert np.abs(found - judged).max() <= 1.01
