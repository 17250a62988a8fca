"""The animation at one level of the pyramid: frames, guides, motion, keyframes."""

from __future__ import annotations

import math
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from copy import copy

import cv2
import numpy as np

from pipeline.compute import device
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.analogy.boil import Boil
from pipeline.methods.analogy.inputs import InputFrame, StylePair, SynthesisInputs
from pipeline.methods.analogy.key_settings import weighted
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.base import Clock
from pipeline.methods.fields import FlowName
from pipeline.perception.flow import estimate
from pipeline.perception.flow.gray import Gray, to_gray
from pipeline.synthesis.atlas import downscaled_offsets
from pipeline.synthesis.distance import extrapolated, nearest
from pipeline.synthesis.images import NOWHERE, Bytes, Offsets, Target, halved, stacked
from pipeline.synthesis.motion import Motion, downscaled_velocity, motions_between, zero_still_velocity
from pipeline.synthesis.orientation import DirectionSources
from pipeline.synthesis.tone_matching import ToneAccumulator, ToneMatch, ToneStatistics, lab_guide

MIN_LEVEL_PX = 24
"""Minimum shorter side of the coarsest level, px: smaller pictures have too little detail to match and no reliable
flow."""
_EXTRAPOLATED_VELOCITY_PX = 600
"""Maximum distance from a silhouette to which velocities are extrapolated, px."""
_PROCESSORS = cv2.getNumberOfCPUs()
"""Number of processors that this process may use."""
_THREADS = max(2, min(8, _PROCESSORS))
"""Number of threads that convert frames, and that estimate motion at full size."""
_AHEAD = max(1, min(4, _PROCESSORS - 1))
"""Number of pairs of frames whose motion is estimated in advance, each on a thread. A GPU paints a frame in a tenth of
the time that one processor needs to estimate the motion."""


def levels_of(params: AnalogyParams, size: tuple[int, int], style_px: int) -> int:
    """Number of pyramid levels for a frame size and a style of `style_px` px on its shorter side."""
    fits = int(math.log2(max(1, min(*size, style_px) / MIN_LEVEL_PX)))
    return max(1, min(params.levels, fits + 1))


def tone_match(params: AnalogyParams, pair: StylePair, tones: ToneStatistics) -> ToneMatch | None:
    """The function that maps a guide of the video to the tones of the style; None if matching is off."""
    if params.tone_match == "off" or (params.tone_match == "auto" and not pair.derived):
        return None
    return ToneMatch(tones, style_tones(pair), params.tone_limit)


def style_tones(pair: StylePair) -> ToneStatistics:
    """Tone statistics of the usable pixels of a style."""
    accumulator = ToneAccumulator()
    accumulator.add(pair.guide, None if pair.usable is None else pair.usable > 0)
    return accumulator.statistics()


