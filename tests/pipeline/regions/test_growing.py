"""Region growing, compared with a priority queue (zhang2011online, section 4.3)."""

from __future__ import annotations

import heapq
from itertools import count

import hypothesis.extra.numpy as hnp
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from pipeline.colour.lab8 import Lab8
from pipeline.frames import Labels
from pipeline.regions.growing import grow, unlabelled
from pipeline.regions.regions import AREA, Means, means_of, measure

Bytes = NDArray[np.uint8]
NEIGHBOURS = ((-1, 0), (0, -1), (0, 1), (1, 0))
shapes = st.tuples(st.integers(1, 9), st.integers(1, 9))


@st.composite
def pictures(draw: st.DrawFn, plain: bool) -> tuple[Labels, Lab8, Bytes, Bytes]:
    """Labels with holes, colours, edges and limits; `plain`: errors are whole numbers, so that a bucket is exact."""
    shape = draw(shapes)
    labels = draw(hnp.arrays(np.int32, shape, elements=st.sampled_from([0, 0, 0, 1, 2, 3])))
    colours = draw(hnp.arrays(np.uint8, (*shape, 3), elements=st.integers(100, 160)))
    if plain:
        colours[..., 0], colours[..., 2] = 90, 128
        colours[..., 1][labels > 0] = 110 + 12 * labels[labels > 0].astype(np.uint8)
    blocked = draw(hnp.arrays(np.uint8, shape, elements=st.sampled_from([0, 0, 0, 255])))
    limit = draw(hnp.arrays(np.uint8, shape, elements=st.sampled_from([4, 14, 24])))
    return labels, colours, blocked, limit


def error_at(lab: Lab8, y: int, x: int, mean: NDArray[np.float32]) -> float:
    """Reconstruction error, CIELAB units."""
    away = (lab[y, x].astype(float) - mean.astype(float)) * (100 / 255, 1, 1)
    return float(np.sqrt((away * away).sum()))


def in_words(labels: Labels, lab: Lab8, blocked: Bytes, limit: Bytes, means: Means) -> Labels:
    """Section 4.3, word by word, with `heapq`; of equal errors the one that was queued first."""
    out, order = labels.copy(), count()
    queue: list[tuple[float, int, int, int, int]] = []

    def put(y: int, x: int, label: int) -> None:
        error = error_at(lab, y, x, means[label])
        if not blocked[y, x] and error <= limit[y, x]:
            heapq.heappush(queue, (error, next(order), y, x, label))

    for y, x in zip(*np.nonzero(labels == 0), strict=True):
        for j, i in around(labels, y, x):
            if labels[j, i]:
                put(y, x, labels[j, i])
    while queue:
        _, _, y, x, label = heapq.heappop(queue)
        if out[y, x] == 0:
            out[y, x] = label
            for j, i in around(labels, y, x):
                if out[j, i] == 0:
                    put(j, i, label)
    return out


def around(labels: Labels, y: int, x: int) -> list[tuple[int, int]]:
    height, width = labels.shape
    return [(y + j, x + i) for j, i in NEIGHBOURS if 0 <= y + j < height and 0 <= x + i < width]


@settings(max_examples=80, deadline=None)
@given(pictures(plain=True))
def test_integer_errors_give_the_result_of_a_priority_queue(picture: tuple[Labels, Lab8, Bytes, Bytes]) -> None:
    labels, lab, blocked, limit = picture
    sums = measure(labels, lab, limit, 3)
    wanted = in_words(labels, lab, blocked, limit, means_of(sums))
    grow(labels, lab, blocked, limit, sums, unlabelled(labels))
    np.testing.assert_array_equal(labels, wanted)


