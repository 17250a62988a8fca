"""The previous frame, moved to this one."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.frames import Flow
from pipeline.perception.backward_maps import backward_maps, warp_back_enlarged, warp_back_mapped

SHAPE = (12, 16)


def uniform_flow(dx: float, dy: float) -> Flow:
    return np.full((*SHAPE, 2), (dx, dy), np.float32)


def test_warp_back_samples_bilinearly_at_the_source() -> None:
    ramp = np.tile(np.arange(0, 160, 10, dtype=np.uint8), (12, 1))
    np.testing.assert_array_equal(warp_back_mapped(ramp, backward_maps(uniform_flow(3, 0)))[:, 3:], ramp[:, :-3])
    np.testing.assert_array_equal(warp_back_mapped(ramp, backward_maps(uniform_flow(0.5, 0)))[:, 1:], ramp[:, 1:] - 5)
    np.testing.assert_array_equal(warp_back_mapped(ramp, backward_maps(uniform_flow(-2, 0)))[:, :-2], ramp[:, 2:])


@pytest.mark.parametrize("rows", [0, 10, 75], ids=["one pixel moves", "some pixels move", "most pixels move"])
def test_warp_back_equals_a_remap_of_the_whole_frame(rows: int) -> None:
    rng = np.random.default_rng(5)
    image = rng.integers(0, 256, (75, 110, 3), dtype=np.uint8)
    flow = np.zeros((75, 110, 2), np.float32)
    flow[:rows, 10:] = rng.normal(0, 3, (rows, 100, 2))
    flow[74, 109] = (0.4, -0.3)
    y, x = np.mgrid[:75, :110].astype(np.float32)
    whole = cv2.remap(image, x - flow[..., 0], y - flow[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    maps = backward_maps(flow)
    moving = flow.any(axis=2)
    np.testing.assert_array_equal(maps.places, np.flatnonzero(moving))
    here = np.stack([x - flow[..., 0], y - flow[..., 1]], axis=-1)
    np.testing.assert_array_equal(maps.lost, np.flatnonzero(((here < 0) | (here > (109, 74))).any(axis=2)))
    assert maps.complete == (rows == 75)
    np.testing.assert_array_equal(warp_back_mapped(image, maps), whole)


def test_nothing_moves_back_without_motion() -> None:
    image = np.random.default_rng(5).integers(0, 256, (*SHAPE, 3), dtype=np.uint8)
    maps = backward_maps(np.zeros((*SHAPE, 2), np.float32))
    assert not maps.places.size
    np.testing.assert_array_equal(warp_back_mapped(image, maps), image)


@pytest.mark.parametrize("moving", [1.0, 0.1], ids=["everything moves", "few blocks move"])
@pytest.mark.parametrize("size", [(220, 150), (331, 200)], ids=["twice the sides", "other proportions"])
def test_a_larger_image_moves_as_the_nearest_pixels_of_the_flow(size: tuple[int, int], moving: float) -> None:
    rng = np.random.default_rng(7)
    width, height = size
    image = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    flow = np.zeros((75, 110, 2), np.float32)
    flow[: round(75 * moving), : round(110 * moving)] = (1.3, -2.6)
    flow[32, 64] = (-0.4, 0.3)
    y, x = np.mgrid[:height, :width]
    near = flow[y * 75 // height, x * 110 // width] * np.array([width / 110, height / 75], np.float32)
    there = np.stack([x, y], axis=-1).astype(np.float32) - near
    whole = cv2.remap(image, there[..., 0], there[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    np.testing.assert_array_equal(warp_back_enlarged(image, flow), whole)
