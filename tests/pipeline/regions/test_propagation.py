"""Propagation and morphological filter, compared with plain Python (zhang2011online, section 4.2)."""

from __future__ import annotations

from collections import Counter, defaultdict

import hypothesis.extra.numpy as hnp
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from pipeline.frames import Flow, Labels
from pipeline.perception.motion import FAR
from pipeline.regions.propagation import REMAINDER_UNIT, propagate, smooth_labels

SHAPE = (5, 7)
label_maps = hnp.arrays(np.int32, SHAPE, elements=st.integers(1, 4))
# Multiples of 1/64 px: sums with propagated remainders are exact in float32.
flows = hnp.arrays(np.int64, (*SHAPE, 2), elements=st.integers(-130, 130)).map(lambda a: (a / 64).astype(np.float32))
remainders = hnp.arrays(np.int8, (*SHAPE, 2), elements=st.integers(-32, 32))
residuals = hnp.arrays(np.uint8, SHAPE, elements=st.sampled_from([0, 47, 48, 49, 254, FAR]))


def in_words(
    labels: Labels, flow: Flow, remainder: NDArray[np.int8], residual: NDArray[np.uint8], error_limit: float, decay: int
) -> tuple[Labels, NDArray[np.int8]]:
    """Section 4.2, word by word: who arrives where, and when a target keeps its label 0."""
    arrivals: dict[tuple[int, int], list[tuple[int, list[float]]]] = defaultdict(list)
    for y, x in np.ndindex(*labels.shape):
        moves = bool(flow[y, x].any())
        way = flow[y, x].astype(float) + (remainder[y, x] / REMAINDER_UNIT * decay if moves else 0)
        whole = np.floor(way + 0.5)
        target = (y + int(whole[1]), x + int(whole[0]))
        left_over = (way - whole) * REMAINDER_UNIT if moves else np.zeros(2)
        arrivals[target].append((int(labels[y, x]), [int(v) for v in left_over]))
    out, propagated = np.zeros_like(labels), np.zeros_like(remainder)
    for y, x in np.ndindex(*labels.shape):
        here = arrivals.get((y, x), [])
        if here and residual[y, x] / 4 <= error_limit and residual[y, x] != FAR:
            propagated[y, x] = here[0][1]
            if len({label for label, _ in here}) == 1:
                out[y, x] = here[0][0]
    return out, propagated


@settings(max_examples=150, deadline=None)
@given(label_maps, flows, remainders, residuals, st.sampled_from([0, 1]))
def test_propagation_equals_a_plain_implementation_of_the_paper(
    labels: Labels, flow: Flow, remainder: NDArray[np.int8], residual: NDArray[np.uint8], decay: int
) -> None:
    found, propagated = propagate(labels, flow, remainder, residual, 12.0, float(decay))
    wanted, expected_remainder = in_words(labels, flow, remainder, residual, 12.0, decay)
    np.testing.assert_array_equal(found, wanted)
    np.testing.assert_array_equal(propagated[found > 0], expected_remainder[found > 0])


@pytest.mark.parametrize("limit", [5.0, 12.0, 20.0])
def test_a_target_whose_flow_error_exceeds_t_f_stays_unlabelled(limit: float) -> None:
    residual = np.array([[0, limit * 4, limit * 4 + 1, 254, FAR]], np.uint8)
    found = one_row(np.full((1, 5), 9), np.zeros(2), residual=residual, limit=limit)
    np.testing.assert_array_equal(found, [[9, 9, 0, 0, 0]])


def test_a_pixel_without_counterpart_is_unlabelled_at_any_limit() -> None:
    assert not one_row(np.full((1, 3), 9), np.zeros(2), residual=np.full((1, 3), FAR, np.uint8), limit=1000).any()


def test_a_target_with_two_labels_is_unlabelled_in_any_order() -> None:
    flow = np.zeros((1, 4, 2), np.float32)
    flow[0, :, 0] = [2, 1, 0, -1]
    found = propagate(np.array([[1, 2, 1, 1]], np.int32), flow, zeros(flow), np.zeros((1, 4), np.uint8), 12)[0]
    np.testing.assert_array_equal(found, [[0, 0, 0, 0]])


def test_two_sources_with_one_label_give_that_label() -> None:
    flow = np.zeros((1, 3, 2), np.float32)
    flow[0, :, 0] = [1, 0, -1]
    found = propagate(np.full((1, 3), 5, np.int32), flow, zeros(flow), np.zeros((1, 3), np.uint8), 12)[0]
    np.testing.assert_array_equal(found, [[0, 5, 0]])


