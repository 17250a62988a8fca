"""Drawing of regions and ink."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.colour.paint import flat, overlay
from pipeline.frames import Frame

COLOURS = np.array([[255, 0, 255], [200, 40, 10], [10, 120, 230], [90, 90, 90]], np.uint8)


def test_every_pixel_has_its_regions_colour() -> None:
    labels = np.random.default_rng(0).integers(1, 4, (20, 30)).astype(np.int32)
    np.testing.assert_array_equal(flat(labels, COLOURS, soften_px=0), COLOURS[labels])


def test_softening_touches_boundaries_only_and_stays_between_the_colours() -> None:
    labels = np.where(np.arange(30) < 15, 1, 2).astype(np.int32)[None].repeat(20, axis=0)
    out = flat(labels, COLOURS)
    np.testing.assert_array_equal(out[:, :14], COLOURS[labels][:, :14])
    np.testing.assert_array_equal(out[:, 16:], COLOURS[labels][:, 16:])
    for c in range(3):
        low, high = sorted((int(COLOURS[1, c]), int(COLOURS[2, c])))
        assert low < out[10, 14, c] < high and low < out[10, 15, c] < high


@pytest.mark.parametrize("opacity", [1.0, 0.92, 0.5, 0.0])
def test_ink_covers_by_its_opacity(opacity: float) -> None:
    rng = np.random.default_rng(1)
    picture = rng.integers(0, 256, (16, 24, 3)).astype(np.uint8)
    ink = rng.integers(0, 256, (16, 24)).astype(np.uint8)
    ink[0], ink[1] = 255, 0
    before = picture.copy()
    share = ink[..., None] / 255 * opacity
    wanted = before + share * (np.array([14, 11, 16]) - before)
    made = overlay(picture, ink, (14, 11, 16), opacity)
    assert made is picture
    assert np.abs(made - wanted).max() <= 1
    np.testing.assert_array_equal(made[1], before[1])


def test_full_ink_covers_completely_and_no_ink_changes_nothing() -> None:
    picture: Frame = np.arange(16 * 16 * 3, dtype=np.int64).reshape(16, 16, 3).astype(np.uint8)
    before = picture.copy()
    np.testing.assert_array_equal(overlay(picture.copy(), np.zeros((16, 16), np.uint8), (14, 11, 16)), before)
    black = overlay(picture, np.full((16, 16), 255, np.uint8), (14, 11, 16))
    np.testing.assert_array_equal(black, np.broadcast_to([14, 11, 16], black.shape))
