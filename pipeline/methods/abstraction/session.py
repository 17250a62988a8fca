"""The online method itself: one frame in, one frame out, from past frames only (zhang2011online, algorithm 1).

A session is two halves that may run on two threads, each frame after frame:

    perceive    flow, settled frame, Lab, importance, edges, ink       state of the eye
    paint       segmentation, colours, boundaries, overlay             state of the hand

`perceive` of frame t+1 needs nothing of `paint` of frame t; the result is the same however they overlap.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.colour.paint import flat, overlay
from pipeline.colour.scheme import ColourStats, Tone, ToneTracker
from pipeline.colour.scheme import measure as measure_tone
from pipeline.flow import estimate
from pipeline.frames import Flow, Frame, Plane, same_size
from pipeline.lines.coherent import Ink
from pipeline.methods.abstraction.inker import Inker
from pipeline.methods.abstraction.palette import Palette
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.segmentation.cuts import is_cut, steadiness, thumbnail
from pipeline.segmentation.edges import edges
from pipeline.segmentation.importance import ImportanceParams, ImportanceTracker
from pipeline.segmentation.motion import WayBack, fade, hold_still, settle, way_back
from pipeline.segmentation.regions import Lab8
from pipeline.segmentation.segmenter import Segmentation, Segmenter, SegmenterParams
from pipeline.segmentation.tidy import round_boundaries

Clock = Callable[[str], AbstractContextManager[None]]
State = dict[str, NDArray[Any]]

IDS_A_SHOT = 1_000_000_000
"""Region ids are shot * IDS_A_SHOT + n: unique over the video although shots are done apart."""
SETTLE_TOLERANCE = 6.0
"""CIELAB units at which the weight of the past has fallen to 1/e."""
FADING = 0.5
"""`calm` below which regions have to earn their pixels anew."""
INK = (14, 11, 16)
"""RGB of full ink: a warm black."""


@dataclass(frozen=True)
class Percept:
    """What the eye hands to the hand."""

    lab: NDArray[np.uint8]
    edges: NDArray[np.uint8]
    importance: Plane
    flow: Flow | None
    """None for the first frame of a shot."""
    back: WayBack | None
    residual: NDArray[np.uint8] | None
    ink: Ink | None
    tone: Tone | None
    shot: int
    calm: float
    """0..1: 1 = the light is steady; towards 0 in a fade, when the past is no guide to colour."""


@dataclass(frozen=True)
class Painting:
    """A finished frame with what it was made from."""

    frame: Frame
    regions: Segmentation
    labels: NDArray[np.int32]
    """int32 (h, w): the labels as drawn, boundaries smoothed."""
    colours: NDArray[np.uint8]
    """(n + 1, 3) RGB."""


def _no_clock(stage: str) -> AbstractContextManager[None]:
    return nullcontext()


class Eye:
    """Everything that looks at the incoming frame."""

    def __init__(self, params: AbstractionParams, size: tuple[int, int], tone: bool, shot: int, clock: Clock) -> None:
        self.params, self.size, self.clock, self.shot = params, size, clock, shot
        self.importance = ImportanceTracker(_importance(params), size)
        self.inker = Inker(params, size) if params.lines != "off" else None
        self.tone = ToneTracker() if tone else None
        self.gray: NDArray[np.uint8] | None = None
        self.settled: Lab8 | None = None
        self.thumbnail: Plane | None = None
        self.calm = 1.0
        self.smooth_px = 0.6 + 0.4 * size[1] / 360

    def step(self, frame: Frame, mask: Plane | None = None) -> Percept:
        frame = same_size(frame, self.size)
        fresh = self._begins_shot(frame)
        with self.clock("lab"):
            smooth = cv2.GaussianBlur(frame, (0, 0), self.smooth_px)
            lab = np.asarray(cv2.cvtColor(smooth, cv2.COLOR_RGB2LAB), np.uint8)
            gray = np.asarray(cv2.extractChannel(lab, 0), np.uint8)
        flow, back, settled, residual = self._follow(lab, gray, fresh)
        calm = np.asarray(cv2.extractChannel(settled, 0), np.uint8)
        with self.clock("importance"):
            importance = self.importance.step(gray, flow, fresh, mask)
        with self.clock("edges"):
            outline = edges(calm, importance, self.params.edge_threshold)
        with self.clock("lines"):
            ink = self.inker.step(calm, importance, flow) if self.inker else None
        with self.clock("colour"):
            tone = self.tone.step(measure_tone(frame), fresh) if self.tone else None
        self.gray, self.settled = gray, settled
        return Percept(settled, outline, importance, flow, back, residual, ink, tone, self.shot, self.calm)

    def _begins_shot(self, frame: Frame) -> bool:
        """The first frame, a hard cut, or any frame at all when every frame stands on its own."""
        before, self.thumbnail = self.thumbnail, thumbnail(frame)
        self.calm = 1.0 if before is None else steadiness(before, self.thumbnail)
        if before is None:
            return True
        cut = is_cut(before, self.thumbnail, self.params.cut_sensitivity)
        self.shot += cut
        return cut or self.params.temporal == "off"

    def _follow(
        self, lab: Lab8, gray: NDArray[np.uint8], fresh: bool
    ) -> tuple[Flow | None, WayBack | None, Lab8, NDArray[np.uint8] | None]:  # fmt: skip
        if fresh or self.gray is None or self.settled is None:
            return None, None, lab, None
        with self.clock("flow"):
            flow = estimate(self.gray, gray, self.params.flow)
            hold_still(flow, self.gray, gray, self.params.stillness)
        with self.clock("settle"):
            back = way_back(flow)
            settled, residual = settle(lab, self.settled, flow, back, self.params.steadiness * self.calm, SETTLE_TOLERANCE)
        return flow, back, settled, residual

    def state(self) -> State:
        parts: dict[str, Mapping[str, NDArray[Any]]] = {"importance": self.importance.state()}
        if self.inker:
            parts["inker"] = self.inker.state()
        if self.tone:
            parts["tone"] = self.tone.state()
        own: State = {"shot": np.array(self.shot)}
        if self.gray is not None and self.settled is not None and self.thumbnail is not None:
            own |= {"gray": self.gray, "settled": self.settled, "thumbnail": self.thumbnail}
        return own | _flatten(parts)

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.shot = int(state["shot"])
        self.gray, self.settled, self.thumbnail = (state.get(k) for k in ("gray", "settled", "thumbnail"))
        self.importance.restore(_part(state, "importance"))
        if self.inker:
            self.inker.restore(_part(state, "inker"))
        if self.tone:
            self.tone.restore(_part(state, "tone"))


class Hand:
    """Everything that makes the outgoing frame."""

    def __init__(
        self, params: AbstractionParams, size: tuple[int, int], reference: ColourStats | None, clock: Clock
    ) -> None:  # fmt: skip
        self.params, self.clock = params, clock
        self.segmenter = Segmenter(_segmenter(params), size)
        self.palette = Palette(params, reference)
        self.round_px = round(params.boundary_smoothing / 1000 * size[1])
        self.shot = -1
        self.picture: Frame | None = None

    def step(self, percept: Percept) -> Painting:
        with self.clock("segment"):
            if percept.flow is None:
                self._begin(percept.shot)
            fading = percept.calm < FADING
            regions = self.segmenter.step(
                percept.lab, percept.edges, percept.importance, percept.flow, percept.residual, fading
            )
        with self.clock("colour"):
            colours = self.palette.step(regions, percept.tone, percept.calm)
        with self.clock("paint"):
            labels = round_boundaries(regions.labels, self.round_px) if self.round_px else regions.labels
            picture = flat(labels, colours)
            if percept.ink is not None:
                overlay(picture, percept.ink, INK, self.params.line_opacity)
            self.picture = self._fade(picture, percept)
        return Painting(self.picture, regions, labels, colours)

    def _fade(self, picture: Frame, percept: Percept) -> Frame:
        """Where the source agrees with its past, let paint fade over from the last frame rather than jump."""
        if percept.back is None or percept.residual is None or self.picture is None or not self.params.paint_memory:
            return picture
        return fade(picture, self.picture, percept.back, percept.residual, self.params.paint_memory * percept.calm)

    def _begin(self, shot: int) -> None:
        """A shot's ids start at its own base; frames on their own (`temporal=off`) go on counting within it."""
        self.segmenter.reset(self.segmenter.next_id if shot == self.shot else shot * IDS_A_SHOT + 1)
        self.palette.last = None
        self.shot = shot

    def state(self) -> State:
        parts = {"segmenter": self.segmenter.state(), "palette": self.palette.state()}
        own: State = {"shot": np.array(self.shot)}
        if self.picture is not None:
            own["picture"] = self.picture
        return own | _flatten(parts)

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.shot = int(state["shot"])
        self.picture = state.get("picture")
        self.segmenter.restore(_part(state, "segmenter"))
        self.palette.restore(_part(state, "palette"))


