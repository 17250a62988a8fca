"""Ribbons lead from each pixel to its positions in the keyframes on both sides, partial ones included."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.compute import device
from pipeline.synthesis.energy import Energy
from pipeline.synthesis.images import NOWHERE, Offsets, StyleImage, Target, packed
from pipeline.synthesis.motion import Motion
from pipeline.synthesis.opencl import OpenCLOperations
from pipeline.synthesis.ribbons import ribbons_to_keys

pytestmark = pytest.mark.real("opencl")

HEIGHT, WIDTH, SPEED = 12, 40, 2
"""Size of the frames, px, and speed to the right, px per frame."""


class Pan:
    """An animation that moves to the right by `SPEED` px per frame."""

    def motion(self, index: int, other: int) -> Motion:
        displacement = np.zeros((HEIGHT, WIDTH, 2), np.float32)
        displacement[..., 0] = SPEED * (other - index)
        x = np.arange(WIDTH) + displacement[..., 0]
        return Motion(displacement, ((x >= 0) & (x < WIDTH)).astype(np.uint8))

    def target(self, index: int) -> Target:
        return Target(np.zeros((HEIGHT, WIDTH, 3), np.uint8))

    def fixed_offsets(self, index: int) -> Offsets | None:
        return None

    def merge_probability(self, index: int, forward: bool) -> float:
        return 0.5

    def ribbons(self, index: int) -> Offsets | None:
        return None


def key(columns: slice, top: int) -> Offsets:
    """A keyframe that is painted in some columns and lies at row `top` of the style."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    offsets = np.full((HEIGHT, WIDTH, 2), NOWHERE, np.float32)
    offsets[:, columns] = np.stack([x, y + top], -1)[:, columns]
    return offsets


def ribbons(painted: dict[int, Offsets]) -> dict[int, Offsets]:
    energy = Energy(guides=(1.0, 1.0, 1.0))
    blank = np.zeros((3 * HEIGHT, WIDTH, 3), np.uint8)
    ops = OpenCLOperations(device())
    style = ops.load(StyleImage(blank, packed(energy, blank, blank)), energy)
    return ribbons_to_keys(ops, style, Pan(), range(5), painted)


def test_each_pixel_is_connected_to_both_keyframes() -> None:
    found = ribbons({0: key(slice(None), 0), 4: key(slice(None), HEIGHT)})
    middle = found[2]
    assert (middle[0, :, 4:, 0] == np.arange(WIDTH - 4)).all()
    assert (middle[1, :, :-4, 0] == np.arange(4, WIDTH)).all()
    assert (middle[0, :, 4:, 1] < HEIGHT).all() and (middle[1, :, :-4, 1] >= HEIGHT).all()
    assert (middle[0, :, :4] == NOWHERE).all() and (middle[1, :, -4:] == NOWHERE).all()


def test_partial_keyframes_are_connected_where_they_are_painted() -> None:
    """Frame 2 is painted in the columns 10 to 19; the others lead to the keyframe behind it."""
    found = ribbons({0: key(slice(None), 0), 2: key(slice(10, 20), HEIGHT)})
    last = found[4]
    assert (last[0, :, 14:24, 1] >= HEIGHT).all() and (last[0, :, 14:24, 0] == np.arange(10, 20)).all()
    assert (last[0, :, 8:14, 1] < HEIGHT).all() and (last[0, :, 24:, 1] < HEIGHT).all()
    first = ribbons({2: key(slice(10, 20), HEIGHT)})[0]
    assert (first[1, :, 6:16, 0] == np.arange(10, 20)).all() and (first[1, :, :6] == NOWHERE).all()


def test_without_keyframes_there_are_no_ribbons() -> None:
    assert ribbons({}) == {}
