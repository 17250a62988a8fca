"""Borders through shading become calm curves; borders on edges stay."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.vector.borders import Borders, find_borders
from pipeline.vector.simplify import simplify_borders

SIZE = (160, 120)
SIGMA_PX, LIMIT_PX, REACH_PX = 12.0, 8.0, 3


def _ragged() -> Labels:
    """Two regions whose border is column 80, displaced by up to 5 px in rows that are drawn at random."""
    steps = np.random.default_rng(4).integers(-5, 6, SIZE[1])
    columns = np.arange(SIZE[0])[None, :]
    return np.where(columns < 80 + steps[:, None], 1, 2).astype(np.int32)


def _shading() -> NDArray[np.uint8]:
    """A gradient of 60 levels over the frame's width."""
    lab = np.full((*SIZE[::-1], 3), 128, np.uint8)
    lab[..., 0] = np.linspace(100, 160, SIZE[0])
    return lab


def _simplified(borders: Borders, lab: NDArray[np.uint8]) -> Borders:
    return simplify_borders(borders, lab, REACH_PX, SIGMA_PX, LIMIT_PX)


def _length_px(borders: Borders) -> float:
    """Length of the border between the two regions."""
    inner = borders.edges[(borders.edges["left"] > 0) & (borders.edges["right"] > 0)]
    steps = borders.positions[inner["start"]] - borders.positions[inner["end"]]
    return float(np.hypot(*steps.T).sum())


def test_a_ragged_border_through_shading_becomes_a_calm_curve() -> None:
    ragged = find_borders(_ragged())
    calm = _simplified(ragged, _shading())
    assert _length_px(ragged) > 4 * SIZE[1]
    assert _length_px(calm) < 1.2 * SIZE[1]
    assert np.abs(calm.positions - ragged.positions).max() <= LIMIT_PX


def test_a_border_on_an_edge_stays() -> None:
    labels = _ragged()
    lab = _shading()
    lab[..., 0] = np.where(labels == 1, 80, 140)
    ragged = find_borders(labels)
    np.testing.assert_array_equal(_simplified(ragged, lab).positions, ragged.positions)


def test_an_edge_holds_the_end_of_a_border_through_shading() -> None:
    labels = _ragged()
    lab = _shading()
    lab[:60, :, 0] = np.where(labels[:60] == 1, 80, 140)
    ragged = find_borders(labels)
    moved = np.abs(_simplified(ragged, lab).positions - ragged.positions).max(axis=1)
    rows = ragged.lattice[:, 1]
    assert moved[rows < 45].max() == 0
    assert moved[(rows > 75) & (rows < 115)].max() > 2


def test_nodes_on_the_frame_stay() -> None:
    ragged = find_borders(_ragged())
    calm = _simplified(ragged, _shading())
    on_frame = (ragged.lattice == 0).any(axis=1) | (ragged.lattice == SIZE).any(axis=1)
    np.testing.assert_array_equal(calm.positions[on_frame], ragged.positions[on_frame])


@pytest.mark.parametrize("sigma_px", [2.0, 12.0, 40.0])
def test_wide_smoothing_stays_finite_and_within_its_limit(sigma_px: float) -> None:
    """Steps in ascending order would let rounding errors grow to thousands of pixels."""
    ragged = find_borders(_ragged())
    free = simplify_borders(ragged, _shading(), REACH_PX, sigma_px, 1000.0)
    assert np.abs(free.positions[:, 0] - 80).max() < 80.5
    inner = (ragged.lattice > 0).all(axis=1) & (ragged.lattice < SIZE).all(axis=1)
    assert np.abs(free.positions[inner, 0] - 80).max() <= 6