@settings(max_examples=80, deadline=None)
@given(pictures(plain=False))
def test_growing_respects_its_limits_and_leaves_no_reachable_pixel(picture: tuple[Labels, Lab8, Bytes, Bytes]) -> None:
    labels, lab, blocked, limit = picture
    before = labels.copy()
    sums = measure(labels, lab, limit, 3)
    means = means_of(sums)
    left = grow(labels, lab, blocked, limit, sums, unlabelled(labels))

    np.testing.assert_array_equal(labels[before > 0], before[before > 0])
    for y, x in zip(*np.nonzero((before == 0) & (labels > 0)), strict=True):
        assert not blocked[y, x]
        assert error_at(lab, y, x, means[labels[y, x]]) <= limit[y, x] + 1e-4
        assert labels[y, x] in {labels[n] for n in around(labels, y, x)}
    for y, x in zip(*np.nonzero((labels == 0) & (blocked == 0)), strict=True):
        for n in around(labels, y, x):
            assert not labels[n] or error_at(lab, y, x, means[labels[n]]) > limit[y, x] - 1e-4
    np.testing.assert_array_equal(left, np.flatnonzero(labels == 0))
    np.testing.assert_array_equal(sums, measure(labels, lab, limit, 3))


@settings(max_examples=50, deadline=None)
@given(pictures(plain=False))
def test_ignoring_limits_leaves_no_unlabelled_pixel(picture: tuple[Labels, Lab8, Bytes, Bytes]) -> None:
    labels, lab, blocked, limit = picture
    if not labels.any():
        return
    before = labels.copy()
    sums = measure(labels, lab, limit, 3)
    left = grow(labels, lab, blocked, limit, sums, unlabelled(labels), float("inf"))
    assert left.size == 0 and labels.all()
    np.testing.assert_array_equal(labels[before > 0], before[before > 0])
    assert sums[0, AREA] == 0 and sums[:, AREA].sum() == labels.size


def test_the_more_similar_region_labels_a_pixel_from_either_side() -> None:
    a = np.array([100, 100, 108, 111, 118, 118], np.uint8)
    for row, wanted in ((a, [1, 1, 1, 2, 2, 2]), (a[::-1], [1, 1, 1, 2, 2, 2])):
        labels, sums = row_of([1, 1, 0, 0, 2, 2], row)
        grow(labels, colours_of(row), no(labels), full(labels, 24), sums, unlabelled(labels))
        np.testing.assert_array_equal(labels, [wanted])


@pytest.mark.parametrize(("difference", "grown"), [(14, True), (15, False)])
def test_the_limit_is_read_at_the_pixel(difference: int, grown: bool) -> None:
    row = np.array([100, 100 + difference], np.uint8)
    labels, sums = row_of([1, 0], row)
    limit = np.array([[255, 14]], np.uint8)
    grow(labels, colours_of(row), no(labels), limit, sums, unlabelled(labels))
    assert bool(labels[0, 1]) is grown


def test_an_edge_stops_growth_even_in_one_colour() -> None:
    row = np.full(6, 100, np.uint8)
    labels, sums = row_of([1, 0, 0, 0, 0, 0], row)
    edge = np.array([[0, 0, 0, 255, 0, 0]], np.uint8)
    left = grow(labels, colours_of(row), edge, full(labels, 24), sums, unlabelled(labels))
    np.testing.assert_array_equal(labels, [[1, 1, 1, 0, 0, 0]])
    np.testing.assert_array_equal(left, [3, 4, 5])


def test_the_colour_model_is_constant_during_growing() -> None:
    """A ramp is followed up to the limit from the mean at the start, not from pixel to pixel."""
    row = np.arange(100, 140, 2, dtype=np.uint8)
    labels, sums = row_of([1] + [0] * 19, row)
    grow(labels, colours_of(row), no(labels), full(labels, 24), sums, unlabelled(labels))
    assert (labels > 0).sum() == 13


def row_of(labels: list[int], a: Bytes) -> tuple[Labels, NDArray[np.int64]]:
    made = np.array([labels], np.int32)
    return made, measure(made, colours_of(a), full(made, 24), max(labels))


def colours_of(a: Bytes) -> Lab8:
    """One row of one lightness, whose a* varies."""
    lab = np.full((1, len(a), 3), 128, np.uint8)
    lab[0, :, 1] = a
    return lab


def no(labels: Labels) -> Bytes:
    return np.zeros(labels.shape, np.uint8)


def full(labels: Labels, value: int) -> Bytes:
    return np.full(labels.shape, value, np.uint8)
