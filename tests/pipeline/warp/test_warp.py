"""Homographies from noisy flow, relaxation of springs, and panoramas."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.warp.homography import IDENTITY, apply, deviation, dominant, fit, lattice, shift
from pipeline.warp.panorama import Placement, full_map, gather, mean
from pipeline.warp.springs import Sheet, distortion, relax

TRUE = np.array([[1.02, -0.03, 4.0], [0.02, 0.99, -2.0], [1e-4, -5e-5, 1.0]])


def scattered(n: int, seed: int = 0) -> np.ndarray:  # type: ignore[type-arg]
    return np.random.default_rng(seed).uniform(0, 200, (n, 2))


def test_a_homography_is_found_in_spite_of_outliers() -> None:
    points = scattered(800)
    target = apply(TRUE, points) + np.random.default_rng(1).normal(0, 0.1, points.shape)
    target[::5] += (12, -7)
    assert np.abs(apply(fit(points, target), points) - apply(TRUE, points)).max() < 0.15


def test_the_dominant_motion_may_have_less_than_half_of_the_points() -> None:
    points, draw = scattered(900), np.random.default_rng(2)
    target = apply(TRUE, points)
    target[:500] = points[:500] + draw.uniform(-30, 30, (500, 2))
    assert np.abs(apply(dominant(points, target), points[500:]) - target[500:]).max() < 0.2


@pytest.mark.parametrize("n", [0, 3, 8, 40])
def test_few_points_give_a_simple_motion(n: int) -> None:
    points = scattered(max(n, 1))[:n]
    found = fit(points, points + np.array([3.0, 1.0]))
    expected = IDENTITY if n < 4 else shift((3.0, 1.0))
    np.testing.assert_allclose(found, expected, atol=0.01)


def test_deviation_is_the_distance_from_the_plane_motion() -> None:
    here = lattice((12, 20))
    flow = (apply(TRUE, here) - here).astype(np.float32)
    flow[3, 4] += (3, 4)
    off = deviation(flow, TRUE)
    assert off[3, 4] == pytest.approx(5, abs=1e-3) and np.delete(off.ravel(), 3 * 20 + 4).max() < 1e-3


def crumpled(rest: float = 1.0, noise: float = 0.3) -> Sheet:
    targets = lattice((24, 30)) * np.float32(rest) + np.random.default_rng(3).normal(0, noise, (24, 30, 2))
    inside = np.ones((24, 30), np.bool_)
    inside[:4, :4] = False
    return Sheet(targets.astype(np.float32), inside, np.full((24, 30), 10, np.float32), rest)


@pytest.mark.parametrize("rest", [1.0, 1.4])
def test_springs_relax_and_the_reported_energies_are_correct(rest: float) -> None:
    sheet = crumpled(rest)
    found = relax([sheet])
    assert found.after < 0.9 * found.before and 1 <= found.iterations <= 10
    laid = found.moved(sheet.targets)
    for positions, energy in ((sheet.targets, found.before), (laid, found.after)):
        assert distortion(sheet, positions).sum() == pytest.approx(energy, rel=1e-3)


def test_the_energy_is_that_of_the_paper() -> None:
    """Two pixels 1.5 px apart, one of them 0.2 px off its flow: 10 * 0.04 + 0.5^2."""
    targets = np.array([[[0, 0], [1.3, 0]]], np.float32)
    laid = np.array([[[0, 0], [1.5, 0]]], np.float32)
    sheet = Sheet(targets, np.ones((1, 2), np.bool_), np.full((1, 2), 10, np.float32))
    assert distortion(sheet, laid).sum() == pytest.approx(10 * 0.04 + 0.25, rel=1e-4)


def test_an_undistorted_grid_is_unchanged() -> None:
    sheet = Sheet(lattice((9, 9)), np.ones((9, 9), np.bool_), np.full((9, 9), 10, np.float32))
    found = relax([sheet])
    assert found.before == pytest.approx(0, abs=1e-4)
    assert np.abs(found.moved(sheet.targets) - sheet.targets).max() < 1e-3


def test_frames_relax_together_on_one_grid() -> None:
    sheets = [
        crumpled(noise=0.3),
        Sheet(lattice((24, 30)), np.ones((24, 30), np.bool_), np.full((24, 30), 10, np.float32)),
    ]
    both = relax(sheets)
    assert both.after <= both.before == pytest.approx(sum(relax([sheet]).before for sheet in sheets), rel=1e-6)


def test_an_empty_sheet_has_no_energy() -> None:
    sheet = Sheet(lattice((5, 5)), np.zeros((5, 5), np.bool_), np.ones((5, 5), np.float32))
    assert relax([sheet]).before == 0


def test_a_panorama_reproduces_its_frames() -> None:
    """Two shifted halves of a picture make one, and each is found again where it lies."""
    draw = np.random.default_rng(4)
    scene = np.repeat(np.repeat(draw.integers(0, 256, (20, 30, 3), np.uint8), 4, axis=0), 4, axis=1)
    total = np.zeros((*scene.shape[:2], 4), np.float32)
    for left in (0, 40):
        view = np.ascontiguousarray(scene[:, left : left + 80])
        placement = Placement((0, 0, 40, 40), shift((left / 2, 0)), np.zeros((40, 40, 2), np.float16))
        rect, x, y = full_map(placement, (2.0, 2.0), (80, 80), (0, 0))
        assert rect == (0, 0, 80, 80)
        np.testing.assert_allclose(x[0], np.arange(80) + left, atol=1e-3)
        gather(total, view, np.ones(view.shape[:2], np.float32), x, y)
    picture, known = mean(total)
    assert known[1:-1, 1:-2].min() == 1
    assert np.abs(picture[2:-2, 2:-3].astype(int) - scene[2:-2, 2:-3]).max() <= 1


def test_holes_are_filled_from_their_surroundings() -> None:
    total = np.zeros((40, 50, 4), np.float32)
    total[:, :10] = (200, 100, 50, 1)
    picture, known = mean(total)
    assert known[:, 10:].max() == 0
    assert np.abs(picture.astype(int) - (200, 100, 50)).max() <= 2


def test_a_placement_extends_beyond_its_rectangle() -> None:
    placement = Placement((2, 3, 12, 10), shift((1.0, 0.0)), np.full((7, 10, 2), 0.5, np.float16))
    np.testing.assert_allclose(placement.positions()[0, 0], (3.5, 3.5))
    far = placement.at(np.array([[[40.0, 2.0]]], np.float32))
    np.testing.assert_allclose(far[0, 0], (41.5, 2.5))


def test_points_in_a_corner_give_no_perspective_that_folds_the_rest() -> None:
    """The scale grows across a corner of 40 px; continued as perspective, it turns the frame over at its other end."""
    points = np.random.default_rng(0).uniform(0, 40, (400, 2))
    target = points + 1 + 0.012 * points * points[:, :1]
    right = np.array([[640.0, 0.0], [640.0, 360.0]])
    assert apply(fit(points, target), right)[:, 0].max() < 0
    bounded = apply(fit(points, target, over=(0, 0, 640, 360)), right)
    assert np.abs(bounded - right).max() < 640
