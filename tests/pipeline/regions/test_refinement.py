"""Boundary correction, misfits, merging, and boundary smoothing."""

from __future__ import annotations

from collections import Counter

import hypothesis.extra.numpy as hnp
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from pipeline.colour.lab8 import Lab8
from pipeline.frames import Labels
from pipeline.regions.growing import unlabelled
from pipeline.regions.refinement import add_regions, correct, merge_table, round_boundaries
from pipeline.regions.regions import AREA, LIMIT, NOT_PROPAGATED, Sums, means_of, measure, relabel

Bytes = NDArray[np.uint8]
MARGIN, SLACK = 7.0, 1.1
shapes = st.tuples(st.integers(1, 8), st.integers(1, 8))


def colours_of(a: list[list[int]]) -> Lab8:
    """A picture of one lightness, whose a* varies: differences of a* are CIELAB units."""
    values = np.array(a, np.uint8)
    lab = np.full((*values.shape, 3), 128, np.uint8)
    lab[..., 1] = values
    return lab


def everywhere(value: int, shape: tuple[int, ...]) -> Bytes:
    return np.full(shape, value, np.uint8)


# -- sums


@settings(max_examples=60, deadline=None)
@given(hnp.arrays(np.int32, shapes, elements=st.integers(0, 4)), st.integers(0, 99))
def test_measure_is_the_sum_over_each_region(labels: Labels, seed: int) -> None:
    rng = np.random.default_rng(seed)
    lab = rng.integers(0, 256, (*labels.shape, 3)).astype(np.uint8)
    limit = rng.integers(0, 30, labels.shape).astype(np.uint8)
    sums = measure(labels, lab, limit, 4)
    for label in range(5):
        here = labels == label
        np.testing.assert_array_equal(sums[label, :3], lab[here].sum(0, dtype=int))
        assert sums[label, AREA] == here.sum() and sums[label, LIMIT] == limit[here].sum()
        if here.any():
            np.testing.assert_allclose(means_of(sums)[label], lab[here].mean(0), rtol=1e-6)


def test_relabelling_counts_the_pixels_that_keep_their_region() -> None:
    labels, propagated = np.array([[1, 1, 2, 3, 3]], np.int32), np.array([[1, 2, 2, 0, 1]], np.int32)
    names, kept = np.array([0, 2, 1, 1], np.int32), np.array([0, 2, 1], np.int32)
    np.testing.assert_array_equal(relabel(labels, names, propagated, kept, 2), [0, 1, 1])
    np.testing.assert_array_equal(labels, [[2, 2, 1, 1, 1]])
    assert not relabel(labels, np.arange(3, dtype=np.int32), NOT_PROPAGATED, kept, 2).any()


# -- correction


def test_a_boundary_that_lags_by_a_pixel_is_corrected() -> None:
    labels = np.array([[1, 1, 1, 1, 2, 2]], np.int32)
    lab = colours_of([[100, 100, 100, 140, 140, 140]])
    np.testing.assert_array_equal(corrected(labels, lab)[0], [[1, 1, 1, 2, 2, 2]])


@pytest.mark.parametrize(("between", "moves"), [(116, False), (122, False), (128, True)])
def test_the_margin_keeps_noise_from_moving_boundaries(between: int, moves: bool) -> None:
    """Between a* = 100 and 140, a pixel leaves region 1 once region 2 fits better by more than the margin."""
    labels = np.array([[1] * 40 + [1] + [2] * 40], np.int32)
    lab = colours_of([[100] * 40 + [between] + [140] * 40])
    assert int(corrected(labels, lab, limit=60)[0][0, 40]) == (2 if moves else 1)


def test_a_misfit_inside_a_region_becomes_unlabelled() -> None:
    labels = np.full((7, 7), 1, np.int32)
    values = np.full((7, 7), 100)
    values[3, 3], values[5, 5] = 150, 120
    found, sums = corrected(labels, colours_of(values.tolist()), limit=24)
    assert found[3, 3] == 0 and (found == 0).sum() == 1
    assert sums[0, AREA] == 1 and sums[1, AREA] == 48


def test_correction_uses_the_labels_before_correction() -> None:
    """No wave: a pixel takes a neighbour's old label, so that one step moves a boundary by one pixel."""
    labels = np.array([[1] * 12 + [2] * 20], np.int32)
    lab = colours_of([[100] * 8 + [140] * 24])
    np.testing.assert_array_equal(corrected(labels, lab, limit=60)[0], [[1] * 11 + [2] * 21])


