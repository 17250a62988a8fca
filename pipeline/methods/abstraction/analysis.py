"""Analysis of the incoming frame: flow, denoised colours, importance, edges and lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State, flatten, part
from pipeline.colour.lab8 import Lab8, LabPlanes, rgb_to_lab8
from pipeline.colour.scheme import Tone, ToneTracker
from pipeline.colour.scheme import measure as measure_tone
from pipeline.frames import Flow, Frame, Plane, same_size
from pipeline.kernels.executors import FrameExecutor, Pending, Ready
from pipeline.methods.abstraction.line_extractor import LineExtractor, LineResponse, Lines, PreviousFrame
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.sizes import Sizes, analysis_blur_px, resize_flow, shrink_frame
from pipeline.methods.tasks import Clock
from pipeline.perception.backward_maps import BackwardMaps, backward_maps
from pipeline.perception.cuts import CUTS, is_cut, light_steadiness, thumbnail
from pipeline.perception.face_contrast import raise_contrast
from pipeline.perception.face_masks import FaceCrop
from pipeline.perception.faces import Faces
from pipeline.perception.flow import estimate
from pipeline.perception.importance import ImportanceParams, ImportanceTracker
from pipeline.perception.motion import denoise, zero_still_flow
from pipeline.perception.shot_contrast import contrast_after
from pipeline.regions.edges import edges


@dataclass(frozen=True)
class AnalysisParams:
    """Constants of the analysis."""

    face_blur: float = 0.018
    least_face_blur_px: float = 0.4
    """Standard deviation of the blur of small faces before analysis, in widths of the face, and its least value, px."""
    denoise_tolerance: float = 6.0
    """Difference, CIELAB units, at which the weight of the past has fallen to 1/e."""


ANALYSIS = AnalysisParams()


@dataclass(frozen=True)
class FrameAnalysis:
    """Analysis of one frame for the later stages. Planes have the frame's size unless stated otherwise."""

    lab: Lab8
    """CIELAB of the denoised frame, 8 bit."""
    edges: Pending[NDArray[np.uint8]]
    importance: Pending[Plane]
    """float32, coarser than the frame."""
    flow: Flow | None
    """None for the first frame of a shot."""
    back: BackwardMaps | None
    residual: NDArray[np.uint8] | None
    lines: Pending[Lines] | None
    tone: Tone | None
    shot: int
    light_steadiness: float
    """0..1: 1 = the light is steady; towards 0 in a fade, when past colours do not predict the current ones."""
    contrast: float
    """0..1: by how much colours differ, relative to a usual shot, for the tolerances of regions."""
    params: AbstractionParams
    """The parameters of this frame."""


class SmoothedFrame(NamedTuple):
    """A frame at the size of the analysis.

    Attributes:
        small: uint8 (h, w, 3).
        planes: its CIELAB planes, smoothed.
        gray: the first of them, before faces are changed: motion is estimated from it.
    """

    small: Frame
    planes: LabPlanes
    gray: NDArray[np.uint8]


class FrameFeatures(NamedTuple):
    """Features of a frame and its motion since the one before it. `flow` is None for the first frame of a stream."""

    smoothed: Pending[SmoothedFrame]
    flow: Pending[Flow | None]