class LevelFrames:
    """Frames [start, stop) of the inputs, reduced to a level, with their guides.

    Attributes:
        frames: uint8 (h, w, 3), by frame number.
        guides: CIELAB and extra guides, uint8 (h, w, channels).
        line_distances: float32 (h, w), distance to the nearest line, px of the level; empty without lines.
        paintable: uint8 (h, w), 1 = the pixel may be painted; empty if the layer covers the frame.
        silhouettes: uint8 (h, w), 1 = pixel of the layer; empty if the layer covers the frame.
        directions: given directions, see `authored_tensors`; empty if none are given.

    Args:
        level: 0 = full size; each level halves it.
        match: maps the CIELAB guide to the tones of the style; None = it stays as it is.
    """

    def __init__(
        self, inputs: SynthesisInputs, clock: Clock, start: int, stop: int, level: int,
        match: ToneMatch | None = None,
    ) -> None:  # fmt: skip
        self.inputs, self.level = inputs, level
        self.frames: dict[int, Frame] = {}
        self.guides: dict[int, Bytes] = {}
        self.line_distances: dict[int, Plane] = {}
        self.paintable: dict[int, Bytes] = {}
        self.silhouettes: dict[int, Bytes] = {}
        self.directions: dict[int, Plane] = {}
        frames, pending = inputs.frames(start, stop), deque[tuple[int, InputFrame, Future[tuple[Frame, Bytes]]]]()
        with clock("guides"), ThreadPoolExecutor(_THREADS, "impasto-guides") as threads:
            for index in range(start, stop):
                if (frame := next(frames, None)) is None:
                    break
                pending.append((index, frame, threads.submit(_downscaled_guides, frame, match, level)))
                if len(pending) > _THREADS:
                    self._add(*pending.popleft())
            for each in pending:
                self._add(*each)

    def halved(self) -> LevelFrames:
        """The same frames at the next coarser level."""
        coarse = copy(self)
        coarse.level += 1
        coarse.frames = {index: _downscaled(frame, 1) for index, frame in self.frames.items()}
        coarse.guides = {index: _downscaled(guide, 1) for index, guide in self.guides.items()}
        coarse.line_distances = {index: _downscaled_distances(px, 1) for index, px in self.line_distances.items()}
        coarse.directions = {index: _downscaled_plane(plane, 1) for index, plane in self.directions.items()}
        coarse.paintable = {index: _downscaled_mask(mask, 1) for index, mask in self.paintable.items()}
        coarse.silhouettes = {index: _downscaled_mask(mask, 1) for index, mask in self.silhouettes.items()}
        return coarse

    def _add(self, index: int, frame: InputFrame, downscaled: Future[tuple[Frame, Bytes]]) -> None:
        level = self.level
        self.frames[index], self.guides[index] = downscaled.result()
        if frame.line_distance is not None:
            self.line_distances[index] = _downscaled_distances(frame.line_distance, level)
        if frame.directions is not None:
            self.directions[index] = _downscaled_plane(frame.directions, level)
        if frame.paintable is not None and frame.silhouette is not None:
            self.paintable[index] = _downscaled_mask(frame.paintable, level)
            self.silhouettes[index] = _downscaled_mask(frame.silhouette, level)

    def target(self, index: int) -> Target:
        """Frame `index` as the target of the synthesis."""
        guide, lines = self.guides[index], self.line_distances.get(index)
        return Target(guide, self.directions_of(index) if self.inputs.rotates else None, lines)

    def directions_of(self, index: int) -> Bytes:
        """Directions of frame `index`, uint8 (h, w), see `DirectionSources.bins`."""
        gray = np.ascontiguousarray(self.guides[index][..., 0])
        sources = DirectionSources(gray, self.line_distances.get(index), self.directions.get(index))
        return direction_bins_of(sources, self.inputs.params, self.level)


def direction_bins_of(sources: DirectionSources, params: AnalogyParams, level: int) -> Bytes:
    """Directions of a frame or a style at a level, uint8 (h, w)."""
    return sources.bins(params.rotation_sigma, params.lines_reach * 0.5**level)


def _downscaled_guides(frame: InputFrame, match: ToneMatch | None, level: int) -> tuple[Frame, Bytes]:
    """The picture and the guides of a frame at a level."""
    guide = lab_guide(frame.frame)
    guide = guide if match is None else match(guide)
    guide = guide if frame.guides is None else stacked([guide, frame.guides])
    return _downscaled(frame.frame, level), _downscaled(guide, level)


def _downscaled(image: Bytes, level: int) -> Bytes:
    for _ in range(level):
        image = np.asarray(halved(image), np.uint8)
    return image


def _downscaled_mask(mask: Mask | Bytes, level: int) -> Bytes:
    downscaled = mask.astype(np.uint8)
    for _ in range(level):
        downscaled = np.asarray(halved(downscaled, nearest=True), np.uint8)
    return downscaled


def _downscaled_plane(plane: Plane, level: int) -> Plane:
    for _ in range(level):
        plane = np.asarray(halved(plane), np.float32)
    return plane


def _downscaled_distances(distances: Plane, level: int) -> Plane:
    """Distances in px of the level: they halve with each level."""
    return _downscaled_plane(distances, level) * np.float32(0.5**level)


class EstimatedVelocities:
    """Optical flow at full size, once for all levels, estimated on threads while the caller does other work.

    Nothing is estimated if the inputs have velocities, or if frames are independent.

    Attributes:
        firsts: the first frame of each pair that is estimated.
        threads: run the estimates in order, and then what callers submit.
    """

    def __init__(self, full_size: LevelFrames) -> None:
        self.threads = ThreadPoolExecutor(_THREADS, "impasto-flow")
        firsts = sorted(full_size.frames)[:-1]
        independent = full_size.inputs.params.temporal == "off"
        given = bool(firsts) and not independent and full_size.inputs.velocities(firsts[0]) is not None
        self.firsts = [] if given or independent else firsts
        gray = {index: to_gray(frame) for index, frame in full_size.frames.items()} if self.firsts else {}
        flow = full_size.inputs.params.flow
        self._pairs = {
            first: self.threads.submit(_estimated, gray[first], gray[first + 1], flow) for first in self.firsts
        }

    def get(self, first: int) -> tuple[Flow, Flow] | None:
        """(V+ of frame `first`, V- of the next), px, as soon as it is estimated; None if it is not estimated."""
        pair = self._pairs.get(first)
        return None if pair is None else pair.result()


