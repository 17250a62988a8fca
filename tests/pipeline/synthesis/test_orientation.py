"""Directions: those of line art follow its lines, authored ones are decoded and averaged without branch cut."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.synthesis.energy import DIRECTIONS, NO_DIRECTION
from pipeline.synthesis.orientation import DirectionSources, authored_bins, authored_tensors, line_orientation

SIZE = (64, 80)


def vectors(degrees: float, sign: int = 1) -> np.ndarray:
    """A direction picture of one angle, counted from x upwards."""
    x, y = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    picture = np.full((*SIZE, 3), 128, np.uint8)
    picture[..., :2] = np.rint(127.5 + 127.5 * sign * np.array([x, y]))
    return picture


def steps_apart(bins: np.ndarray, degrees: float) -> np.ndarray:
    """Distance of directions from an angle that is counted from x downwards, in steps of 180/64 degrees."""
    wanted = round(degrees / 180 * DIRECTIONS) % DIRECTIONS
    difference = np.abs(bins.astype(int) - wanted)
    return np.minimum(difference, DIRECTIONS - difference)


@pytest.mark.parametrize("degrees", [0, 30, 90, 135, 179])
def test_authored_directions_are_decoded(degrees: float) -> None:
    bins = authored_bins(authored_tensors(vectors(degrees)))
    assert steps_apart(bins, -degrees).max() <= 1


def test_opposite_vectors_are_the_same_direction_and_gray_is_none() -> None:
    both = authored_tensors(vectors(40)) + authored_tensors(vectors(40, sign=-1))
    assert steps_apart(authored_bins(both), -40).max() <= 1
    assert (authored_bins(authored_tensors(np.full((*SIZE, 3), 128, np.uint8))) == NO_DIRECTION).all()


@pytest.mark.parametrize("degrees", [0, 25, 90, 120])
def test_directions_near_a_line_follow_the_line(degrees: float) -> None:
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float32)
    angle = np.radians(degrees)
    distance = np.abs((x - 40) * np.sin(angle) - (y - 32) * np.cos(angle)).astype(np.float32)
    bins = line_orientation(distance, 6, 2)
    near = (distance <= 4)[8:-8, 8:-8]
    assert steps_apart(bins[8:-8, 8:-8][near], degrees).max() <= 1
    assert (bins[distance > 6] == NO_DIRECTION).all()


def test_authored_directions_precede_those_of_lines_and_these_those_of_the_picture() -> None:
    gray = np.broadcast_to(np.arange(SIZE[1], dtype=np.uint8) * 3, SIZE).copy()
    distance = np.abs(np.arange(SIZE[0], dtype=np.float32)[:, None] - 32).repeat(SIZE[1], 1)
    authored = authored_tensors(vectors(45))
    authored[:, 40:] = 0
    bins = DirectionSources(gray, distance, authored).bins(2, 6)
    assert steps_apart(bins[:, :40], 135).max() <= 1
    assert steps_apart(bins[28:36, 45:], 0).max() <= 1
    assert steps_apart(bins[:20, 45:], 90).max() <= 1
