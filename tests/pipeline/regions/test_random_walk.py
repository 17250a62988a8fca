"""Random walks, compared with scikit-image and with known solutions; votes and leaks."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.errors import BadParameter
from pipeline.regions.random_walk import motion_edges, probabilities, vote


@pytest.mark.parametrize("count", [2, 4])
def test_probabilities_equal_scikit_image(count: int) -> None:
    from skimage.segmentation import random_walker

    draw = np.random.default_rng(count)
    picture = draw.random((23, 31))
    seeds = np.zeros(picture.shape, np.int32)
    places = draw.permutation(picture.size)[: 3 * count]
    seeds.ravel()[places] = np.arange(3 * count) % count + 1
    theirs = random_walker(picture, seeds, beta=90, mode="bf", return_full_prob=True)
    scale = -90 / (10 * picture.std())
    edges = tuple(np.exp(scale * np.diff(picture, axis=axis) ** 2) + 1e-10 for axis in (1, 0))
    ours = probabilities(seeds, (edges[0], edges[1]), count, tolerance=1e-7)
    np.testing.assert_allclose(ours, theirs, atol=1e-3)
    np.testing.assert_allclose(ours.sum(axis=0), 1, atol=1e-5)


def test_a_chain_of_two_seeds_is_linear() -> None:
    seeds = np.array([[1, 0, 0, 0, 2]], np.int32)
    found = probabilities(seeds, (np.ones((1, 4)), np.ones((0, 5))), 2)
    np.testing.assert_allclose(found[0, 0], [1, 0.75, 0.5, 0.25, 0], atol=1e-4)


def test_votes_are_edges_to_other_frames() -> None:
    """One pixel has links of weight 3 to label 1 and of weight 1 to label 2."""
    votes = np.array([3.0, 1.0]).reshape(2, 1, 1)
    found = probabilities(np.zeros((1, 1), np.int32), (np.ones((1, 0)), np.ones((0, 1))), 2, votes=votes)
    np.testing.assert_allclose(found.ravel(), [0.75, 0.25], atol=1e-5)


def test_invalid_seeds_are_rejected() -> None:
    with pytest.raises(BadParameter) as caught:
        probabilities(np.array([[3]], np.int32), (np.ones((1, 0)), np.ones((0, 1))), 2)
    assert caught.value.field == "seeds" and caught.value.remedy


def test_differences_of_motion_and_colour_weaken_edges() -> None:
    flow = np.zeros((4, 6, 2), np.float32)
    flow[:, 3:] = (3, 0)
    right, down = motion_edges(flow, flow)
    assert right[:, 2] == pytest.approx(np.exp(-9.0)) and (right[:, [0, 1, 3, 4]] == 1).all() and (down == 1).all()
    once, _ = motion_edges(flow, np.zeros_like(flow))
    assert once[:, 2] == pytest.approx(np.exp(-4.5))
    colours = np.zeros((4, 6, 3), np.uint8)
    colours[2:] = 10
    _, split = motion_edges(flow, flow, colours, 10.0)
    assert split[1] == pytest.approx(np.exp(-3.0)) and (split[[0, 2]] == 1).all()


def even(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[type-arg]
    return np.ones((height, width - 1), np.float32), np.ones((height - 1, width), np.float32)


def test_labels_spread_a_limited_distance_without_votes() -> None:
    choices, weights = np.zeros((1, 9, 80), np.int32), np.zeros((1, 9, 80), np.float32)
    choices[0, :, :4], weights[0, :, :4] = 7, 1
    labels, chance = vote(choices, weights, even(9, 80))
    assert (labels[:, :8] == 7).all() and (labels[:, 60:] == 0).all()
    assert (chance[labels == 7] > 0.5).all() and (chance[labels == 0] == 0).all()


def test_a_weak_edge_is_a_border_and_boxes_change_nothing() -> None:
    choices, weights = np.zeros((1, 20, 60), np.int32), np.zeros((1, 20, 60), np.float32)
    choices[0, 5:15, 5:10], weights[0, 5:15, 5:10] = 2, 1
    choices[0, 5:15, 50:55], weights[0, 5:15, 50:55] = 3, 1
    right, down = even(20, 60)
    right[:, 14] = 1e-5
    near, _ = vote(choices, weights, (right, down), margin=6)
    far, _ = vote(choices, weights, (right, down), margin=60)
    assert (near[:, 15:40] != 2).all() and (near[8:12, 11:14] == 2).all()
    np.testing.assert_array_equal(near[:, :15], far[:, :15])


def test_votes_for_no_label_leave_pixels_unlabelled() -> None:
    choices = np.zeros((2, 8, 8), np.int32)
    choices[0] = 4
    weights = np.stack([np.full((8, 8), 0.4, np.float32), np.full((8, 8), 0.6, np.float32)])
    assert (vote(choices, weights, even(8, 8))[0] == 0).all()
    assert (vote(choices, weights[::-1].copy(), even(8, 8))[0] == 4).all()