def _estimated(first: Gray, second: Gray, flow: FlowName) -> tuple[Flow, Flow]:
    """(V+ of the first frame, V- of the second), px."""
    plus = zero_still_velocity(estimate(first, second, flow), first, second)
    return plus, zero_still_velocity(-estimate(second, first, flow), second, first)


class LevelAnimation:
    """The `pipeline.synthesis.sweeps.Animation` of decoded frames. Motion: given velocities, or optical flow.

    While the device works on a frame, threads estimate the motion of the next pairs of frames of the sweep.

    Args:
        usable_position: a usable position (x, y) of the style, assigned to pixels that may not be painted.
        velocities: estimated at full size; pairs of frames that it lacks are estimated at this level.
        boil: seeded removal of temporal coherence; see `Boil`.
        continues: whether each frame continues its neighbour, instead of merging it with its own previous result.
    """

    def __init__(
        self, level_frames: LevelFrames, clock: Clock, usable_position: tuple[int, int] = (0, 0),
        velocities: EstimatedVelocities | None = None, boil: Boil | None = None, continues: bool = False,
    ) -> None:  # fmt: skip
        self._continues, self._estimates = continues, False
        self._frames, self._clock, self._usable_position = level_frames, clock, usable_position
        self._velocities, self._boil = velocities, boil
        self._motions: dict[int, tuple[Motion, Motion]] = {}
        self._next: dict[int, Future[tuple[Motion, Motion]]] = {}
        """Motion that a thread estimates: first frame of the pair -> future."""

    def target(self, index: int) -> Target:
        with self._clock("guides"):
            return self._frames.target(index)

    def motion(self, index: int, other: int) -> Motion:
        first = min(index, other)
        if first not in self._motions:
            with self._clock("flow"):
                self._motions = {first: self._requested(first)}
            self._request([first + ahead * (index - other) for ahead in range(1, _AHEAD + 1)])
        return self._motions[first][0 if index < other else 1]

    def _requested(self, first: int) -> tuple[Motion, Motion]:
        """Motion between frame `first` and the next frame, from the thread that estimates it if there is one."""
        requested = self._next.pop(first, None)
        return self._between(first) if requested is None else requested.result()

    def _request(self, firsts: list[int]) -> None:
        """Let threads estimate the motion between each of these frames and its next frame, unless it is given.

        Layers are left out: their velocities are extrapolated on the device, which one thread uses.
        """
        frames = self._frames.frames
        if not self._estimates or self._frames.silhouettes:
            return
        self._next = {first: motion for first, motion in self._next.items() if first in firsts}
        for first in firsts:
            if first not in self._next and first in frames and first + 1 in frames:
                threads = ThreadPoolExecutor(1, "impasto-flow")
                self._next[first] = threads.submit(self._between, first)
                threads.shutdown(wait=False)

    def _between(self, first: int) -> tuple[Motion, Motion]:
        """Motion from frame `first` to the next frame, and back."""
        level_frames, params = self._frames, self._frames.inputs.params
        epsilon = params.occlusion_epsilon if params.occlusion == "on" else math.inf
        level, given = level_frames.level, level_frames.inputs.velocities(first)
        self._estimates = given is None
        full_size = given or (self._velocities.get(first) if self._velocities else None)
        gray = None if given is not None else self._gray(first)
        if full_size is None:
            assert gray is not None
            plus, minus = _estimated(*gray, params.flow)
        else:
            plus, minus = (downscaled_velocity(velocity, level) for velocity in full_size)
            epsilon *= 0.25**level
        if given is None:
            plus, minus = self._extrapolated(plus, first), self._extrapolated(minus, first + 1)
        forth, back = motions_between(plus, minus, epsilon, gray)
        return (
            self._with_boil(self._within_paintable(forth, first + 1), first),
            self._with_boil(self._within_paintable(back, first), first),
        )

    def _gray(self, first: int) -> tuple[Gray, Gray]:
        """Frames `first` and `first` + 1 in gray."""
        frames = self._frames.frames
        return to_gray(frames[first]), to_gray(frames[first + 1])

    def _with_boil(self, motion: Motion, first: int) -> Motion:
        """Mark the blocks that boil as not visible in the neighbouring frame."""
        if self._boil is None:
            return motion
        return Motion(motion.displacement, motion.visible & self._boil.coherent(first, motion.visible.shape))

    def _extrapolated(self, velocity: Flow, index: int) -> Flow:
        """Extrapolate a layer's velocity beyond its silhouette (benard2013stylizing, section 4)."""
        silhouette = self._frames.silhouettes.get(index)
        if silhouette is None:
            return velocity
        return extrapolated(velocity, nearest(silhouette > 0, device(), _EXTRAPOLATED_VELOCITY_PX))

    def _within_paintable(self, motion: Motion, other: int) -> Motion:
        """Mark pixels as not visible in the other frame if they may not be painted there."""
        paintable = self._frames.paintable.get(other)
        if paintable is None:
            return motion
        return Motion(motion.displacement, motion.visible & warp_nearest(paintable, motion.displacement))

    def fixed_offsets(self, index: int) -> Offsets | None:
        """Fixed offsets for pixels that may not be painted."""
        paintable = self._frames.paintable.get(index)
        if paintable is None:
            return None
        free = (paintable > 0)[..., None]
        return np.where(free, NOWHERE, np.asarray(self._usable_position, np.float32)).astype(np.float32)

    def merge_probability(self, index: int, forward: bool) -> float | Plane:
        return 1.0 if self._continues else 0.5

    def ribbons(self, index: int) -> Offsets | None:
        return None


