"""Error of paint: less is tolerated in smooth areas, and only wrong and outdated paint is rejected."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.frames import Frame
from pipeline.gaussian import upscale_cells
from pipeline.methods.patches.appearance import ColourSum, PanoramaRect, period_picture
from pipeline.methods.patches.paint_error import (
    MIN_TOLERANCE,
    Rendering,
    cell_px,
    error_tolerance,
    misfit,
    patch_weight,
    relative_sharpness,
)
from pipeline.methods.patches.painter import HertzmannPainter
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.scan import WorkingGrid

SIZE = (344, 344)
GRID = WorkingGrid.of(SIZE)
LIMIT = np.full((344, 344), 20, np.float32)
NOISE = np.random.Generator(np.random.Philox(5)).uniform(-90, 90, (344, 172, 1)).astype(np.float32)


def halves() -> Frame:
    """Smooth in the left half, detailed in the right half."""
    frame = np.full((344, 344, 3), 150, np.float32)
    frame[:, 172:] += cv2.GaussianBlur(NOISE, (0, 0), 1)[..., None] * 2
    return np.asarray(np.clip(frame, 0, 255), np.uint8)


def rendering(picture: Frame, painting: Frame) -> Rendering:
    return np.stack([picture, painting])


def with_spot(frame: Frame, shade: int, size: int = 10) -> Frame:
    out = frame.copy()
    out[100 : 100 + size, 60 : 60 + size] = shade
    return out


def test_smooth_areas_tolerate_less_error() -> None:
    tolerance = error_tolerance(halves(), 1.0)
    assert abs(tolerance[:, :100].max() - MIN_TOLERANCE) < 0.02 and tolerance[:, 240:].min() > 0.95


def test_a_single_edge_does_not_raise_the_tolerance_much() -> None:
    frame = np.full((344, 344, 3), 60, np.uint8)
    frame[:, 172:] = 200
    assert error_tolerance(frame, 1.0).max() < 0.85 < error_tolerance(halves(), 1.0).max()


def test_an_object_of_low_contrast_is_painted() -> None:
    """A stripe 14 gray levels lighter than its background, which T = 25 without masking would leave out."""
    frame = np.full((172, 172, 3), 200, np.uint8)
    frame[40:130, 60:72] = 214
    painter = HertzmannPainter.of("hertzmann", 1e9, 172, PatchesParams(jitter=0, relief=0), 0)
    shown = painter.paint_picture(frame)[50:120].astype(float).mean(axis=(0, 2))
    assert shown[62:70].mean() - shown[20:40].mean() > 8


def test_a_small_dark_object_stays_dark() -> None:
    frame = np.full((172, 172, 3), 210, np.uint8)
    frame[80:84, 60:80] = 40
    shown = HertzmannPainter.of("hertzmann", 1e9, 172, PatchesParams(jitter=0), 0).paint_picture(frame)
    assert shown[81:83, 65:75].mean() < 80


def test_paint_misfits_only_where_it_is_wrong_and_outdated() -> None:
    frame = halves()
    dark = with_spot(frame, 20)
    same = misfit(dark, rendering(dark, frame), LIMIT, 2.0)[102:108, 62:68]
    close = misfit(dark, rendering(frame, dark), LIMIT, 2.0)[102:108, 62:68]
    wrong = misfit(dark, rendering(frame, frame), LIMIT, 2.0)[102:108, 62:68]
    assert same.max() == 0 and close.max() == 0 and wrong.min() > 4


@pytest.mark.parametrize("sigma_px", [2.8, 4.2, 6.3])
def test_the_misfit_of_cells_is_that_of_pixels(sigma_px: float) -> None:
    """The Gaussian of the differences, exactly, against the one that is computed on cells."""
    frame = halves()[:, :331]
    changed, limit = with_spot(frame, 20, 60), np.full(frame.shape[:2], 20, np.float32)
    found = upscale_cells(misfit(changed, rendering(frame, frame), limit, sigma_px), cell_px(sigma_px), limit.shape)
    exact = cv2.GaussianBlur(changed.astype(np.float32) - frame, (0, 0), sigma_px)
    assert cell_px(sigma_px) > 1 and found.shape == limit.shape
    np.testing.assert_allclose(found, np.linalg.norm(exact, axis=2) / 20, atol=0.35)


def test_paint_is_compared_only_where_there_is_some() -> None:
    frame, where = halves(), np.zeros((344, 344), np.bool_)
    where[:, 200:] = True
    off = misfit(with_spot(frame, 20, 60), rendering(frame, frame), LIMIT, 2.0, where)
    assert not off.any(), "the spot lies outside"
    where[90:170, 50:130] = True
    assert misfit(with_spot(frame, 20, 60), rendering(frame, frame), LIMIT, 2.0, where)[115:145, 75:105].min() > 4


def test_a_patch_has_no_weight_on_a_new_object_and_full_weight_elsewhere() -> None:
    frame = halves()
    weight = patch_weight(with_spot(frame, 20), rendering(frame, frame), LIMIT, GRID)
    assert weight[100:110, 60:70].max() < 0.02, "the object with its border"
    assert weight[:, 172:].min() > 0.98 and weight[130:].min() > 0.98 and weight[:70].min() > 0.98


def test_a_blurred_mean_is_rejected_at_a_smaller_misfit() -> None:
    frame = halves()
    blurred = np.asarray(cv2.GaussianBlur(frame, (0, 0), 3), np.uint8)
    assert relative_sharpness(blurred, frame, 1.0)[:, 220:].max() < 0.5 < relative_sharpness(frame, frame, 1.0).min()
    limit = np.full((344, 344), 300, np.float32)
    kept = [
        patch_weight(frame, rendering(picture, blurred), limit, GRID)[:, 220:].mean() for picture in (frame, blurred)
    ]
    assert kept[0] > 0.99 and kept[1] < 0.2


def test_areas_that_look_the_same_in_all_periods_are_painted_from_all_of_them() -> None:
    """The mean of a period is noisier than that of all frames, so it is used only where it differs."""
    frame = halves()
    noisy = np.clip(with_spot(frame, 20, 30).astype(int) + np.arange(3) - 1, 0, 255).astype(np.uint8)
    sums = [
        ColourSum((0, 0), mean, np.full((344, 344), count, np.float16)) for mean, count in ((noisy, 8), (frame, 40))
    ]
    own = period_picture(sums[:1], sums[1], PanoramaRect((0, 0), SIZE), GRID, 28)
    np.testing.assert_array_equal(own[160:], frame[160:])
    assert np.abs(own[105:125, 65:85].astype(int) - noisy[105:125, 65:85]).max() <= 1