class AbstractionSession:
    """Online abstraction of one stream of frames of one size. Not thread-safe but for its two halves.

    Args:
        params: the method's.
        size: (width, height), px.
        reference: colour scheme to move towards, or None for mean region colours.
        shot: number of the first frame's shot in the whole video.
        clock: called with a stage's name, times it.
    """

    def __init__(
        self, params: AbstractionParams, size: tuple[int, int], reference: ColourStats | None = None, shot: int = 0,
        clock: Clock = _no_clock,
    ) -> None:  # fmt: skip
        self.eye = Eye(params, size, reference is not None, shot, clock)
        self.hand = Hand(params, size, reference, clock)

    def step(self, frame: Frame, mask: Plane | None = None) -> Frame:
        """The next frame of the stream, stylised. `mask`: the user's importance from this frame on, 0..1, or None."""
        return self.hand.step(self.eye.step(frame, mask)).frame

    def state(self) -> State:
        """All it remembers, as arrays by name; a session restored from it goes on with the same bytes."""
        return _flatten({"eye": self.eye.state(), "hand": self.hand.state()})

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.eye.restore(_part(state, "eye"))
        self.hand.restore(_part(state, "hand"))


def _flatten(parts: Mapping[str, Mapping[str, NDArray[Any]]]) -> State:
    return {f"{name}.{key}": array for name, part in parts.items() for key, array in part.items()}


def _part(state: Mapping[str, NDArray[Any]], name: str) -> State:
    return {key[len(name) + 1 :]: array for key, array in state.items() if key.startswith(name + ".")}


def _importance(params: AbstractionParams) -> ImportanceParams:
    return ImportanceParams(
        face=params.face_importance, saliency=params.saliency_importance, motion=params.motion_importance,
        half_life_frames=params.importance_half_life,
    )  # fmt: skip


def _segmenter(params: AbstractionParams) -> SegmenterParams:
    return SegmenterParams(
        flow_error_limit=params.flow_error_limit,
        growing_limit=params.growing_limit,
        misfit_slack=1.1,
        core_slack=params.core_tolerance,
        boundary_margin=params.boundary_margin,
        merge_similar=params.merge_similar,
        smallest_region=params.smallest_region / 1000,
    )