@settings(max_examples=60, deadline=None)
@given(hnp.arrays(np.int32, shapes, elements=st.integers(0, 3)), st.integers(0, 99))
def test_correction_updates_sums_and_labels_no_unlabelled_pixel(labels: Labels, seed: int) -> None:
    lab = np.random.default_rng(seed).integers(90, 170, (*labels.shape, 3)).astype(np.uint8)
    before = labels.copy()
    found, sums = corrected(labels, lab)
    np.testing.assert_array_equal(labels, before)
    np.testing.assert_array_equal(sums, measure(found, lab, everywhere(14, labels.shape), 3))
    assert not found[before == 0].any()


def corrected(labels: Labels, lab: Lab8, limit: int = 14) -> tuple[Labels, Sums]:
    limits = everywhere(limit, labels.shape)
    sums = measure(labels, lab, limits, 3)
    return correct(labels, lab, limits, sums, MARGIN, SLACK), sums


# -- adoption


def test_only_new_regions_release_misfits() -> None:
    lab = colours_of([[100, 100, 100, 100, 150, 200, 200, 200, 200, 250]])
    labels = np.zeros((1, 10), np.int32)
    labels[0, 5:] = 1
    limits = everywhere(20, labels.shape)
    sums = np.concatenate([measure(labels, lab, limits, 1), np.zeros((1, 5), np.int64)])
    pixels = unlabelled(labels)
    labels[0, :5] = 2
    assert add_regions(labels, lab, limits, sums, pixels, 2, 1.0) == 1
    np.testing.assert_array_equal(labels, [[2, 2, 2, 2, 0, 1, 1, 1, 1, 1]])
    np.testing.assert_array_equal(sums, measure(labels, lab, limits, 2))


# -- merging


def merged(
    labels: Labels, a_of: list[int], smallest: int, thinnest: float, similar: float, distinct: float = 1000.0
) -> Labels:  # fmt: skip
    """Labels after merging; `a_of` is the a* of regions 1, 2, ..."""
    count = len(a_of)
    lab = colours_of(np.array([128, *a_of])[labels].tolist())
    sums = measure(labels, lab, everywhere(20, labels.shape), count)
    small = np.full(count + 1, smallest, np.int32)
    limits = np.float32(similar), np.float32(distinct)
    table = merge_table(labels, means_of(sums), sums[:, AREA].copy(), small, thinnest, 1, *limits)
    return table[labels]


def test_a_small_region_is_merged_into_its_most_similar_neighbour() -> None:
    labels = np.array([[1, 1, 1, 1, 2, 3, 3, 3, 3]], np.int32)
    np.testing.assert_array_equal(merged(labels, [100, 140, 150], 2, 0, 0), [[1, 1, 1, 1, 3, 3, 3, 3, 3]])
    np.testing.assert_array_equal(merged(labels, [135, 140, 150], 2, 0, 0), [[1, 1, 1, 1, 1, 3, 3, 3, 3]])
    np.testing.assert_array_equal(merged(labels, [100, 140, 150], 1, 0, 0), labels)


def test_a_distinct_region_may_be_smaller_in_inverse_proportion_to_its_contrast() -> None:
    """The limit is 40 px up to a difference of 12 units, and 8 px from one of 60 on."""
    for area, difference, kept in ((10, 60, True), (10, 40, False), (13, 40, True), (7, 100, False), (39, 12, False)):
        labels = np.ones((1, 200), np.int32)
        labels[0, 60 : 60 + area] = 2
        labels[0, 60 + area :] = 3
        out = merged(labels, [100, 100 + difference, 100], 40, 0, 0, distinct=12)
        np.testing.assert_array_equal(out == 2, (labels == 2) & kept, err_msg=f"{area} px, {difference} units")


def test_a_region_is_merged_into_a_similar_neighbour() -> None:
    labels = np.array([[1, 1, 1, 1, 2, 2]], np.int32)
    np.testing.assert_array_equal(merged(labels, [100, 104], 0, 0, 5.0), [[1] * 6])
    np.testing.assert_array_equal(merged(labels, [100, 106], 0, 0, 5.0), labels)


