"""Sizes of the analysed and of the outgoing frames."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow
from pipeline.methods.abstraction.params import AbstractionParams

SHARP_FROM_ROWS = 480
"""Height from which `edges=auto` is `sharp`, px: below, soft edges are at most 2 px wide, and cost less."""


class Sizes(NamedTuple):
    """(width, height) in px; the two differ in a live session that works at a reduced size."""

    work: tuple[int, int]
    """Size of the analysed frames."""
    output: tuple[int, int]
    """Size of the output frames."""

    @property
    def scale(self) -> tuple[float, float]:
        """Output over work size, x and y."""
        return self.output[0] / self.work[0], self.output[1] / self.work[1]


def draws_curves(params: AbstractionParams, sizes: Sizes) -> bool:
    """Whether borders and lines are drawn as curves."""
    large = params.edges == "auto" and sizes.output[1] >= SHARP_FROM_ROWS
    return large or params.edges == "sharp" or sizes.work != sizes.output


def analysis_blur_px(size: tuple[int, int]) -> float:
    """Standard deviation of the Gaussian blur of frames of `size` (width, height) before they are analysed, px."""
    return 0.6 + 0.4 * size[1] / 360


def enlarge_flow(flow: Flow, sizes: Sizes) -> Flow:
    """A flow field at the output size, float32 (h, w, 2), px of that size."""
    if sizes.work == sizes.output:
        return flow
    resized = cv2.resize(flow, sizes.output, interpolation=cv2.INTER_LINEAR)
    return np.asarray(resized * np.array(sizes.scale, np.float32), np.float32)


def enlarge_mask(plane: NDArray[np.uint8], sizes: Sizes) -> NDArray[np.uint8]:
    """A plane at the output size by its nearest neighbours, uint8 (h, w)."""
    if sizes.work == sizes.output:
        return plane
    return np.asarray(cv2.resize(plane, sizes.output, interpolation=cv2.INTER_NEAREST), np.uint8)


def shrink_mask(plane: NDArray[np.uint8], sizes: Sizes) -> NDArray[np.uint8]:
    """A plane of the output size at the size of the analysed frames, by area averages, uint8 (h, w)."""
    if sizes.work == sizes.output:
        return plane
    return np.asarray(cv2.resize(plane, sizes.work, interpolation=cv2.INTER_AREA), np.uint8)