class FrameAnalyzer:
    """Analyses consecutive frames; keeps the previous frame, its denoised version, faces, importance and lines."""

    line_maker: ClassVar[type[LineExtractor]] = LineExtractor

    def __init__(
        self, params: AbstractionParams, sizes: Sizes, tone: bool, shot: int, clock: Clock, background: FrameExecutor
    ) -> None:
        self.params, self.sizes, self.clock, self.shot, self.background = params, sizes, clock, shot, background
        self.importance = ImportanceTracker(_importance(params), sizes.frame)
        self.lines = None if params.lines == "off" else self.line_maker(params, sizes)
        self.tone = ToneTracker() if tone else None
        self.gray: NDArray[np.uint8] | None = None
        self.denoised: Lab8 | None = None
        self.thumbnail: Plane | None = None
        self.light_steadiness = 1.0
        self.contrast: float | None = None
        self._deferred: Pending[None] = Ready(None)
        self._response: Pending[LineResponse] | None = None
        """The line response of the last frame; None = that of the line extractor's state."""
        self._search_due = False
        self.smooth_side, self.smooth_px = _short_gaussian(analysis_blur_px(sizes))

    def step(
        self, frame: Frame, mask: Plane | None = None, given: Flow | None = None,
        features: FrameFeatures | None = None, number: int = 0,
    ) -> FrameAnalysis:  # fmt: skip
        """Analysis of the next frame, with `given` flow from the previous frame at the size of the analysis, or an
        estimated one. Importance, edges and lines run in the background when there is a helper; edges
        and lines on the thread that needs them in a `LazyExecutor`.

        Args:
            features: of the frame; None = made here.
            number: of the frame in the film, for parameters that vary over it.
        """
        params = self.params.at(number)
        fresh = self._begins_shot(same_size(frame, self.sizes.frame))
        contrast = self._contrast(fresh, params.contrast_adaptation)
        small, planes, gray = self.smoothed(frame) if features is None else features.smoothed.result()
        flow = None
        if not fresh and (flow := given) is None:
            flow = self.flow(self.gray, gray) if features is None else features.flow.result()
        coarse = None if flow is None else resize_flow(flow, self.importance.map_size, self.sizes)
        tracked, faces, line_faces = self.background(self._track_faces, frame, coarse, fresh).result()
        importance = self.background(self._importance, small, gray, coarse, fresh, mask)
        self._sharpen(small, planes, faces)
        raise_contrast(planes[0][..., None], tracked, self.sizes.frame)
        back, planes, residual = self._denoise(planes, flow, params.steadiness)
        denoised = np.asarray(cv2.merge(list(planes)), np.uint8)
        threshold = params.edge_threshold * contrast
        edge_map = self.background.submit_stateless(self._edges, planes, importance, faces, threshold)
        past = None if flow is None or residual is None else PreviousFrame(flow, residual)
        lines = None
        if self.lines:
            self._response = self.background.submit_stateless(
                self._respond, planes, past, line_faces, params.paint_memory, self._response
            )
            lines = self.background.submit(self._lines, params, planes, importance, self._response)
        if self.background.helper is None:
            self.finish_frame()
        with self.clock("colour"):
            tone = self.tone.step(measure_tone(small), fresh) if self.tone else None
        self.gray, self.denoised = gray, denoised
        return FrameAnalysis(
            denoised,
            edge_map,
            importance,
            flow,
            back,
            residual,
            lines,
            tone,
            self.shot,
            self.light_steadiness,
            contrast,
            params,
        )  # fmt: skip

    def smoothed(self, frame: Frame) -> SmoothedFrame:
        """The frame at the size of the analysis. Uses no state."""
        with self.clock("lab"):
            small = shrink_frame(frame, self.sizes)
        planes = self._smooth(small)
        return SmoothedFrame(small, planes, planes[0].copy())

    def flow(self, before: NDArray[np.uint8] | None, gray: NDArray[np.uint8]) -> Flow | None:
        """Flow from the frame before, at the size of the analysis. Uses no state.

        Args:
            before, gray: `SmoothedFrame.gray` of the two frames; None = there is none before.
        """
        if before is None or self.params.temporal == "off":
            return None
        with self.clock("flow"):
            flow = estimate(before, gray, self.params.flow, finer=self.sizes.work != self.sizes.frame)
            return self._settle(flow, before, gray)

    def _settle(self, flow: Flow, before: NDArray[np.uint8], gray: NDArray[np.uint8]) -> Flow:
        return zero_still_flow(flow, before, gray, self.params.stillness)

    def _smooth(self, frame: Frame) -> LabPlanes:
        with self.clock("lab"):
            smooth = cv2.GaussianBlur(frame, (self.smooth_side, self.smooth_side), self.smooth_px)
            return rgb_to_lab8(np.asarray(smooth, np.uint8))

    def _track_faces(
        self, frame: Frame, flow: Flow | None, fresh: bool
    ) -> tuple[Faces, list[FaceCrop], list[FaceCrop]]:
        """Move the faces to this frame, along a flow at the size of the importance map; all of them, and the small ones
        in the analysed frame and in the line planes. Runs on the helper's thread, as everything that uses
        `self.importance`."""
        self._search_faces()  # still due from the previous frame
        with self.clock("importance"):
            # Small faces need the frame's own size, without the blur.
            sharp = np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)
            self.importance.track_faces(sharp, flow, fresh)
            analysed = self.importance.small_faces(self.sizes.work)
            drawn = analysed
            if self.lines and self.lines.small != self.sizes.work:
                drawn = self.importance.small_faces(self.lines.small)
            tracked = self.importance.faces.copy()
        self._search_due = True  # set and cleared on the helper's thread only: exactly one search slice a frame
        return tracked, analysed, drawn

    def _sharpen(self, small: Frame, planes: LabPlanes, faces: Sequence[FaceCrop]) -> None:
        """Replace small faces by less blurred ones, in place."""
        for face in faces:
            sigma = min(max(ANALYSIS.face_blur * face.width_px, ANALYSIS.least_face_blur_px), self.smooth_px)
            part = np.ascontiguousarray(small[face.box])
            fine = rgb_to_lab8(np.asarray(cv2.GaussianBlur(part, (0, 0), sigma), np.uint8))
            for plane, own in zip(planes, fine, strict=True):
                face.blend(plane, own)

    def _importance(
        self, small: Frame, gray: NDArray[np.uint8], flow: Flow | None, fresh: bool, mask: Plane | None
    ) -> Plane:  # fmt: skip
        with self.clock("importance"):
            return self.importance.step_coarse(gray, flow, fresh, mask)

    def finish_frame(self) -> None:
        """Work that only later frames need (a part of the face search): runs when the frame has been delivered."""
        self._deferred = self.background(self._search_faces)

    def _search_faces(self) -> None:
        if self._search_due:
            self._search_due = False
            with self.clock("importance"):
                self.importance.continue_search()

    def _edges(
        self, planes: LabPlanes, importance: Pending[Plane], faces: Sequence[FaceCrop], threshold: float
    ) -> NDArray[np.uint8]:  # fmt: skip
        with self.clock("edges"):
            return edges(planes, importance.result(), threshold, faces)

    def _respond(
        self, planes: LabPlanes, past: PreviousFrame | None, faces: Sequence[FaceCrop], memory: float,
        before: Pending[LineResponse] | None,
    ) -> LineResponse:  # fmt: skip
        assert self.lines is not None
        earlier = self.lines.response if before is None else before.result().plane
        with self.clock("lines"):
            return self.lines.respond(planes, past, faces, memory, earlier)

    def _lines(
        self, params: AbstractionParams, planes: LabPlanes, importance: Pending[Plane], response: Pending[LineResponse]
    ) -> Lines:
        assert self.lines is not None
        weight, found = importance.result(), response.result()
        with self.clock("lines"):
            self.lines.params = params
            return self.lines.draw(found, planes, weight)

    def _begins_shot(self, frame: Frame) -> bool:
        """True for the first frame, after a hard cut, and for every frame with `temporal=off`."""
        before, small = self.thumbnail, thumbnail(frame)
        self.thumbnail, self.light_steadiness = small, 1.0
        if before is None:
            return True
        cut = is_cut(before, small, self.params.cut_sensitivity)
        self.shot += cut
        if self.params.temporal == "off":
            return True
        self.light_steadiness = light_steadiness(before, small)
        return cut

    def _contrast(self, fresh: bool, adaptation: float) -> float:
        """Contrast of the shot, for the tolerances of regions: 1 = the usual one, or `adaptation` = 0.

        In a fade it is the usual one, so that no small regions remain from the dim frames.
        """
        assert self.thumbnail is not None
        if self.light_steadiness < CUTS.fading:
            self.contrast = None
            return 1.0
        self.contrast = contrast_after(None if fresh else self.contrast, self.thumbnail)
        return 1 + adaptation * (self.contrast - 1)

    def _denoise(
        self, lab: LabPlanes, flow: Flow | None, steadiness: float
    ) -> tuple[BackwardMaps | None, LabPlanes, NDArray[np.uint8] | None]:  # fmt: skip
        if flow is None or self.denoised is None:
            return None, lab, None
        with self.clock("denoise"):
            back = backward_maps(flow)
            denoised, residual = denoise(
                lab,
                self.denoised,
                flow,
                back,
                steadiness * self.light_steadiness,
                ANALYSIS.denoise_tolerance,
            )
        return back, denoised, residual

    def state(self) -> State:
        self._deferred.result()
        self._search_faces()
        parts: dict[str, Arrays] = {"importance": self.importance.state()}
        if self.lines:
            parts["lines"] = self.lines.state()
        if self.tone:
            parts["tone"] = self.tone.state()
        own: State = {"shot": np.array(self.shot), "frame_size": np.array(self.sizes.frame)}
        if self.gray is not None and self.denoised is not None and self.thumbnail is not None:
            own |= {"gray": self.gray, "denoised": self.denoised, "thumbnail": self.thumbnail}
        if self.contrast is not None:
            own |= {"contrast": np.array(self.contrast)}
        return own | flatten(parts)

    def restore(self, state: Arrays) -> None:
        self.shot = int(state["shot"])
        self.gray, self.denoised, self.thumbnail = (state.get(k) for k in ("gray", "denoised", "thumbnail"))
        self.contrast = float(state["contrast"]) if "contrast" in state else None
        self.importance.restore(part(state, "importance"))
        if self.lines:
            self.lines.restore(part(state, "lines"))
        if self.tone and (tone := part(state, "tone")):
            self.tone.restore(tone)

    @property
    def coarse(self) -> dict[str, tuple[int, int]]:
        """(width, height) of the stored planes that are smaller than the frame, by name in the session's state."""
        sizes = {
            "analyzer.importance.cues": self.importance.map_size,
            "analyzer.importance.mask": self.importance.map_size,
        }
        return sizes | ({"analyzer.lines.response": self.lines.small} if self.lines else {})


def _short_gaussian(sigma_px: float) -> tuple[int, float]:
    """Number of taps and sigma of a Gaussian truncated at about two sigma, whose variance equals `sigma_px` squared."""
    reach = round(2 * sigma_px)
    squares = np.arange(-reach, reach + 1) ** 2
    wider = sigma_px * np.linspace(1, 1.5, 501)
    weights = np.exp(-squares / (2 * wider[:, None] ** 2))
    variance = (weights * squares).sum(axis=1) / weights.sum(axis=1)
    return 2 * reach + 1, float(wider[np.abs(variance - sigma_px**2).argmin()])


def _importance(params: AbstractionParams) -> ImportanceParams:
    return ImportanceParams(
        face=params.face_importance, saliency=params.saliency_importance, motion=params.motion_importance,
        half_life_frames=params.importance_half_life,
    )  # fmt: skip
