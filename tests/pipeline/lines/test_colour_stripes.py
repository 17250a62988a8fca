"""Thin coloured regions are not covered by ink; dark, gray and mixed ones are."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.lines.coherent import Ink
from pipeline.lines.colour_stripes import erase_ink_on_thin_regions

WHITE, ORANGE, BLACK, BLUE = (250, 128, 128), (170, 150, 180), (30, 150, 180), (140, 120, 80)
GRAY, PALE_BLUE = (150, 128, 128), (195, 124, 104)
Colour = tuple[int, int, int]


def inked_stripe(left: Colour, stripe: Colour, right: Colour, width: int = 4, enlarged: int = 1) -> tuple[Ink, Ink]:
    """Ink on a vertical stripe between two areas, before and after: rows of 60 px; the stripe begins at column 28."""
    labels = np.ones((40, 60), np.int32)
    labels[:, 28 : 28 + width] = 2
    labels[:, 28 + width :] = 3
    drawn = np.zeros(labels.shape, np.uint8)
    drawn[:, 28:32] = 255
    means = np.array([(0, 0, 0), left, stripe, right], np.float32)
    ink = np.repeat(np.repeat(drawn, enlarged, 0), enlarged, 1)
    areas = np.bincount(labels.ravel()).astype(np.int32)
    left, drawn_left = erase_ink_on_thin_regions(ink, drawn, labels, areas, means)
    np.testing.assert_array_equal(left[::enlarged, ::enlarged], drawn_left)
    return ink, left


@pytest.mark.parametrize("enlarged", [1, 2, 3])
def test_a_narrow_coloured_stripe_has_no_ink(enlarged: int) -> None:
    ink, left = inked_stripe(WHITE, ORANGE, WHITE, enlarged=enlarged)
    assert ink.any() and not left.any()


@pytest.mark.parametrize(
    ("left", "stripe", "right", "width"),
    [
        (WHITE, BLACK, WHITE, 4),
        (WHITE, GRAY, WHITE, 4),
        (WHITE, ORANGE, ORANGE, 4),
        (WHITE, PALE_BLUE, BLUE, 4),
        (WHITE, ORANGE, WHITE, 12),
        (BLACK, ORANGE, BLACK, 4),
    ],
    ids=[
        "dark",
        "gray",
        "the outline of an area",
        "a mixture along an outline",
        "wider than the line",
        "brighter than what is beside it",
    ],
)
def test_other_ink_is_kept(left: Colour, stripe: Colour, right: Colour, width: int) -> None:
    ink, after = inked_stripe(left, stripe, right, width)
    np.testing.assert_array_equal(after, ink)


def test_ink_elsewhere_is_kept() -> None:
    labels = np.ones((40, 60), np.int32)
    labels[:, 28:32] = 2
    ink: NDArray[np.uint8] = np.zeros(labels.shape, np.uint8)
    ink[:, 28:32] = ink[:, 5:8] = 255
    means = np.array([(0, 0, 0), WHITE, ORANGE], np.float32)
    after, _ = erase_ink_on_thin_regions(ink, ink, labels, np.array([0, 2240, 160], np.int32), means)
    assert (after[:, 5:8] == 255).all() and not after[:, 28:32].any()
