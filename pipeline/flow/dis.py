"""Dense inverse search (kroeger2016dis): the fast default.

An implementation of our own, in half of the time of OpenCV's and with the same flow, bit by bit. It depends on the two
pictures and the preset only: not on the number of threads, the processor or the version of OpenCV.

Each scale, from the coarsest to the finest, improves the flow of the one before: displacements of patches
(`dis_search`), a dense flow from them, and its variational refinement (`dis_refinement`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np

from pipeline.flow.dis_refinement import refine
from pipeline.flow.dis_search import BORDER_PX, PASSES, make_dense, search_patches, sum_gradients
from pipeline.flow.gray import Gray
from pipeline.flow.patch_sums import PATCH_PX
from pipeline.frames import Flow, Plane

Preset = Literal["ultrafast", "fast", "sparse", "half", "medium"]


@dataclass(frozen=True)
class DisParams:
    """The finest scale, and the work at each scale.

    Attributes:
        finest_scale: 0 = the full size, 1 = half of the sides, ...
        stride_px: distance of patches, px of their scale.
        steps: maximum number of steps of gradient descent for a patch, half of them in each of two passes.
        refinements: outer iterations of the variational refinement; 0 = none.
    """

    finest_scale: int
    stride_px: int
    steps: int
    refinements: int


PRESETS: dict[Preset, DisParams] = {
    "ultrafast": DisParams(2, 4, 12, 0),
    "fast": DisParams(2, 4, 16, 5),
    "sparse": DisParams(1, 4, 8, 2),
    "half": DisParams(1, 3, 8, 2),
    "medium": DisParams(1, 3, 25, 5),
}
FINER_STRIDE_PX = 5
"""Distance of the patches at a further scale, px: at 4 px, it would cost as much as twice the sides."""


def dis(previous: Gray, current: Gray, preset: Preset = "fast", finer: bool = False) -> Flow:
    """Flow from `previous` to `current`: previous(x) matches current(x + flow(x)).

    Args:
        previous, current: uint8 (height, width), one size, at least 16 px on each side.
        preset: ultrafast and fast stop at a quarter of the resolution, ultrafast without variational refinement;
            medium stops at half the resolution. half stops there too, with as many patches and fewer iterations: two
            thirds of medium's time, and warps nearly as accurate. sparse is half with 9/16 as many patches.
        finer: whether to stop one scale later, with patches at least `FINER_STRIDE_PX` apart.

    Returns:
        float32 (height, width, 2): (dx, dy) in px.

    Source: kroeger2016dis, with the parameters of OpenCV's presets.
    """
    params = PRESETS[preset]
    if finer:
        params = replace(params, finest_scale=params.finest_scale - 1, stride_px=max(params.stride_px, FINER_STRIDE_PX))
    coarsest = _coarsest_scale(previous.shape)
    params = replace(params, finest_scale=min(params.finest_scale, coarsest))
    scales = zip(*(_pyramid(picture, params.finest_scale, coarsest) for picture in (previous, current)), strict=True)
    flow: tuple[Plane, Plane] | None = None
    for first, second in reversed(list(scales)):
        flow = _improved(first, second, flow, params)
    assert flow is not None
    height, width = previous.shape
    enlarged = np.asarray(cv2.resize(cv2.merge(flow), (width, height)), np.float32)
    return np.multiply(enlarged, np.float32(1 << params.finest_scale), out=enlarged)


def _coarsest_scale(shape: tuple[int, ...]) -> int:
    """The coarsest scale: there, a quarter of the longer side fits a patch, and a patch fits the shorter side."""
    by_motion = math.log2(max(shape) / (4 * PATCH_PX)) + 0.5
    return max(0, int(min(by_motion, math.log2(min(shape) // PATCH_PX))))


def _pyramid(picture: Gray, finest: int, coarsest: int) -> list[Gray]:
    """The picture at the scales from `finest` to `coarsest`."""
    scales = [_shrunk(picture, 1 << finest)]
    for _ in range(finest, coarsest):
        scales.append(_shrunk(scales[-1], 2))
    return scales


def _shrunk(picture: Gray, factor: int) -> Gray:
    height, width = picture.shape
    size = width // factor, height // factor
    return np.ascontiguousarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


def _improved(first: Gray, second: Gray, coarser: tuple[Plane, Plane] | None, params: DisParams) -> tuple[Plane, Plane]:
    """Flow at one scale, px of it, from that of the next coarser one; None = no motion."""
    height, width = size = first.shape
    if coarser is None:
        x, y = np.zeros(size, np.float32), np.zeros(size, np.float32)
    else:
        x, y = (2 * np.asarray(cv2.resize(plane, (width, height)), np.float32) for plane in coarser)
    dx, dy = (np.asarray(slope, np.int16) for slope in cv2.spatialGradient(first))
    lines, columns = ((side - PATCH_PX) // params.stride_px + 1 for side in size)
    sums, found_x, found_y = (np.empty(shape, np.float32) for shape in ((5, lines, columns), *[(lines, columns)] * 2))
    sum_gradients(dx, dy, params.stride_px, np.empty((5, height, columns), np.float32), sums)
    border = BORDER_PX, BORDER_PX, BORDER_PX, BORDER_PX
    bordered = np.asarray(cv2.copyMakeBorder(second, *border, cv2.BORDER_REPLICATE))
    one, across, down, other = (picture.astype(np.float32).reshape(-1) for picture in (first, dx, dy, bordered))
    steps = params.steps // PASSES
    search_patches((one, across, down, other), size, params.stride_px, steps, (x, y), sums, (found_x, found_y))
    make_dense(
        first.reshape(-1), second.reshape(-1), size, (found_x, found_y), params.stride_px,
        np.empty(first.size, np.float32), (x.reshape(-1), y.reshape(-1)),
    )  # fmt: skip
    if params.refinements:
        refine(first, second, x, y, params.refinements)
    return x, y
