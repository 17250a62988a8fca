"""Thin regions of intermediate colour are divided between their neighbours; other thin regions are kept."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.regions.ramps import divide_ramps

DARK, LIGHT, RED = (40, 128, 128), (220, 128, 128), (130, 200, 160)


def means_of(*colours: tuple[int, int, int]) -> NDArray[np.float32]:
    return np.array([(0, 0, 0), *colours], np.float32)


def stripes(*widths: int, height: int = 40) -> Labels:
    """Vertical stripes of these widths, labelled from 1."""
    row = np.repeat(np.arange(1, len(widths) + 1), widths)
    return np.tile(row, (height, 1)).astype(np.int32)


@pytest.mark.parametrize(("share", "border"), [(0.5, 12), (0.25, 13), (0.75, 11)])
@pytest.mark.parametrize("transposed", [False, True])
def test_a_mixture_is_divided_in_proportion(share: float, border: int, transposed: bool) -> None:
    """Columns 10 to 13 have `share` of the light colour: that share of them becomes light."""
    mixture = tuple(np.array(DARK) + share * (np.array(LIGHT) - DARK))
    labels = stripes(10, 4, 16)
    out = divide_ramps(labels.T.copy() if transposed else labels, means_of(DARK, mixture, LIGHT), 5)
    expected = np.where(np.arange(30) < border, 1, 3)
    np.testing.assert_array_equal(out.T if transposed else out, np.tile(expected, (40, 1)))


def test_an_edge_of_two_mixtures_becomes_one_border() -> None:
    means = means_of(DARK, (100, 128, 128), (160, 128, 128), LIGHT)
    assert set(np.unique(divide_ramps(stripes(10, 3, 3, 14), means, 5))) == {1, 4}


def test_a_wide_edge_of_many_mixtures_is_divided_as_a_whole_or_not_at_all() -> None:
    """If only some of its stripes were divided, an edge whose width varies from row to row would be ragged."""
    three = means_of(DARK, (80, 128, 128), (130, 128, 128), (180, 128, 128), LIGHT)
    assert set(np.unique(divide_ramps(stripes(10, 3, 3, 3, 14), three, 3))) == {1, 5}
    four = means_of(DARK, (70, 128, 128), (110, 128, 128), (150, 128, 128), (190, 128, 128), LIGHT)
    wide = stripes(10, 3, 3, 3, 3, 14)
    np.testing.assert_array_equal(divide_ramps(wide, four, 3), wide)


@pytest.mark.parametrize(("most", "others", "divided"), [(3, 5, True), (5, 3, False)])
@pytest.mark.parametrize("transposed", [False, True])
def test_the_majority_of_the_rows_along_an_edge_decides(
    most: int, others: int, divided: bool, transposed: bool
) -> None:
    """Single rows of another extent are no teeth: 5 px are too wide for a limit of 3, unless most rows have less."""
    rows = [stripes(10, others if y % 4 == 1 else most, 20, height=1)[0, :30] for y in range(60)]
    labels = np.ascontiguousarray(np.array(rows).T if transposed else rows)
    out = divide_ramps(labels, means_of(DARK, (130, 128, 128), LIGHT), 3)
    kept = (out == 2).any(axis=0 if transposed else 1)
    assert set(kept) == {not divided}


@pytest.mark.parametrize(
    "means",
    [means_of(LIGHT, DARK, LIGHT), means_of(DARK, RED, LIGHT), means_of(LIGHT, DARK, (180, 128, 128))],
    ids=["a wire", "a lip", "a dark line along an edge"],
)
def test_a_thin_region_of_its_own_colour_is_kept(means: NDArray[np.float32]) -> None:
    labels = stripes(10, 3, 17)
    np.testing.assert_array_equal(divide_ramps(labels, means, 5), labels)


def test_a_wide_region_of_intermediate_colour_is_kept() -> None:
    labels, means = stripes(10, 6, 14), means_of(DARK, (130, 128, 128), LIGHT)
    np.testing.assert_array_equal(divide_ramps(labels, means, 5), labels)
    assert set(np.unique(divide_ramps(labels, means, 6))) == {1, 3}


def test_a_slanting_edge_stays_straight() -> None:
    """The shorter of a pixel's row and column decides, so a ramp of any direction is divided along its middle."""
    y, x = np.mgrid[:60, :60]
    distance = (x * 2 + y - 90) / np.sqrt(5)
    labels = (1 + (distance > -2) + (distance > 2)).astype(np.int32)
    out = divide_ramps(labels, means_of(DARK, (130, 128, 128), LIGHT), 5)
    inner = np.zeros_like(out, np.bool_)
    inner[6:-6, 6:-6] = True
    assert set(np.unique(out[inner])) == {1, 3}
    assert ((out == 3) == (distance > 0))[inner & (np.abs(distance) > 1)].all()


def test_a_row_that_is_no_mixture_leaves_no_tick() -> None:
    """One row of a ramp belongs to a region of another colour: it is divided as the rows above and below."""
    labels = stripes(10, 4, 16)
    labels[9, 10:14] = 4
    out = divide_ramps(labels, means_of(DARK, (130, 128, 128), LIGHT, RED), 5)
    assert set(np.unique(out)) == {1, 3}
    np.testing.assert_array_equal(out[9], out[8])


@pytest.mark.parametrize("transposed", [False, True])
def test_a_short_piece_of_an_edge_is_not_divided(transposed: bool) -> None:
    """Rows 5 to 26 have a mixture of the colours beside it, the others another colour: 22 rows make a border, 21 a
    tooth."""
    means = means_of(DARK, (130, 128, 128), LIGHT, RED)
    for rows, wanted in ((22, {1, 3}), (21, {1, 2, 3})):
        labels = stripes(10, 4, 16)
        labels[:5, 10:14] = labels[5 + rows :, 10:14] = 4
        out = divide_ramps(labels.T.copy() if transposed else labels, means, 5)
        assert set(np.unique((out.T if transposed else out)[5 : 5 + rows])) == wanted
