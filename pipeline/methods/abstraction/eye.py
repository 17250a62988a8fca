"""The eye: everything that looks at the incoming frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.colour.scheme import Tone, ToneTracker
from pipeline.colour.scheme import measure as measure_tone
from pipeline.flow import estimate
from pipeline.frames import Flow, Frame, Plane, same_size
from pipeline.lines.coherent import Ink
from pipeline.methods.abstraction.inker import Inker
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.state import Clock, State, flatten, part
from pipeline.segmentation.cuts import is_cut, steadiness, thumbnail
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
    gray: NDArray[np.uint8]
    """Its lightness, uint8 (h, w)."""
    importance: Plane
    """float32, coarser than the frame."""
    flow: Flow | None
    """None for the first frame of a shot."""
    back: WayBack | None
    residual: NDArray[np.uint8] | None
    ink: Ink | None
    tone: Tone | None
    shot: int
    calm: float
    """0..1: 1 = the light is steady; towards 0 in a fade, when the past is no guide to colour."""


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
        self.smooth_box = (2 * round(1.5 * self.smooth_px) + 1,) * 2

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
            importance = self.importance.step_coarse(gray, flow, fresh, mask)
        with self.clock("lines"):
            ink = self.inker.step(calm, importance, flow) if self.inker else None
        with self.clock("colour"):
            tone = self.tone.step(measure_tone(frame), fresh) if self.tone else None
        self.gray, self.settled = gray, settled
        return Percept(settled, calm, importance, flow, back, residual, ink, tone, self.shot, self.calm)

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
            settled, residual = settle(
                lab, self.settled, flow, back, self.params.steadiness * self.calm, SETTLE_TOLERANCE
            )
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


def _importance(params: AbstractionParams) -> ImportanceParams:
    return ImportanceParams(
        face=params.face_importance, saliency=params.saliency_importance, motion=params.motion_importance,
        half_life_frames=params.importance_half_life,
    )  # fmt: skip