@pytest.mark.parametrize(("between", "width_px", "kept"), [(130, 1, False), (130, 3, True), (180, 1, True)])
def test_a_narrow_region_is_merged_if_its_colour_is_a_mixture(between: int, width_px: int, kept: bool) -> None:
    """A sliver along a blurred edge; a line between two areas has a colour of its own."""
    labels = np.ones((20, 30), np.int32)
    labels[:, 12:] = 2
    labels[:, 12 + width_px :] = 3
    out = merged(labels, [100, between, 150], 0, 2, 5.0)
    assert (2 in out) is kept


@settings(max_examples=100, deadline=None)
@given(
    hnp.arrays(np.int32, shapes, elements=st.integers(1, 6)),
    st.integers(0, 6), st.sampled_from([0.0, 5.0, 100.0]), st.integers(0, 99),
)  # fmt: skip
def test_merging_is_limited_to_neighbours_and_acyclic(labels: Labels, smallest: int, similar: float, seed: int) -> None:
    labels = whole(labels)
    a_of = np.random.default_rng(seed).integers(100, 150, int(labels.max())).tolist()
    out = merged(labels, a_of, smallest, 0, similar)
    areas = Counter(labels.ravel().tolist())
    for before, after in {(int(b), int(a)) for b, a in zip(labels.ravel(), out.ravel(), strict=True)}:
        assert (out[labels == after] == after).all()  # who takes others in stays
        if before != after:
            assert similar > 0 or areas[before] < smallest
            assert areas[after] >= areas[before]
    assert len(set(out.ravel().tolist())) == int(whole(out).max())  # in one piece


def whole(labels: Labels) -> Labels:
    """4-connected components, numbered from 1 in raster order."""
    out = np.zeros_like(labels)
    for y, x in np.ndindex(*labels.shape):
        if out[y, x] == 0:
            number, stack = int(out.max()) + 1, [(y, x)]
            while stack:
                j, i = stack.pop()
                if (
                    0 <= j < labels.shape[0]
                    and 0 <= i < labels.shape[1]
                    and not out[j, i]
                    and labels[j, i] == labels[y, x]
                ):
                    out[j, i] = number
                    stack += [(j + 1, i), (j - 1, i), (j, i + 1), (j, i - 1)]
    return out


# -- boundaries


@settings(max_examples=40, deadline=None)
@given(
    hnp.arrays(np.int32, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.integers(1, 4)),
    st.sampled_from([1.0, 1.5, 2.0, 2.6, 3.0, 4.4]),
)
def test_rounding_is_the_majority_of_the_disc(labels: Labels, radius: float) -> None:
    out = round_boundaries(labels, radius)
    padded = np.pad(labels, int(radius), mode="edge")
    reach = range(-int(radius), int(radius) + 1)
    stride = 1 if radius < 3 else 2
    disc = [(j, i) for j in reach for i in reach if j * j + i * i <= radius * radius and not (j % stride or i % stride)]
    for y, x in np.ndindex(*labels.shape):
        votes = Counter(int(padded[y + j + int(radius), x + i + int(radius)]) for j, i in disc)
        best, own = max(votes.values()), votes[int(labels[y, x])]
        assert votes[int(out[y, x])] == best
        if own == best:
            assert out[y, x] == labels[y, x]


@pytest.mark.parametrize("radius", [1.5, 2.0, 3.0, 5.3])
def test_rounding_keeps_straight_lines_and_removes_spikes(radius: float) -> None:
    labels = np.where(np.arange(40) < 20, 1, 2).astype(np.int32).reshape(1, -1).repeat(40, axis=0)
    np.testing.assert_array_equal(round_boundaries(labels, radius), labels)
    spiky = labels.copy()
    spiky[20, 20:26] = 1
    out = round_boundaries(spiky, radius)
    np.testing.assert_array_equal(out[:, 22:], labels[:, 22:])
    assert set(np.unique(out)) == {1, 2}


def test_rounding_shortens_a_staircase_boundary() -> None:
    y, x = np.mgrid[:48, :48]
    steps = np.where(x // 6 + y // 6 < 8, 1, 2).astype(np.int32)
    out = round_boundaries(steps, 5)
    ideal = np.where(x + y < 50, 1, 2)
    inner = np.s_[6:-6, 6:-6]
    assert (out != ideal)[inner].sum() < 0.6 * (steps != ideal)[inner].sum()
