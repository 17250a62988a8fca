"""The frame analysis and the lines of zhang2011online as printed, for comparison (`algorithm=printed`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.colour.lab8 import LabPlanes, rgb_to_lab8
from pipeline.colour.scheme import ToneTracker
from pipeline.frames import Flow, Frame, Plane
from pipeline.kernels.executors import FrameExecutor, Pending
from pipeline.lines.dog import dog_response
from pipeline.lines.pen import Strokes
from pipeline.methods.abstraction.analysis import FrameAnalyzer
from pipeline.methods.abstraction.line_extractor import LineExtractor, LineResponse, Lines, PreviousFrame
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.sizes import Sizes, analysis_blur_px
from pipeline.methods.tasks import Clock
from pipeline.perception.backward_maps import BackwardMaps
from pipeline.perception.face_masks import FaceCrop
from pipeline.perception.faces import NO_FACES, Faces
from pipeline.perception.motion import flow_error
from pipeline.regions.edges import edges

TAU = 0.98
"""Weight of the wider Gaussian in winnemoeller2006realtime."""
NO_STROKES = Strokes(
    np.empty((0, 2), np.float32), np.empty(0, np.float32), np.empty(0, np.float32), np.zeros(1, np.int32)
)

_NO_PLANE = np.empty((0, 0), np.float32)


class PrintedLines(LineExtractor):
    """Thresholds the difference of Gaussians of each frame for itself (winnemoeller2006realtime, section 3.3)."""

    def respond(
        self, planes: LabPlanes, past: PreviousFrame | None, faces: Sequence[FaceCrop], memory: float,
        before: Plane | None,
    ) -> LineResponse:  # fmt: skip
        """No response: `draw` makes its own."""
        return LineResponse(_NO_PLANE, _NO_PLANE, None, None)

    def draw(self, response: LineResponse, planes: LabPlanes, importance: Plane) -> Lines:
        """The line layer of the next frame; it has no strokes. Of the arguments, only `planes` has an effect."""
        sigma_px = self.params.line_width / 1000 * min(self.size)
        above = dog_response(planes[0].astype(np.float32), sigma_px, TAU) - np.float32(self.params.line_threshold)
        ink = np.tanh(np.float32(self.params.line_sharpness) * np.maximum(above, 0)) * np.float32(255)
        coverage = np.rint(ink).astype(np.uint8)
        return Lines(NO_STROKES, np.asarray(cv2.resize(coverage, self.output_size), np.uint8))


class PrintedAnalyzer(FrameAnalyzer):
    """`FrameAnalyzer` without what the paper does not have: frames are neither smoothed nor denoised, faces get finer
    regions only by their importance, and edges are those of the lightness."""

    line_maker: ClassVar[type[LineExtractor]] = PrintedLines

    def __init__(
        self, params: AbstractionParams, sizes: Sizes, tone: bool, shot: int, clock: Clock, background: FrameExecutor
    ) -> None:
        super().__init__(params, sizes, tone, shot, clock, background)
        self.tone = ToneTracker(0) if tone else None

    def _smooth(self, frame: Frame) -> LabPlanes:
        with self.clock("lab"):
            return rgb_to_lab8(frame)

    def _settle(self, flow: Flow, before: NDArray[np.uint8], gray: NDArray[np.uint8]) -> Flow:
        return flow

    def _track_faces(
        self, frame: Frame, flow: Flow | None, fresh: bool
    ) -> tuple[Faces, list[FaceCrop], list[FaceCrop]]:
        super()._track_faces(frame, flow, fresh)
        return NO_FACES, [], []

    def _denoise(
        self, lab: LabPlanes, flow: Flow | None, steadiness: float
    ) -> tuple[BackwardMaps | None, LabPlanes, NDArray[np.uint8] | None]:  # fmt: skip
        if flow is None or self.denoised is None:
            return None, lab, None
        return None, lab, flow_error(self.denoised, lab, flow)

    def _edges(
        self, planes: LabPlanes, importance: Pending[Plane], faces: Sequence[FaceCrop], threshold: float
    ) -> NDArray[np.uint8]:  # fmt: skip
        with self.clock("edges"):
            light = np.zeros_like(planes)
            light[0] = cv2.GaussianBlur(planes[0], (0, 0), analysis_blur_px(self.sizes))  # Canny's first step
            return edges(light, importance.result(), threshold)