class KeyframeAnimation(LevelAnimation):
    """The frames of an interval at one level, with their keyframes.

    Attributes:
        full: frame numbers of the keyframes that are painted everywhere.
        ribbon_offsets: frame number -> offsets of each pixel in the previous and the next keyframe, float32
            (2, h, w, 2).

    The motion of all pairs of frames is computed on the threads of `velocities`, while the device works on coarser
    levels. Layers are left out, see `LevelAnimation`.

    Args:
        painted: frame number -> offsets of its painted pixels, at the finest level.
        velocities: estimated at full size.
        weights: of the keyframes before and after a frame.
    """

    def __init__(
        self, level_frames: LevelFrames, clock: Clock, usable_position: tuple[int, int],
        painted: dict[int, Offsets], velocities: EstimatedVelocities, weights: tuple[float, float] = (1.0, 1.0),
        boil: Boil | None = None,
    ) -> None:  # fmt: skip
        super().__init__(level_frames, clock, usable_position, velocities, boil)
        self._painted, self._level, self._weights = painted, level_frames.level, weights
        self.full = {i for i, offsets in painted.items() if (offsets[..., 0] > NOWHERE).all()}
        self.ribbon_offsets: dict[int, Offsets] = {}
        firsts = [] if level_frames.silhouettes else velocities.firsts
        self._submitted = {first: velocities.threads.submit(self._between, first) for first in firsts}
        self._all_motions: dict[int, tuple[Motion, Motion]] = {}

    def motion(self, index: int, other: int) -> Motion:
        first = min(index, other)
        if first not in self._all_motions:
            submitted = self._submitted.pop(first, None)
            with self._clock("flow"):
                self._all_motions[first] = self._between(first) if submitted is None else submitted.result()
        return self._all_motions[first][0 if index < other else 1]

    def fixed_offsets(self, index: int) -> Offsets | None:
        outside = super().fixed_offsets(index)
        if index not in self._painted:
            return outside
        painted = downscaled_offsets(self._painted[index], self._level)
        return painted if outside is None else np.where(painted > NOWHERE, painted, outside)

    def merge_probability(self, index: int, forward: bool) -> float | Plane:
        """Probability of the neighbour's offset in the random merge (section 4.1): biased towards the nearer key, at
        pixels that both keys paint."""
        last = max((i for i in self._painted if i <= index), default=None)
        following = min((i for i in self._painted if i >= index), default=None)
        if last is None or following is None or last == following:
            return 0.5
        before, after = self._weights
        from_last = weighted((following - index) / (following - last), after, before)
        bias = from_last if forward else 1 - from_last
        if {last, following} <= self.full:
            return bias
        both = (self.ribbon_offsets[index][..., 0] > NOWHERE).all(0)
        return np.where(both, bias, 0.5).astype(np.float32)

    def ribbons(self, index: int) -> Offsets | None:
        return self.ribbon_offsets.get(index)


def warp_nearest(image: Bytes, displacement: Flow) -> Bytes:
    """Nearest-neighbour warp: the image at p + displacement(p), 0 outside. uint8 (h, w)."""
    height, width = image.shape
    x = np.rint(displacement[..., 0] + np.arange(width, dtype=np.float32)).astype(np.int64)
    y = np.rint(displacement[..., 1] + np.arange(height, dtype=np.float32)[:, None]).astype(np.int64)
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    return np.where(inside, image[y.clip(0, height - 1), x.clip(0, width - 1)], np.uint8(0))
