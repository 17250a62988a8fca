"""Dense inverse search: the same flow as OpenCV's, bit by bit, and kernels that equal their Python version."""

from __future__ import annotations

import platform

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.flow.dis import FINER_STRIDE_PX, PRESETS, Preset, dis
from pipeline.flow.dis_refinement import refine
from pipeline.flow.gray import Gray
from pipeline.flow.patch_sums import PATCH_PX, patch_sums
from pipeline.jit import kernel
from tests.pipeline.flow.test_flow import pair

SIZES = [(16, 16), (17, 131), (131, 17), (16, 400), (61, 83), (97, 130), (240, 321)]
# OpenCV's code for other processors fuses multiplications and additions, which rounds differently.
on_x86 = pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="OpenCV rounds differently there")


def noise(height: int, width: int) -> tuple[Gray, Gray]:
    """Two pictures that have nothing in common: most patches go far, to the borders and beyond."""
    random = np.random.default_rng(height)
    first, second = random.integers(0, 256, (2, height, width), dtype=np.uint8)
    return first, second


def opencvs(previous: Gray, current: Gray, preset: Preset, finer: bool) -> NDArray[np.float32]:
    """The flow of OpenCV's implementation. Its own choice of the finest scale reads beyond its buffers for thin
    pictures, so that it is limited here: the coarsest scale still fits a patch."""
    params = PRESETS[preset]
    solver = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    coarsest = int(min(np.log2(max(previous.shape) / 32) + 0.5, np.log2(min(previous.shape) // PATCH_PX)))
    solver.setFinestScale(max(0, min(params.finest_scale - finer, coarsest)))
    solver.setPatchStride(max(params.stride_px, FINER_STRIDE_PX) if finer else params.stride_px)
    solver.setGradientDescentIterations(params.steps)
    solver.setVariationalRefinementIterations(params.refinements)
    return solver.calc(previous, current, None)  # type: ignore[call-overload, no-any-return]


@on_x86
@pytest.mark.parametrize("finer", [False, True])
@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_the_flow_is_opencvs_bit_by_bit(size: tuple[int, int], preset: Preset, finer: bool) -> None:
    for previous, current in (pair(*size), noise(*size)):
        ours = dis(previous, current, preset, finer)
        np.testing.assert_array_equal(ours, opencvs(previous, current, preset, finer))


@on_x86
@pytest.mark.parametrize("size", [(20, 32), (33, 41)], ids=str)
def test_the_refinement_is_opencvs_bit_by_bit(size: tuple[int, int]) -> None:
    first, second = noise(*size)
    ours = np.random.default_rng(1).normal(0, 1, (2, *size)).astype(np.float32)
    solver = cv2.VariationalRefinement.create()
    solver.setEpsilon(0.01)  # as in DIS
    theirs = solver.calcUV(first, second, ours[0].copy(), ours[1].copy())
    refine(first, second, ours[0], ours[1], 5)
    np.testing.assert_array_equal(ours, theirs)


@kernel
def _compared(
    pixels: NDArray[np.float32], at: int, place: int, weights: tuple[np.float32, np.float32, np.float32, np.float32]
) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    return patch_sums((pixels[0], pixels[1], pixels[2], pixels[3]), at, 20, place, 21, weights)


def test_a_patch_is_compared_in_kernels_as_outside_of_them() -> None:
    pixels = np.random.default_rng(0).normal(0, 100, (4, 400)).astype(np.float32)
    first, second, third, fourth = np.array([0.1, 0.2, 0.3, 0.4], np.float32)
    weights = first, second, third, fourth
    for at, place in ((0, 0), (47, 100), (252, 210)):
        outside = patch_sums((pixels[0], pixels[1], pixels[2], pixels[3]), at, 20, place, 21, weights)
        assert _compared(pixels, at, place, weights) == outside
