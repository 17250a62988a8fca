"""Inversion of a flow, with pixels that become hidden."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.perception.flow.invert import invert_flow

SHAPE = (40, 60)


def texture(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 100, SHAPE).astype(np.uint8)


@pytest.mark.parametrize("motion", [(3.0, -2.0), (0.5, 0.25), (0.0, 0.0)])
def test_the_inverse_of_a_uniform_flow_is_its_negative(motion: tuple[float, float]) -> None:
    way = np.full((*SHAPE, 2), motion, np.float32)
    found, visible = invert_flow(way, texture(1), texture(1))
    np.testing.assert_array_equal(found, -way)
    assert visible[6:-6, 6:-6].all()


def test_pixels_covered_by_a_moving_square_are_hidden() -> None:
    wall, there, here = texture(2), texture(2), texture(2)
    there[10:20, 10:20] = 200  # where it was
    here[10:20, 16:26] = 200  # where it is now
    back = np.zeros((*SHAPE, 2), np.float32)
    back[10:20, 16:26] = (-6, 0)
    back[10:20, 10:16] = (20, 0)  # what it uncovers was not to be visible: the flow there is any
    found, visible = invert_flow(back, here, there)
    np.testing.assert_array_equal(found[10:20, 10:20], np.broadcast_to(np.float32([6, 0]), (10, 10, 2)))
    assert not visible[10:20, 20:26].any() and visible[25:].all() and (found[25:] == 0).all()
    assert (found[10:20, 20:26] == (6, 0)).all(), "the hidden goes as what is there now came"
    assert (wall == texture(2)).all()


def test_of_two_candidates_the_more_similar_one_is_used() -> None:
    there, here = np.full(SHAPE, 50, np.uint8), np.full(SHAPE, 50, np.uint8)
    here[20, 30], there[20, 33] = 200, 200
    back = np.zeros((*SHAPE, 2), np.float32)
    back[20, 30] = (3, 0)
    found, _ = invert_flow(back, here, there)
    assert tuple(found[20, 33]) == (-3, 0) and tuple(found[20, 34]) == (0, 0)
