"""Region borders and their coverage anti-aliased fill: no gaps, exact areas, thin regions survive, sharp borders."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.kernels.executors import FrameExecutor
from pipeline.vector.borders import find_borders, hide_borders_under_lines
from pipeline.vector.fill import fill_regions
from pipeline.vector.smoothing import diffusion_steps, smooth_borders

SIZE = (60, 44)


def blobs(count: int = 9, seed: int = 0) -> Labels:
    noise = cv2.GaussianBlur(np.random.default_rng(seed).random((SIZE[1], SIZE[0])), (0, 0), 3)
    ranks = noise.ravel().argsort().argsort().reshape(noise.shape)
    return (1 + ranks * count // ranks.size).astype(np.int32)


def confetti() -> Labels:
    """All kinds of corners, and regions of one pixel."""
    return np.random.default_rng(1).integers(1, 5, (SIZE[1], SIZE[0])).astype(np.int32)


def colours_for(labels: Labels) -> NDArray[np.uint8]:
    return np.random.default_rng(9).integers(0, 256, (int(labels.max()) + 1, 3), np.uint8)


def disc(radius_px: float, side: int = 40) -> Labels:
    y, x = np.mgrid[:side, :side] - (side - 1) / 2
    return np.where(x * x + y * y < radius_px**2, 2, 1).astype(np.int32)


@pytest.mark.parametrize("labels", [blobs(), confetti(), np.ones((20, 30), np.int32)], ids=["blobs", "confetti", "one"])
def test_unsmoothed_borders_give_back_the_label_map(labels: Labels) -> None:
    colours = colours_for(labels)
    size = (labels.shape[1], labels.shape[0])
    np.testing.assert_array_equal(fill_regions(find_borders(labels), colours, size), colours[labels])


@pytest.mark.parametrize("labels", [blobs(), confetti()], ids=["blobs", "confetti"])
@pytest.mark.parametrize("scale", [1.0, 1.7, 3.0, 0.5])
def test_neighbours_leave_no_gap(labels: Labels, scale: float) -> None:
    """If all regions have one colour, every pixel has exactly that colour, wherever the borders are."""
    colours = np.full((int(labels.max()) + 1, 3), (250, 130, 7), np.uint8)
    size = (round(SIZE[0] * scale), round(SIZE[1] * scale))
    picture = fill_regions(smooth_borders(find_borders(labels), 2.0, 2.0), colours, size)
    np.testing.assert_array_equal(picture, np.broadcast_to(colours[1], picture.shape))


def test_pixels_inside_a_region_have_exactly_its_colour() -> None:
    labels = disc(12)
    colours = np.array([(0, 0, 0), (10, 200, 90), (240, 17, 33)], np.uint8)
    picture = fill_regions(smooth_borders(find_borders(labels), 2.0, 2.0), colours, (120, 120))
    inside = np.asarray(cv2.erode((labels == 2).astype(np.uint8), np.ones((7, 7))), np.uint8)
    inside = np.asarray(cv2.resize(inside, (120, 120), interpolation=cv2.INTER_NEAREST), np.uint8)
    np.testing.assert_array_equal(picture[inside > 0], np.broadcast_to(colours[2], (int(inside.sum()), 3)))


def test_a_slanting_border_covers_its_area() -> None:
    """The fill of a half plane whose border is one straight line through lattice nodes, against exact coverage."""
    labels = np.ones((8, 8), np.int32)
    labels[:, 4:] = 2
    borders = find_borders(labels)
    inner = borders.lattice[:, 0] == 4
    borders.positions[inner, 0] = 2 + borders.positions[inner, 1] / 2  # from (2, 0) to (6, 8)
    picture = fill_regions(borders, np.array([[0] * 3, [0] * 3, [255] * 3], np.uint8), (8, 8))
    fine = (np.arange(64) + 0.5) / 64
    for y in range(8):
        edge = 2 + (y + fine) / 2
        for x in range(8):
            assert picture[y, x, 0] == pytest.approx(255 * np.clip(x + 1 - edge, 0, 1).mean(), abs=1.5)


@pytest.mark.parametrize("radius", [2.0, 3.5, 8.0])
def test_small_regions_keep_their_area(radius: float) -> None:
    labels = disc(radius)
    picture = fill_regions(
        smooth_borders(find_borders(labels), 1.5, 1.5), np.array([[0] * 3, [0] * 3, [255] * 3], np.uint8), (40, 40)
    )
    assert picture[..., 0].sum() / 255 == pytest.approx((labels == 2).sum(), rel=0.15)


def test_a_thin_region_is_kept() -> None:
    """A slanting line two pixels wide keeps three quarters of its area and is never interrupted."""
    labels = np.ones((30, 60), np.int32)
    x = np.arange(4, 56)
    labels[4 + x // 3, x] = labels[5 + x // 3, x] = 2
    borders = smooth_borders(find_borders(labels), 2.0, 1.5)
    picture = fill_regions(borders, np.array([[0] * 3, [0] * 3, [255] * 3], np.uint8), (60, 30))[..., 0] / 255
    assert picture.sum() > 0.75 * 2 * len(x)
    assert picture.sum(axis=0)[8:52].min() > 0.8


def test_edges_are_equally_sharp_at_every_size() -> None:
    """The part of pixels that are neither one colour nor the other falls with the scale: borders stay a pixel wide."""
    borders = smooth_borders(find_borders(disc(12)), 1.5, 1.5)
    colours = np.array([[0] * 3, [0] * 3, [255] * 3], np.uint8)
    mixed = []
    for scale in (1, 2, 4):
        picture = fill_regions(borders, colours, (40 * scale, 40 * scale))[..., 0]
        mixed.append(((picture > 0) & (picture < 255)).sum() / scale)
    assert max(mixed) < 1.3 * min(mixed)


def test_smoothing_removes_the_steps_of_a_slanting_border() -> None:
    y, x = np.mgrid[:40, :60]
    labels = np.where(y < 8 + 0.4 * x, 1, 2).astype(np.int32)
    borders = smooth_borders(find_borders(labels), 2.0, 2.0)
    inner = (borders.lattice[:, 0] > 8) & (borders.lattice[:, 0] < 52)
    inner &= (borders.lattice[:, 1] > 8) & (borders.lattice[:, 1] < 32)
    rough, smooth = (
        np.abs(p[inner, 1] - np.polyval(np.polyfit(p[inner, 0], p[inner, 1], 1), p[inner, 0])).max()
        for p in (borders.lattice.astype(float), borders.positions.astype(float))
    )
    assert smooth < 0.25 * rough


def test_borders_stay_within_the_frame_and_the_limit() -> None:
    borders = smooth_borders(find_borders(confetti()), 3.0, 1.25)
    assert np.abs(borders.positions - borders.lattice).max() <= 1.25 + 1e-5
    for axis, last in enumerate(SIZE):
        for side in (0, last):
            assert (borders.positions[borders.lattice[:, axis] == side, axis] == side).all()


def test_two_threads_give_the_same_bytes() -> None:
    labels = blobs()
    colours, borders = colours_for(labels), smooth_borders(find_borders(labels), 2.0, 2.0)
    alone = fill_regions(borders, colours, (131, 97))
    with ThreadPoolExecutor(1) as helper:
        np.testing.assert_array_equal(fill_regions(borders, colours, (131, 97), FrameExecutor(helper)), alone)


@pytest.mark.parametrize("sigma_px", [0.5, 2.0, 6.0])
def test_smoothing_has_the_variance_of_a_gaussian_in_few_steps(sigma_px: float) -> None:
    """A corner of 1 px in a long straight border spreads to a curve with the variance of the Gaussian."""
    steps = diffusion_steps(sigma_px)
    assert steps.sum() == pytest.approx(sigma_px**2, rel=1e-5) and len(steps) < 3 * sigma_px + 3
    spread = np.zeros(101)
    spread[50] = 1
    for step in steps:
        spread += step * ((np.roll(spread, 1) + np.roll(spread, -1)) / 2 - spread)
    assert spread.sum() == pytest.approx(1) and spread.min() > -0.01
    assert (spread * (np.arange(101) - 50) ** 2).sum() == pytest.approx(sigma_px**2, rel=1e-3)


@pytest.mark.parametrize(
    ("columns", "expected"), [((10, 13), 10.9), ((12, 15), 12.9), ((6, 9), 8.1), ((16, 18), 10.0), ((8, 12), 10.0)],
    ids=["beside", "near on the right", "near on the left", "too far", "over the border"],
)  # fmt: skip
def test_a_border_is_tucked_under_a_line_nearby(columns: tuple[int, int], expected: float) -> None:
    """A vertical border at x = 10: within 3 px of a line it is moved 0.9 px under the line's outline."""
    labels = np.repeat(np.array([[1, 2]], np.int32), 20, axis=0).repeat(10, axis=1)
    ink = np.zeros(labels.shape, np.uint8)
    ink[:, columns[0] : columns[1]] = 255
    borders = hide_borders_under_lines(find_borders(labels), labels, ink, 3)
    inside = (borders.lattice[:, 0] == 10) & (borders.lattice[:, 1] > 0) & (borders.lattice[:, 1] < 20)
    np.testing.assert_allclose(borders.positions[inside, 0], expected, atol=1e-5)


