"""The cascade of classifiers: the same windows as OpenCV's, and kernels that equal their Python version."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from cv2.data import haarcascades
from numpy.typing import NDArray

from pipeline.flow.gray import Gray
from pipeline.intrinsics import LANES
from pipeline.jit import kernel
from pipeline.scenes import scene
from pipeline.segmentation.cascade import Cascade, Window, accepted_windows
from pipeline.segmentation.stump_votes import CORNERS, RECTS, Stumps, add_votes

FRONTAL, PROFILE = "haarcascade_frontalface_default.xml", "haarcascade_profileface.xml"
KINDS = FRONTAL, PROFILE


@cache
def cascade(name: str) -> Cascade:
    return Cascade(Path(haarcascades) / name)


def opencvs(name: str, gray: Gray, ratio: float, least_px: int, most_px: int) -> list[Window]:
    detector = cv2.CascadeClassifier(haarcascades + name)
    found = detector.detectMultiScale(gray, ratio, 0, minSize=(least_px,) * 2, maxSize=(most_px,) * 2)
    return sorted((int(x), int(y), int(w), int(h)) for x, y, w, h in found)


def ours(name: str, gray: Gray, ratio: float, least_px: int, most_px: int) -> list[Window]:
    return sorted(accepted_windows(cascade(name), gray, ratio, least_px, most_px))


@pytest.mark.parametrize("ratio", [1.03, 1.1, 1.2])
@pytest.mark.parametrize("height", [90, 241, 480])
def test_windows_of_a_portrait_are_opencvs(height: int, ratio: float) -> None:
    gray = cv2.cvtColor(scene("portrait", (height * 4 // 3, height), frames=1).image(0), cv2.COLOR_RGB2GRAY)
    found = ours(FRONTAL, gray, ratio, 24, height)
    assert found, "the portrait is a face"
    assert found == opencvs(FRONTAL, gray, ratio, 24, height)
    assert ours(PROFILE, gray, ratio, 20, height) == opencvs(PROFILE, gray, ratio, 20, height)


def test_windows_of_noise_are_opencvs() -> None:
    """Blurred noise of all sizes, down to less than a window, with limits that no window fits, too."""
    random, found = np.random.default_rng(7), 0
    for number in range(150):
        height, width = random.integers(18, 180, 2)
        noise = random.integers(0, 256, (height, width), dtype=np.uint8)
        blurred = cv2.GaussianBlur(noise, (0, 0), random.uniform(0.5, 6))
        gray = np.asarray(cv2.normalize(blurred, np.empty_like(noise), 0, 255, cv2.NORM_MINMAX), np.uint8)
        if number % 15 == 0:
            gray[:] = number  # flat
        ratio, least, most = random.uniform(1.03, 1.6), int(random.integers(10, 60)), int(random.integers(20, 200))
        for name in KINDS:
            theirs = opencvs(name, gray, ratio, least, most)
            assert ours(name, gray, ratio, least, most) == theirs
            found += len(theirs)
    assert found > 10


def test_a_band_of_rows_may_be_a_view() -> None:
    gray = cv2.cvtColor(scene("portrait", (320, 240), frames=1).image(0), cv2.COLOR_RGB2GRAY)
    band = gray[10:230]
    assert ours(FRONTAL, band, 1.2, 24, 200) == opencvs(FRONTAL, band.copy(), 1.2, 24, 200)


def test_a_file_that_is_no_cascade_is_an_error(tmp_path: Path) -> None:
    file = tmp_path / "cascade.xml"
    file.write_text("<opencv_storage></opencv_storage>")
    with pytest.raises((ValueError, IndexError)):
        Cascade(file)


@kernel
def _voted(
    votes: NDArray[np.float64], factors: NDArray[np.float32], sums: NDArray[np.int32], at: int,
    corners: NDArray[np.int32], stumps: Stumps,
) -> None:  # fmt: skip
    for stump in range(len(stumps[1])):
        add_votes(votes, factors, 3, sums, at, corners, stumps, stump)


def test_votes_are_added_in_kernels_as_outside_of_them() -> None:
    random, stumps = np.random.default_rng(2), 20
    sums = random.integers(-(2**20), 2**20, 400, dtype=np.int32)
    corners = random.integers(0, 300, stumps * RECTS * CORNERS, dtype=np.int32)
    weights = random.normal(0, 2, (stumps, RECTS)).astype(np.float32)
    weights[::2, 2] = 0  # two rectangles
    thresholds, leaves = random.normal(0, 1, stumps).astype(np.float32), random.normal(0, 1, 2 * stumps)
    given: Stumps = weights.reshape(-1), thresholds, leaves.astype(np.float32)
    factors = random.uniform(1e-7, 1e-6, 3 + LANES).astype(np.float32)
    inside, outside = np.zeros(LANES), np.zeros(LANES)
    _voted(inside, factors, sums, 50, corners, given)
    for stump in range(stumps):
        add_votes(outside, factors, 3, sums, 50, corners, given, stump)
    np.testing.assert_array_equal(inside, outside)
    assert len(set(inside.tolist())) > 1
