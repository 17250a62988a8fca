"""Trapped-ball filling: gaps that a ball can pass, and the order of radii."""

from __future__ import annotations

import hypothesis.extra.numpy as hnp
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.regions.growing import unlabelled
from pipeline.regions.trapped_ball import fill, radii


@pytest.mark.parametrize(
    ("unlabelled_px", "wanted"),
    [(0, [2, 1]), (3000, [2, 1]), (90_000, [10, 5, 2, 1]), (352 * 288, [11, 5, 2, 1]), (921_600, [32, 16, 8, 4, 2, 1])],
)
def test_radii_start_at_the_value_of_the_paper_and_are_halved_to_one(unlabelled_px: int, wanted: list[int]) -> None:
    assert radii(unlabelled_px) == wanted


def two_rooms(gap_px: int, size: int = 41) -> NDArray[np.uint8]:
    """A wall one pixel thick from top to bottom, with a gap."""
    blocked = np.zeros((size, size), np.uint8)
    blocked[:, size // 2] = 255
    top = (size - gap_px) // 2
    blocked[top : top + gap_px, size // 2] = 0
    return blocked


@pytest.mark.parametrize("radius_px", [1, 2, 3, 4, 5, 8])
def test_the_ball_does_not_pass_a_narrower_gap(radius_px: int) -> None:
    labels, made = filled(two_rooms(2 * radius_px), radius_px)
    assert made == 2
    assert labels[20, 2] != labels[20, -3] and labels[20, 2] > 0 < labels[20, -3]


@pytest.mark.parametrize("radius_px", [1, 2, 3, 4, 5, 8])
def test_the_ball_passes_a_gap_of_its_width(radius_px: int) -> None:
    labels, made = filled(two_rooms(2 * radius_px + 1), radius_px)
    assert made == 1
    assert labels[20, 2] == labels[20, -3] == 1


def test_flood_fill_passes_the_gap() -> None:
    """A ball of radius 2 cannot pass the gap; a ball of radius 1 can."""
    assert filled(two_rooms(4), 2)[1] == 2
    assert filled(two_rooms(4), 1)[1] == 1


@pytest.mark.parametrize("radius_px", [1, 2, 5])
def test_an_area_narrower_than_the_ball_stays_unlabelled(radius_px: int) -> None:
    for side, made in ((2 * radius_px, 0), (2 * radius_px + 1, 1)):
        blocked = np.full((30, 30), 255, np.uint8)
        blocked[4 : 4 + side, 6 : 6 + side] = 0
        assert filled(blocked, radius_px)[1] == made


@pytest.mark.parametrize("radius_px", [1, 2, 5])
def test_labelled_pixels_block_the_ball(radius_px: int) -> None:
    for side, made in ((2 * radius_px, 0), (2 * radius_px + 1, 1)):
        labels = np.full((30, 30), 3, np.int32)
        labels[4 : 4 + side, 6 : 6 + side] = 0
        assert rolled(labels, np.zeros((30, 30), np.uint8), radius_px, 4) == made
        assert (labels != 0).all() == (labels == 3).all()


def test_the_border_of_the_frame_does_not_block_the_ball() -> None:
    labels, made = filled(np.zeros((9, 9), np.uint8), 3)
    assert made == 1 and (labels == 1).all()


def test_new_labels_are_consecutive_and_old_labels_stay() -> None:
    labels = np.zeros((41, 41), np.int32)
    labels[:3] = 5
    assert rolled(labels, two_rooms(0), 2, 6) == 2
    assert set(np.unique(labels)) <= {0, 5, 6, 7} and (labels[:3] == 5).all()


def test_no_free_pixels_give_no_regions() -> None:
    labels = np.ones((20, 20), np.int32)
    assert rolled(labels, np.zeros((20, 20), np.uint8), 2, 2) == 0


walls = hnp.arrays(
    np.bool_, st.tuples(st.integers(3, 14), st.integers(3, 14)), elements=st.sampled_from([True] + [False] * 9)
)


def test_a_region_within_the_discs_of_another_is_none() -> None:
    """The ball of radius 2 has two places between these walls; the discs of the first cover that of the second."""
    blocked = np.zeros((17, 17), np.uint8)
    blocked[6, 6] = blocked[10, 10] = 255
    labels, made = filled(blocked, 2)
    assert set(np.unique(labels[labels > 0])) == set(range(1, made + 1))


@settings(max_examples=60, deadline=None)
@given(walls, st.integers(1, 6))
def test_exactly_the_reachable_pixels_are_filled(walls: NDArray[np.bool_], radius_px: int) -> None:
    blocked = np.pad(walls, 6, constant_values=False)
    labels, made = filled(blocked.astype(np.uint8) * 255, radius_px)
    assert not labels[blocked].any()
    assert set(np.unique(labels[labels > 0])) == set(range(1, made + 1))
    assert not (labels > 0)[~rolled_over(blocked, radius_px - 0.5, radius_px + 0.5)].any()
    assert (labels > 0)[rolled_over(blocked, radius_px + 1.0, radius_px - 1.0)].all()


def rolled_over(blocked: NDArray[np.bool_], needs_px: float, covers_px: float) -> NDArray[np.bool_]:
    """Pixels within `covers_px` of a centre that has no wall within `needs_px`; beyond the frame there is none."""
    centres = ~anywhere_near(blocked, needs_px)
    return anywhere_near(centres, covers_px) & ~blocked


def anywhere_near(mask: NDArray[np.bool_], radius_px: float) -> NDArray[np.bool_]:
    reach = int(np.ceil(radius_px))
    padded = np.pad(mask, reach)
    height, width = mask.shape
    near = np.zeros_like(mask)
    for j, i in np.ndindex(2 * reach + 1, 2 * reach + 1):
        if (j - reach) ** 2 + (i - reach) ** 2 <= radius_px**2:
            near |= padded[j : j + height, i : i + width]
    return near


def filled(blocked: NDArray[np.uint8], radius_px: int) -> tuple[Labels, int]:
    labels = np.zeros(blocked.shape, np.int32)
    return labels, rolled(labels, blocked, radius_px, 1)


def rolled(labels: Labels, blocked: NDArray[np.uint8], radius_px: int, first_label: int) -> int:
    return fill(labels, blocked, unlabelled(labels), radius_px, first_label)