@pytest.mark.parametrize(("beyond", "expected"), [(2, 14.9), (3, 10.0)], ids=["a sliver", "a region of its own"])
@pytest.mark.parametrize("transposed", [False, True])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_region_that_continues_beyond_a_line_has_no_sliver_beside_it(
    beyond: int, expected: float, transposed: bool, mirrored: bool
) -> None:
    """A border at x = 10, a line from 14 to 17: further than 3 px, but what lies between is the region beyond it."""
    labels = np.repeat(np.array([[1, 2, beyond]], np.int32), [10, 7, 8], axis=1).repeat(20, axis=0)
    ink = np.zeros(labels.shape, np.uint8)
    ink[:, 14:17] = 255
    if mirrored:
        labels, ink, expected = labels[:, ::-1].copy(), ink[:, ::-1].copy(), 25 - expected
    if transposed:
        labels, ink = labels.T.copy(), ink.T.copy()
    borders = hide_borders_under_lines(find_borders(labels), labels, ink, 3)
    axis, at = int(transposed), 15 if mirrored else 10
    along = borders.lattice[:, 1 - axis]
    inside = (borders.lattice[:, axis] == at) & (along > 0) & (along < 20)
    np.testing.assert_allclose(borders.positions[inside, axis], expected, atol=1e-5)
