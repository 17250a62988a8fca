"""The eye: everything that looks at the incoming frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.aside import Aside, Later, Now
from pipeline.colour.lab8 import LabPlanes, rgb_to_lab8
from pipeline.colour.scheme import Tone, ToneTracker
from pipeline.colour.scheme import measure as measure_tone
from pipeline.flow import estimate
from pipeline.frames import Flow, Frame, Plane, same_size
from pipeline.lines.coherent import Ink
from pipeline.methods.abstraction.inker import Inker
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.state import Clock, State, flatten, part
from pipeline.segmentation.cuts import is_cut, steadiness, thumbnail
from pipeline.segmentation.edges import edges
from pipeline.segmentation.importance import ImportanceParams, ImportanceTracker
from pipeline.segmentation.motion import WayBack, hold_still, settle, way_back
from pipeline.segmentation.regions import Lab8

SETTLE_TOLERANCE = 6.0
"""CIELAB units at which the weight of the past has fallen to 1/e."""


@dataclass(frozen=True)
class Percept:
    """What the eye hands on."""

    lab: Lab8
    """Settled."""
    edges: Later[NDArray[np.uint8]]
    importance: Later[Plane]
    """float32, coarser than the frame."""
    flow: Flow | None
    """None for the first frame of a shot."""
    back: WayBack | None
    residual: NDArray[np.uint8] | None
    ink: Later[Ink] | None
    tone: Tone | None
    shot: int
    calm: float
    """0..1: 1 = the light is steady; towards 0 in a fade, when the past is no guide to colour."""


class Eye:
    """Everything that looks at the incoming frame."""

    def __init__(
        self, params: AbstractionParams, size: tuple[int, int], tone: bool, shot: int, clock: Clock, aside: Aside
    ) -> None:  # fmt: skip
        self.params, self.size, self.clock, self.shot, self.aside = params, size, clock, shot, aside
        self.importance = ImportanceTracker(_importance(params), size)
        self.inker = Inker(params, size) if params.lines != "off" else None
        self.tone = ToneTracker() if tone else None
        self.gray: NDArray[np.uint8] | None = None
        self.settled: Lab8 | None = None
        self.thumbnail: Plane | None = None
        self.calm = 1.0
        self._resting: Later[None] = Now(None)
        self._search_due = False
        self.smooth_side, self.smooth_px = _short_gaussian(0.6 + 0.4 * size[1] / 360)

    def step(self, frame: Frame, mask: Plane | None = None) -> Percept:
        """Importance, edges and ink, which nothing waits for at once, are made aside."""
        frame = same_size(frame, self.size)
        planes = self._smooth(frame)
        gray = planes[0]
        fresh = self._begins_shot(frame)
        flow = self._flow(gray, fresh)
        importance = self.aside(self._importance, gray, flow, fresh, mask)
        back, planes, residual = self._settle(planes, flow)
        settled, calm = np.asarray(cv2.merge(list(planes)), np.uint8), planes[0]
        outline = self.aside(self._edges, calm, importance)
        ink = self.aside(self._ink, self.inker, calm, importance, flow) if self.inker else None
        if self.aside.helper is None:
            self.rest()
        with self.clock("colour"):
            tone = self.tone.step(measure_tone(frame), fresh) if self.tone else None
        self.gray, self.settled = gray, settled
        return Percept(settled, outline, importance, flow, back, residual, ink, tone, self.shot, self.calm)

    def _smooth(self, frame: Frame) -> LabPlanes:
        with self.clock("lab"):
            smooth = cv2.GaussianBlur(frame, (self.smooth_side, self.smooth_side), self.smooth_px)
            return rgb_to_lab8(np.asarray(smooth, np.uint8))

    def _importance(
        self, gray: NDArray[np.uint8], flow: Flow | None, fresh: bool, mask: Plane | None
    ) -> Plane:  # fmt: skip
        self._search_faces()  # of the frame before, if there was no time for it yet
        with self.clock("importance"):
            importance = self.importance.step_coarse(gray, flow, fresh, mask)
        self._search_due = True  # set and cleared by the helper alone: once from frame to frame, however they overlap
        return importance

    def rest(self) -> None:
        """When a frame is finished, or at its end if nobody helps: what only the frames to come will ask for."""
        self._resting = self.aside(self._search_faces)

    def _search_faces(self) -> None:
        if self._search_due:
            self._search_due = False
            with self.clock("importance"):
                self.importance.search_on()

    def _edges(self, gray: NDArray[np.uint8], importance: Later[Plane]) -> NDArray[np.uint8]:
        with self.clock("edges"):
            return edges(gray, importance.result(), self.params.edge_threshold)

    def _ink(self, inker: Inker, gray: NDArray[np.uint8], importance: Later[Plane], flow: Flow | None) -> Ink:
        with self.clock("lines"):
            return inker.step(gray, importance.result(), flow)

    def _begins_shot(self, frame: Frame) -> bool:
        """The first frame, a hard cut, or any frame at all when every frame stands on its own."""
        before, self.thumbnail = self.thumbnail, thumbnail(frame)
        self.calm = 1.0 if before is None else steadiness(before, self.thumbnail)
        if before is None:
            return True
        cut = is_cut(before, self.thumbnail, self.params.cut_sensitivity)
        self.shot += cut
        return cut or self.params.temporal == "off"

    def _flow(self, gray: NDArray[np.uint8], fresh: bool) -> Flow | None:
        if fresh or self.gray is None:
            return None
        with self.clock("flow"):
            flow = estimate(self.gray, gray, self.params.flow)
            return hold_still(flow, self.gray, gray, self.params.stillness)

    def _settle(
        self, lab: LabPlanes, flow: Flow | None
    ) -> tuple[WayBack | None, LabPlanes, NDArray[np.uint8] | None]:  # fmt: skip
        if flow is None or self.settled is None:
            return None, lab, None
        with self.clock("settle"):
            back = way_back(flow)
            settled, residual = settle(
                lab, self.settled, flow, back, self.params.steadiness * self.calm, SETTLE_TOLERANCE
            )
        return back, settled, residual

    def state(self) -> State:
        self._resting.result()
        self._search_faces()
        parts: dict[str, Mapping[str, NDArray[Any]]] = {"importance": self.importance.state()}
        if self.inker:
            parts["inker"] = self.inker.state()
        if self.tone:
            parts["tone"] = self.tone.state()
        own: State = {"shot": np.array(self.shot)}
        if self.gray is not None and self.settled is not None and self.thumbnail is not None:
            own |= {"gray": self.gray, "settled": self.settled, "thumbnail": self.thumbnail}
        return own | flatten(parts)

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.shot = int(state["shot"])
        self.gray, self.settled, self.thumbnail = (state.get(k) for k in ("gray", "settled", "thumbnail"))
        self.importance.restore(part(state, "importance"))
        if self.inker:
            self.inker.restore(part(state, "inker"))
        if self.tone and (tone := part(state, "tone")):
            self.tone.restore(tone)

    @property
    def coarse(self) -> dict[str, tuple[int, int]]:
        """(width, height) of what is remembered coarser than the frame, by its name in a session's state."""
        sizes = {"eye.importance.cues": self.importance.map_size, "eye.importance.mask": self.importance.map_size}
        return sizes | ({"eye.inker.ink": self.inker.small} if self.inker else {})


def _short_gaussian(sigma_px: float) -> tuple[int, float]:
    """(taps, standard deviation) of a Gaussian cut off at about two of them, yet as wide as `sigma_px`."""
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
