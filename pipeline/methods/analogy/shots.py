"""Frames of a job as synthesis wants them: guides, motion, at one level."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import cv2
import numpy as np

from pipeline.errors import BadInput
from pipeline.frames import Frame, Plane
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.styles import Pair, given_guides, has_lines, line_distance
from pipeline.methods.base import Bench
from pipeline.synthesis.images import Bytes, Offsets, Target, halved, stacked
from pipeline.synthesis.motion import Motion, estimated
from pipeline.synthesis.orientation import orientation
from pipeline.synthesis.tones import Matched, Tones, lab_guide, tones_of

SMALLEST_PX = 24
"""The shorter side of the coarsest level is at least this: below, there is nothing to match and no flow to find."""


def levels_of(params: AnalogyParams, size: tuple[int, int], style_px: int) -> int:
    """How many levels fit."""
    fits = int(math.log2(max(1, min(*size, style_px) / SMALLEST_PX)))
    return max(1, min(params.levels, fits + 1))


def matching(params: AnalogyParams, pair: Pair, tones: Mapping[str, Any]) -> Callable[[Bytes], Bytes]:
    """How the video's guide is given the style's tones, if it is."""
    if params.tone_match == "off" or (params.tone_match == "auto" and not pair.derived):
        return lambda guide: guide
    return Matched(Tones(**tones), tones_of([pair.guide]))


class Stills:
    """Frames [start, stop) of a job, halved to a level, with their guides.

    Args:
        match: gives a guide the style's tones.
        level: 0 = full size.
    """

    def __init__(self, bench: Bench, start: int, stop: int, level: int, match: Callable[[Bytes], Bytes]) -> None:
        self._params: AnalogyParams = bench.params
        self._match = match
        self.frames: dict[int, Frame] = {}
        self.guides: dict[int, Bytes] = {}
        sources = [bench.frames(f"guide_{name}", start, stop) for name in given_guides(bench)]
        self.distances: dict[int, Plane] = {}
        drawn = bench.frames("lines", start, stop) if has_lines(bench) else None
        for index, frame in enumerate(bench.frames("video", start, stop), start):
            with bench.clock("guides"):
                if drawn is not None:
                    self.distances[index] = _shrunk(line_distance(_frame(drawn, "lines", frame)), level)
                extra = [_next(source, name, frame) for source, name in zip(sources, given_guides(bench), strict=True)]
                guide = stacked([match(lab_guide(frame)), *extra])
                self.frames[index], self.guides[index] = _down(frame, level), _down(guide, level)

    def target(self, index: int) -> Target:
        guide = self.guides[index]
        turning = self._params.rotation == "on"
        gray = np.ascontiguousarray(guide[..., 0])
        bins = orientation(gray, self._params.rotation_sigma) if turning else None
        return Target(guide, bins, self.distances.get(index))


def _down(image: Bytes, level: int) -> Bytes:
    for _ in range(level):
        image = np.asarray(halved(image), np.uint8)
    return image


def _shrunk(distances: Plane, level: int) -> Plane:
    for _ in range(level):
        distances = np.asarray(halved(distances), np.float32) / np.float32(2)
    return distances


def _next(source: Iterator[Frame], name: str, frame: Frame) -> Bytes:
    """A guide's next frame as a plane."""
    return np.asarray(cv2.cvtColor(_frame(source, f"guide_{name}", frame), cv2.COLOR_RGB2GRAY), np.uint8)


def _frame(source: Iterator[Frame], name: str, frame: Frame) -> Frame:
    """The next frame of an input that goes with the video."""
    found = next(source, None)
    if found is None or found.shape != frame.shape:
        what = "ends before the video" if found is None else f"is {found.shape[1]}x{found.shape[0]}"
        raise BadInput(
            f"The input {name} {what}.", field=f"inputs.{name}",
            remedy=f"Give as many frames of {frame.shape[1]}x{frame.shape[0]} as the video has.",
        )  # fmt: skip
    return found


class Shot:
    """`pipeline.synthesis.sweeps.Shot` over decoded frames, motion by optical flow."""

    def __init__(self, stills: Stills, params: AnalogyParams, clock: Callable[[str], Any]) -> None:
        self._stills, self._params, self._clock = stills, params, clock
        self._motions: dict[int, tuple[Motion, Motion]] = {}

    def target(self, index: int) -> Target:
        with self._clock("guides"):
            return self._stills.target(index)

    def motion(self, index: int, other: int) -> Motion:
        first = min(index, other)
        if first not in self._motions:
            with self._clock("flow"):
                pair = self._stills.frames[first], self._stills.frames[first + 1]
                epsilon = self._params.occlusion_epsilon if self._params.occlusion == "on" else math.inf
                self._motions = {first: estimated(*pair, self._params.flow, epsilon)}
        return self._motions[first][0 if index < other else 1]

    def given(self, index: int) -> Offsets | None:
        return None

    def share(self, index: int, forward: bool) -> float:
        return 0.5

    def ribbons(self, index: int) -> Offsets | None:
        return None
