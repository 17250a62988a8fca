"""Frames of a job as synthesis wants them: guides, motion, at one level."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from pipeline.compute import device
from pipeline.flow import estimate
from pipeline.flow.gray import to_gray
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.sources import Pair, Picture, Source
from pipeline.synthesis.distance import extrapolated, nearest
from pipeline.synthesis.images import NOWHERE, Bytes, Offsets, Target, halved, stacked
from pipeline.synthesis.motion import Motion, between, coarser, stilled
from pipeline.synthesis.orientation import orientation
from pipeline.synthesis.tones import Matched, Tones, lab_guide, tones_of

SMALLEST_PX = 24
"""The shorter side of the coarsest level is at least this: below, there is nothing to match and no flow to find."""
_SPREAD_PX = 600


def levels_of(params: AnalogyParams, size: tuple[int, int], style_px: int) -> int:
    """How many levels fit."""
    fits = int(math.log2(max(1, min(*size, style_px) / SMALLEST_PX)))
    return max(1, min(params.levels, fits + 1))


def matching(params: AnalogyParams, pair: Pair, tones: Tones) -> Callable[[Bytes], Bytes]:
    """How the video's guide is given the style's tones, if it is."""
    if params.tone_match == "off" or (params.tone_match == "auto" and not pair.derived):
        return lambda guide: guide
    return Matched(tones, tones_of([pair.guide]))


class Stills:
    """Frames [start, stop) of a source, halved to a level, with their guides.

    Args:
        match: gives a guide the style's tones.
        level: 0 = full size.
    """

    def __init__(
        self, source: Source, clock: Callable[[str], Any], start: int, stop: int, level: int,
        match: Callable[[Bytes], Bytes],
    ) -> None:  # fmt: skip
        self.source, self.level = source, level
        self.frames: dict[int, Frame] = {}
        self.guides: dict[int, Bytes] = {}
        self.distances: dict[int, Plane] = {}
        self.regions: dict[int, Bytes] = {}
        self.masks: dict[int, Bytes] = {}
        pictures = source.pictures(start, stop)
        for index in range(start, stop):
            with clock("guides"):
                if (picture := next(pictures, None)) is None:
                    return
                self._add(index, picture, match)

    def _add(self, index: int, picture: Picture, match: Callable[[Bytes], Bytes]) -> None:
        level = self.level
        guide = match(lab_guide(picture.frame))
        guide = guide if picture.further is None else stacked([guide, picture.further])
        self.frames[index], self.guides[index] = _down(picture.frame, level), _down(guide, level)
        if picture.distance is not None:
            self.distances[index] = _shrunk(picture.distance, level)
        if picture.region is not None and picture.mask is not None:
            self.regions[index] = _thinned(picture.region, level)
            self.masks[index] = _thinned(picture.mask, level)

    def target(self, index: int) -> Target:
        guide, params = self.guides[index], self.source.params
        gray = np.ascontiguousarray(guide[..., 0])
        bins = orientation(gray, params.rotation_sigma) if params.rotation == "on" else None
        return Target(guide, bins, self.distances.get(index))


def _down(image: Bytes, level: int) -> Bytes:
    for _ in range(level):
        image = np.asarray(halved(image), np.uint8)
    return image


def _thinned(mask: Mask, level: int) -> Bytes:
    found = mask.astype(np.uint8)
    for _ in range(level):
        found = np.asarray(halved(found, nearest=True), np.uint8)
    return found


def _shrunk(distances: Plane, level: int) -> Plane:
    for _ in range(level):
        distances = np.asarray(halved(distances), np.float32) / np.float32(2)
    return distances


class Shot:
    """`pipeline.synthesis.sweeps.Shot` over decoded frames; motion by their velocities, or by optical flow.

    Args:
        anywhere: a place of the style, for pixels where there is no paint.
    """

    def __init__(self, stills: Stills, clock: Callable[[str], Any], anywhere: tuple[int, int] = (0, 0)) -> None:
        self._stills, self._clock, self._anywhere = stills, clock, anywhere
        self._motions: dict[int, tuple[Motion, Motion]] = {}

    def target(self, index: int) -> Target:
        with self._clock("guides"):
            return self._stills.target(index)

    def motion(self, index: int, other: int) -> Motion:
        first = min(index, other)
        if first not in self._motions:
            with self._clock("flow"):
                self._motions = {first: self._between(first)}
        return self._motions[first][0 if index < other else 1]

    def _between(self, first: int) -> tuple[Motion, Motion]:
        """From frame `first` to the next one, and back."""
        stills, params = self._stills, self._stills.source.params
        epsilon = params.occlusion_epsilon if params.occlusion == "on" else math.inf
        known = stills.source.velocities(first)
        if known is None:
            here, there = (to_gray(stills.frames[k]) for k in (first, first + 1))
            plus = stilled(estimate(here, there, params.flow), here, there)
            minus = stilled(-estimate(there, here, params.flow), there, here)
            plus, minus = self._spread(plus, first), self._spread(minus, first + 1)
        else:
            plus, minus = coarser(known[0], stills.level), coarser(known[1], stills.level)
        forth, back = between(plus, minus, epsilon)
        return self._within(forth, first + 1), self._within(back, first)

    def _spread(self, velocity: Flow, index: int) -> Flow:
        """A layer's velocity beyond its silhouette: benard2013stylizing, section 4."""
        mask = self._stills.masks.get(index)
        if mask is None:
            return velocity
        return extrapolated(velocity, nearest(mask > 0, device(), _SPREAD_PX))

    def _within(self, motion: Motion, other: int) -> Motion:
        """What comes from where there is no paint comes from nowhere."""
        region = self._stills.regions.get(other)
        if region is None:
            return motion
        return Motion(motion.way, motion.visible & fetch_nearest(region, motion.way))

    def given(self, index: int) -> Offsets | None:
        """Where there is no paint there is nothing to find."""
        region = self._stills.regions.get(index)
        if region is None:
            return None
        free = (region > 0)[..., None]
        return np.where(free, NOWHERE, np.asarray(self._anywhere, np.float32)).astype(np.float32)

    def share(self, index: int, forward: bool) -> float:
        return 0.5

    def ribbons(self, index: int) -> Offsets | None:
        return None


def fetch_nearest(image: Bytes, way: Flow) -> Bytes:
    """An image's value at the pixel that each pixel goes to, 0 outside."""
    height, width = image.shape
    x = np.rint(way[..., 0] + np.arange(width, dtype=np.float32)).astype(np.int64)
    y = np.rint(way[..., 1] + np.arange(height, dtype=np.float32)[:, None]).astype(np.int64)
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    return np.where(inside, image[y.clip(0, height - 1), x.clip(0, width - 1)], np.uint8(0))
