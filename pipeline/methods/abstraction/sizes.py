"""Sizes of the analysed and of the outgoing frames."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.perception.flow.warp import scale_flow

SHARP_FROM_ROWS = 480
"""Height from which `edges=auto` is `sharp`, px: below, soft edges are at most 2 px wide, and cost less."""
HALVED_FROM_PX = 720
"""Shorter side of the output frames from which `analysis=auto` analyses frames of half their sides, px."""
FINEST_LINE_PX = 0.7
"""Smallest standard deviation of the narrower Gaussian of lines; a smaller one would respond to single pixels."""


class Sizes(NamedTuple):
    """Sizes of frames, (width, height) in px."""

    frame: tuple[int, int]
    """Size of the incoming frames; smaller than `output` in a live session that works at a reduced size."""
    work: tuple[int, int]
    """Size of the analysed frames; at most `frame`."""
    output: tuple[int, int]
    """Size of the output frames."""
    curves: bool
    """Whether borders and lines are drawn as curves; else `work` equals `output`."""


def sizes_of(params: AbstractionParams, frame: tuple[int, int], output: tuple[int, int] | None = None) -> Sizes:
    """Sizes for incoming frames of (width, height) `frame`; `output` as for `AbstractionSession`.

    Only curves can be drawn at another size than the analysed one. Thinner lines than by default may need the frame's
    own size.
    """
    output = output or frame
    large = params.edges == "auto" and output[1] >= SHARP_FROM_ROWS
    curves = large or params.edges == "sharp" or frame != output
    thin = params.lines != "off" and params.line_width / 1000 * min(output) < 2 * FINEST_LINE_PX
    halved = curves and params.analysis == "auto" and min(output) >= HALVED_FROM_PX and not thin
    work = (min(frame[0], output[0] // 2), min(frame[1], output[1] // 2)) if halved else frame
    return Sizes(frame, work, output, curves)


def analysis_blur_px(sizes: Sizes) -> float:
    """Standard deviation of the Gaussian blur of the analysed frames, px; less if they have been reduced, which
    blurs, too."""
    return (0.6 if sizes.work == sizes.frame else 0.4) + 0.4 * min(sizes.work) / 360


def shrink_frame(frame: Frame, sizes: Sizes) -> Frame:
    """An incoming frame at the size at which it is analysed, uint8 (h, w, 3)."""
    if sizes.work == sizes.frame:
        return frame
    return np.asarray(cv2.resize(frame, sizes.work, interpolation=cv2.INTER_AREA), np.uint8)


def resize_flow(flow: Flow, grid: tuple[int, int], sizes: Sizes) -> Flow:
    """The flow of an analysed frame on a grid of (width, height), float32 (h, w, 2), px of the incoming frame."""
    across, down = np.divide(sizes.frame, sizes.work)
    return scale_flow(np.asarray(cv2.resize(flow, grid, interpolation=cv2.INTER_LINEAR), np.float32), across, down)


def shrink_mask(plane: NDArray[np.uint8], sizes: Sizes) -> NDArray[np.uint8]:
    """A plane of the output size at the size of the analysed frames, by area averages, uint8 (h, w)."""
    if sizes.work == sizes.output:
        return plane
    return np.asarray(cv2.resize(plane, sizes.work, interpolation=cv2.INTER_AREA), np.uint8)