def test_labels_that_leave_the_picture_vanish() -> None:
    np.testing.assert_array_equal(one_row(np.array([[1, 2, 3]]), np.array([1.6, 0.0])), [[0, 0, 1]])
    assert not one_row(np.array([[1, 2, 3]]), np.array([0.0, -0.6])).any()


@pytest.mark.parametrize(("speed", "moved_px"), [(0.4, 4), (-0.4, -4), (0.3, 3), (1.3, 13)])
def test_rounding_errors_accumulate_over_frames(speed: float, moved_px: int) -> None:
    """A pan of 0.4 px a frame, which rounding alone never moves, goes 4 px in 10 frames."""
    labels = np.where(np.arange(48) < 24, 1, 2).astype(np.int32).reshape(1, -1).repeat(3, axis=0)
    assert boundary(pan(labels, speed, 10, decay=1.0)) - boundary(labels) == moved_px
    assert abs(boundary(pan(labels, speed, 10)) - boundary(labels) - moved_px) <= 1


def test_without_remainders_labels_do_not_follow_a_slow_pan() -> None:
    labels = np.where(np.arange(48) < 24, 1, 2).astype(np.int32).reshape(1, -1)
    assert boundary(pan(labels, 0.4, 10, decay=0.0)) == boundary(labels)


def test_flow_noise_does_not_accumulate_to_a_step() -> None:
    labels = np.where(np.arange(48) < 24, 1, 2).astype(np.int32).reshape(1, -1)
    rng = np.random.default_rng(3)
    remainder = np.zeros((1, 48, 2), np.int8)
    for _ in range(60):
        flow = np.full((1, 48, 2), rng.uniform(-0.12, 0.12), np.float32)
        labels, remainder = propagate(labels, flow, remainder, np.zeros((1, 48), np.uint8), 12)
        assert boundary(labels) == 24


@settings(max_examples=150, deadline=None)
@given(hnp.arrays(np.int32, st.tuples(st.integers(3, 7), st.integers(3, 7)), elements=st.integers(0, 3)))
def test_the_filter_needs_five_of_eight_neighbours(labels: Labels) -> None:
    wanted = labels.copy()
    for y, x in np.ndindex(labels.shape[0] - 2, labels.shape[1] - 2):
        around = labels[y : y + 3, x : x + 3].ravel().tolist()
        own = around.pop(4)
        leader, votes = Counter(around).most_common(1)[0]
        if votes >= 5 and leader != own:
            wanted[y + 1, x + 1] = leader if own == 0 else 0
    before = labels.copy()
    np.testing.assert_array_equal(smooth_labels(labels), wanted)
    np.testing.assert_array_equal(labels, before)


@pytest.mark.parametrize(
    ("agreeing", "own", "after"), [(5, 0, 7), (4, 0, 0), (5, 3, 0), (4, 3, 3), (8, 0, 7), (8, 7, 7)]
)
def test_the_filter_on_a_known_pattern(agreeing: int, own: int, after: int) -> None:
    around = [7] * agreeing + [1, 2, 3, 4][: 8 - agreeing]
    labels = np.array([*around[:4], own, *around[4:]], np.int32).reshape(3, 3)
    assert smooth_labels(labels)[1, 1] == after


def zeros(flow: Flow) -> NDArray[np.int8]:
    return np.zeros(flow.shape, np.int8)


def one_row(
    labels: NDArray[np.int_],
    way: NDArray[np.float64],
    residual: NDArray[np.uint8] | None = None,
    limit: float = 12,
) -> Labels:
    flow = np.broadcast_to(way.astype(np.float32), (*labels.shape, 2)).copy()
    there = np.zeros(labels.shape, np.uint8) if residual is None else residual
    return propagate(labels.astype(np.int32), flow, zeros(flow), there, limit)[0]


def pan(labels: Labels, speed: float, frames: int, decay: float = 0.9) -> Labels:
    """`labels` propagated along a steady pan; what comes in at the sides takes its neighbour's label."""
    flow = np.zeros((*labels.shape, 2), np.float32)
    flow[..., 0] = speed
    remainder = zeros(flow)
    for _ in range(frames):
        labels, remainder = propagate(labels, flow, remainder, np.zeros(labels.shape, np.uint8), 12, decay)
    return labels


def boundary(labels: Labels) -> int:
    """The first column of region 2."""
    return int(np.flatnonzero(labels[0] == 2)[0])
