"""Temporal blending of colours: changes fade, moving borders stay sharp."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.colour.memory import blend_colours, border_mask, moving_borders

COLOURS = np.array([[0, 0, 0], [10, 20, 30], [200, 210, 220]], np.uint8)


def halves() -> np.ndarray:
    labels = np.ones((10, 20), np.int32)
    labels[:, 10:] = 2
    return labels


def test_border_mask_covers_both_sides() -> None:
    mask = border_mask(halves())
    assert (mask[:, 9:11] == 255).all() and (mask[:, :8] == 0).all() and (mask[:, 12:] == 0).all()


def test_only_moving_borders_are_marked() -> None:
    flow = np.zeros((10, 20, 2), np.float32)
    flow[5:, :, 1] = 1.5
    moving = moving_borders(halves(), flow)
    assert (moving[:5] == 0).all() and (moving[5:, 9:11] > 0).all() and (moving[5:, :8] == 0).all()


def blended(past: np.ndarray, weight: int, moving: bool) -> np.ndarray:
    result = past.copy()
    blend_colours(
        COLOURS[halves()], result, np.zeros((10, 20), np.uint8), np.full(256, weight, np.int32),
        np.full((10, 20), 255 * moving, np.uint8),
    )  # fmt: skip
    return result


def test_colours_are_blended_by_weight() -> None:
    made = blended(np.full((10, 20, 3), 100, np.uint8), 128, moving=False)
    assert made[0, 0, 0] == pytest.approx(55, abs=1) and made[0, 19, 0] == pytest.approx(150, abs=1)


def test_moving_borders_are_blended_less_than_vanished_regions() -> None:
    flat = COLOURS[halves()]
    shifted = np.roll(flat, 1, axis=1)
    still, moving = (np.abs(blended(shifted, 200, moving=m).astype(int) - flat)[:, 2:].max() for m in (False, True))
    assert 0 < moving < still
    gone = np.full((10, 20, 3), 255, np.uint8)
    assert abs(int(blended(gone, 200, moving=True)[5, 18, 0]) - int(blended(gone, 200, moving=False)[5, 18, 0])) <= 12
