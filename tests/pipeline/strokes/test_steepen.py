"""Edge steepening: narrow, anti-aliased edges at the same place, and noise left alone."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.strokes.steepen import STEEPEN, steepen, steepen_wide, steepened_wide


def blurred_edge(sigma_px: float) -> Frame:
    """A vertical edge from dark red to pale blue in column 20, blurred by a Gaussian."""
    step = (np.arange(40) >= 20).astype(np.float32)[None]
    share = cv2.GaussianBlur(step, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE)[0][:, None]
    row = (1 - share) * np.array([90, 10, 20]) + share * np.array([180, 200, 250])
    return np.ascontiguousarray(np.broadcast_to(row, (12, 40, 3)).astype(np.uint8))


@pytest.mark.parametrize("sigma_px", [0.8, 1.2, 1.6])
def test_an_edge_becomes_narrow_and_stays_in_place(sigma_px: float) -> None:
    picture = blurred_edge(sigma_px)
    row = steepen(picture, 4)[6].astype(float)
    share = (row[:, 1] - 10) / 190
    assert ((share > 0.1) & (share < 0.9)).sum() <= 2
    assert abs(share.sum() - ((picture[6, :, 1] - 10.0) / 190).sum()) <= 1


def test_a_slanting_edge_is_anti_aliased_and_keeps_its_place() -> None:
    y, x = np.indices((60, 60), np.float32)
    step = cv2.GaussianBlur((x + 0.23 * y > 35).astype(np.float32), (0, 0), 1.3)
    picture = np.repeat((40 + 160 * step).astype(np.uint8)[..., None], 3, axis=2)
    share = (steepen(picture, 4)[10:50, :, 0].astype(float) - 40) / 160
    assert np.abs(share.sum(axis=1) - step[10:50].sum(axis=1)).max() < 0.5, "no steps of whole pixels"
    assert ((share > 0.1) & (share < 0.9)).sum(axis=1).mean() < 2


def test_noise_and_shading_are_not_steepened() -> None:
    picture = np.random.default_rng(1).integers(100, 100 + STEEPEN.least_step - 1, (24, 24, 3), np.uint8)
    np.testing.assert_array_equal(steepen(picture, 3), picture)


def test_no_steps_return_the_picture_itself() -> None:
    picture = blurred_edge(1.5)
    assert steepen(picture, 0) is picture


def painting(sigma_px: float) -> NDArray[np.float32]:
    """`blurred_edge` as a canvas of four channels, the last of which is paint height."""
    colours = blurred_edge(sigma_px).astype(np.float32)
    return np.ascontiguousarray(np.dstack([colours, np.full(colours.shape[:2], 0.3, np.float32)]))


def ramp_px(canvas: NDArray[np.float32]) -> int:
    share = (canvas[6, :, 1] - 10) / 190
    return int(((share > 0.1) & (share < 0.9)).sum())


def test_a_wide_edge_of_a_painting_becomes_narrower() -> None:
    before, after = painting(2.0), painting(2.0)
    steepen_wide(after, 2)
    assert ramp_px(before) >= 5
    assert ramp_px(after) <= ramp_px(before) - 2
    assert (after[..., 3] == before[..., 3]).all(), "paint height is not a colour"


def test_narrow_and_faint_edges_of_a_painting_keep_their_colours() -> None:
    faint = painting(2.0)
    faint[..., :3] = 100 + (faint[..., :3] - 100) * 0.1
    for canvas in (painting(0.6), faint):
        before = canvas.copy()
        steepen_wide(canvas, 2)
        np.testing.assert_array_equal(canvas, before)


def test_a_wide_edge_of_a_frame_becomes_narrower_by_a_share() -> None:
    frame = np.rint(painting(2.0)[..., :3]).astype(np.uint8)
    half, all_of_it = (steepened_wide(frame, 2, share) for share in (0.5, 1.0))
    assert ramp_px(all_of_it) <= ramp_px(frame) - 2
    changed, less = (np.abs(made.astype(int) - frame) for made in (all_of_it, half))
    assert (np.abs(2 * less - changed) <= 2).all() and changed.max() > 20
    np.testing.assert_array_equal(steepened_wide(frame, 2, 0.0), frame)
