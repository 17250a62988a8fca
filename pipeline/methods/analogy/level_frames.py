"""Frames, guides and motion of a source at one level of the pyramid."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.compute import device
from pipeline.flow import estimate
from pipeline.flow.gray import Gray, to_gray
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.sources import Source, SourceFrame, StylePair
from pipeline.methods.fields import FlowName
from pipeline.synthesis.distance import extrapolated, nearest
from pipeline.synthesis.images import NOWHERE, Bytes, Offsets, Target, halved, stacked
from pipeline.synthesis.motion import Motion, downscaled_velocity, motions_between, suppress_small_motion
from pipeline.synthesis.orientation import orientation
from pipeline.synthesis.tone_matching import ToneMatch, ToneStatistics, lab_guide, tone_statistics

SMALLEST_PX = 24
"""Minimum shorter side of the coarsest level, px: smaller pictures have nothing to match and no reliable flow."""
_SPREAD_PX = 600
_BOIL_BLOCK_PX = 32
_MOST_BLOCKS = 256
"""Blocks along a side: frames of up to 8192 px."""


def levels_of(params: AnalogyParams, size: tuple[int, int], style_px: int) -> int:
    """Number of pyramid levels for a frame size and a style of `style_px` px on its shorter side."""
    fits = int(math.log2(max(1, min(*size, style_px) / SMALLEST_PX)))
    return max(1, min(params.levels, fits + 1))


def matching(params: AnalogyParams, pair: StylePair, tones: ToneStatistics) -> Callable[[Bytes], Bytes]:
    """The function that maps a guide of the video to the tones of the style; the identity if matching is off."""
    if params.tone_match == "off" or (params.tone_match == "auto" and not pair.derived):
        return lambda guide: guide
    return ToneMatch(tones, tone_statistics([pair.guide]))


class LevelFrames:
    """Frames [start, stop) of a source, scaled down to a level, with their guides.

    Args:
        match: maps a guide to the tones of the style.
        level: 0 = full size; each level halves it.
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

    def _add(self, index: int, picture: SourceFrame, match: Callable[[Bytes], Bytes]) -> None:
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


def estimated_velocities(
    source: Source, clock: Callable[[str], Any], start: int, stop: int
) -> dict[int, tuple[Flow, Flow]]:
    """Optical flow at full size, once for all levels: frame number -> (V+ of the frame, V- of the next), px.

    Empty where the velocities of the source are known.
    """
    if stop - start < 2 or source.velocities(start) is not None:
        return {}
    found: dict[int, tuple[Flow, Flow]] = {}
    before: Gray | None = None
    for index, picture in zip(range(start, stop), source.pictures(start, stop), strict=False):
        now = to_gray(picture.frame)
        if before is not None:
            with clock("flow"):
                found[index - 1] = _estimated(before, now, source.params.flow)
        before = now
    return found


def _estimated(here: Gray, there: Gray, flow: FlowName) -> tuple[Flow, Flow]:
    """(V+ of the first frame, V- of the second), px."""
    plus = suppress_small_motion(estimate(here, there, flow), here, there)
    return plus, suppress_small_motion(-estimate(there, here, flow), there, here)


@dataclass(frozen=True)
class Boil:
    """Deliberate flicker: a share of the picture starts afresh in each frame, in blocks.

    Args:
        share: 0..1.
        level: 0 = full size.
    """

    share: float
    seed: int
    level: int

    def held(self, first: int, size: tuple[int, ...]) -> Bytes:
        """1 where frames `first` and `first` + 1 stay coherent, uint8 (h, w). The same blocks at every level."""
        block = max(1, _BOIL_BLOCK_PX >> self.level)
        height, width = size[:2]
        shape = (-(-height // block), -(-width // block))
        draws = np.random.Generator(np.random.Philox(key=[self.seed, first])).random((_MOST_BLOCKS, _MOST_BLOCKS))
        kept = (draws >= self.share).astype(np.uint8)[: shape[0], : shape[1]]
        return np.ascontiguousarray(kept.repeat(block, 0).repeat(block, 1)[:height, :width])


class LevelAnimation:
    """The `pipeline.synthesis.sweeps.Animation` of decoded frames. Motion: given velocities, or optical flow.

    Args:
        anywhere: a valid place of the style, assigned to pixels where no paint is possible.
        velocities: as `estimated_velocities` returns them; frames that it lacks are estimated at this level.
        boil: seeded removal of temporal coherence; see `Boil`.
    """

    def __init__(
        self, level_frames: LevelFrames, clock: Callable[[str], Any], anywhere: tuple[int, int] = (0, 0),
        velocities: Mapping[int, tuple[Flow, Flow]] | None = None, boil: Boil | None = None,
    ) -> None:  # fmt: skip
        self._stills, self._clock, self._anywhere = level_frames, clock, anywhere
        self._velocities, self._boil = velocities or {}, boil
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
        """Motion from frame `first` to the next frame, and back."""
        level_frames, params = self._stills, self._stills.source.params
        epsilon = params.occlusion_epsilon if params.occlusion == "on" else math.inf
        level, full_size = level_frames.level, level_frames.source.velocities(first) or self._velocities.get(first)
        if full_size is None:
            here, there = (to_gray(level_frames.frames[k]) for k in (first, first + 1))
            plus, minus = _estimated(here, there, params.flow)
        else:
            plus, minus = (downscaled_velocity(velocity, level) for velocity in full_size)
            epsilon *= 0.25**level
        if level_frames.source.velocities(first) is None:
            plus, minus = self._spread(plus, first), self._spread(minus, first + 1)
        forth, back = motions_between(plus, minus, epsilon)
        return self._held(self._within(forth, first + 1), first), self._held(self._within(back, first), first)

    def _held(self, motion: Motion, first: int) -> Motion:
        """Release the parts of the picture that boil from their neighbours in time."""
        if self._boil is None:
            return motion
        return Motion(motion.displacement, motion.visible & self._boil.held(first, motion.visible.shape))

    def _spread(self, velocity: Flow, index: int) -> Flow:
        """Extrapolate a layer's velocity beyond its silhouette (benard2013stylizing, section 4)."""
        mask = self._stills.masks.get(index)
        if mask is None:
            return velocity
        return extrapolated(velocity, nearest(mask > 0, device(), _SPREAD_PX))

    def _within(self, motion: Motion, other: int) -> Motion:
        """Mark pixels as not visible in the other frame where no paint is possible there."""
        region = self._stills.regions.get(other)
        if region is None:
            return motion
        return Motion(motion.displacement, motion.visible & fetch_nearest(region, motion.displacement))

    def fixed_offsets(self, index: int) -> Offsets | None:
        """Fixed offsets for pixels where no paint is possible."""
        region = self._stills.regions.get(index)
        if region is None:
            return None
        free = (region > 0)[..., None]
        return np.where(free, NOWHERE, np.asarray(self._anywhere, np.float32)).astype(np.float32)

    def share(self, index: int, forward: bool) -> float:
        return 0.5

    def ribbons(self, index: int) -> Offsets | None:
        return None


def fetch_nearest(image: Bytes, displacement: Flow) -> Bytes:
    """Nearest-neighbour warp: the image at p + displacement(p), 0 outside. uint8 (h, w)."""
    height, width = image.shape
    x = np.rint(displacement[..., 0] + np.arange(width, dtype=np.float32)).astype(np.int64)
    y = np.rint(displacement[..., 1] + np.arange(height, dtype=np.float32)[:, None]).astype(np.int64)
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    return np.where(inside, image[y.clip(0, height - 1), x.clip(0, width - 1)], np.uint8(0))
