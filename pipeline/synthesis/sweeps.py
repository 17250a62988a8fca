"""Synthesis of an animation at one pyramid level by sweeps forward and backward through time.

Section 3.3 of benard2013stylizing: a sweep visits its frames in order. Each frame is initialised by a random merge of
its previous result (of the sweep before, or of the coarser level) and the neighbouring frame's offsets, advected along
the motion. It is then refined; the temporal terms keep it coherent with the neighbour.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Generic, Protocol

import numpy as np

from pipeline.frames import Plane
from pipeline.perception.flow.warp import warp_back
from pipeline.synthesis.energy import Energy
from pipeline.synthesis.images import NOWHERE, Offsets, Target
from pipeline.synthesis.motion import Motion
from pipeline.synthesis.operations import FrameState, LoadedStyle, Operations, RandomKey, T
from pipeline.synthesis.refine import Rounds, refine


class Animation(Protocol):
    """The animation at one level. A sweep requests each frame about once, in the order of the sweep."""

    def target(self, index: int) -> Target:
        """Frame `index` as the target of the synthesis."""
        ...

    def motion(self, index: int, other: int) -> Motion:
        """Motion from frame `index` to its neighbour `other` (index - 1 or index + 1)."""
        ...

    def fixed_offsets(self, index: int) -> Offsets | None:
        """Fixed offsets of painted pixels, float32 (h, w, 2), NOWHERE elsewhere; None = no pixel is painted."""
        ...

    def merge_probability(self, index: int, forward: bool) -> float | Plane:
        """Probability, 0..1, with which the random merge takes the neighbour's offset; float32 (h, w) = of each
        pixel."""
        ...

    def ribbons(self, index: int) -> Offsets | None:
        """Each pixel's positions in the previous and the next keyframe, as offsets, float32 (2, h, w, 2)."""
        ...


@dataclass(frozen=True)
class FirstFrame:
    """Effort for the first frame of a shot.

    Attributes:
        iterations: rounds of PatchMatch.
        search_px: radius of the random search, px.
        full_rounds: number of rounds whose random search visits every pixel, see `Rounds`.
        near: whether offsets propagate from direct neighbours only, see `Rounds`.
    """

    iterations: int
    search_px: float
    full_rounds: int
    near: bool = False


@dataclass(frozen=True)
class SearchSchedule:
    """Effort of the search: rounds of PatchMatch per frame, radius of the random search (px), and random seed.

    Attributes:
        settles: whether iterations skip pixels around which nothing changes, see `Rounds`.
        votes: whether candidates are compared with the mean of overlapping patches, see `Rounds`.
        every: whether the random search runs in every round, see `Rounds`.
        first: effort for the first frame of a shot, which continues no other frame; None = the same as for the other
            frames. If it is given, the other frames take offsets from direct neighbours only.
    """

    iterations: int = 4
    search_px: float = 32.0
    seed: int = 0
    stream: int = 0
    """Random stream of the level and sweep; `key` adds the frame number in the low 20 bits."""
    first: FirstFrame | None = None
    settles: bool = False
    votes: bool = False
    every: bool = False

    def rounds(self, continued: bool) -> Rounds:
        """Rounds of a frame.

        Args:
            continued: whether the frame continues another frame of its shot.
        """
        rounds = Rounds(self.iterations, self.search_px, self.settles, votes=self.votes, every=self.every)
        if self.first is None:
            return rounds
        if continued:
            return replace(rounds, near=True)
        first = self.first
        return replace(
            rounds, count=first.iterations, search_px=first.search_px, full_rounds=first.full_rounds, near=first.near
        )

    def key(self, index: int) -> RandomKey:
        """Random key of frame `index`."""
        return self.seed, ((self.stream << 20) | (index & 0xFFFFF)) & 0xFFFFFFFF


@dataclass
class SolvedFrame(Generic[T]):
    """A finished frame: the data that the next frame of the sweep needs."""

    index: int
    state: FrameState[T]
    offsets: T


@dataclass
class Sweep(Generic[T]):
    """One pass over frames of one level.

    Args:
        style: the style at this level.
        previous: returns the previous result of a frame: offsets of the sweep before or of the coarser level; None =
            there is none.
        schedule: effort of the search.
        forward: direction in time.
        keep_first: whether to keep the previous offsets of the first frame, because the sweep before ended with it.
        last: neighbour of the first frame: the last frame of the run before this one; None = there is no such run.
        energy: the energy function of each frame, if they differ in weights; None = that of the style.
    """

    ops: Operations[T]
    style: LoadedStyle[T]
    animation: Animation
    previous: Callable[[int, FrameState[T]], T | None]
    schedule: SearchSchedule
    forward: bool
    keep_first: bool = False
    last: SolvedFrame[T] | None = None
    energy: Callable[[int], Energy] | None = None

    def run(self, frames: Iterable[int]) -> Iterator[SolvedFrame[T]]:
        """Solve frames in the given order; yields each as soon as all its work is submitted.

        The next frame is prepared meanwhile, while the device works.
        """
        rest = iter(frames)
        index = next(rest, None)
        state = None if index is None else self._prepared(index)
        while index is not None and state is not None:
            self.last = SolvedFrame(index, state, self._solve(index, state))
            solved, index = self.last, next(rest, None)
            state = None if index is None else self._prepared(index)
            yield solved

    def _prepared(self, index: int) -> FrameState[T]:
        return self.ops.prepare(self.style, self.animation.target(index))

    def _solve(self, index: int, state: FrameState[T]) -> T:
        """Offsets of frame `index`."""
        if self.energy is not None:
            self.style = replace(self.style, energy=self.energy(index))
        painted = self.animation.fixed_offsets(index)
        fixed = None if painted is None else self.ops.upload(painted)
        previous = self.previous(index, state)
        if self.last is None and self.keep_first and previous is not None:
            return previous if fixed is None else self._with_fixed(state, fixed, previous)
        advected = self._advected(index, state)
        start = self._merged(index, state, previous, advected)
        if fixed is not None:
            state.fixed = fixed
            start = self._with_fixed(state, fixed, start)
        if painted is not None and (painted[..., 0] > NOWHERE).all():
            return start
        self._add_temporal_terms(index, state, advected)
        rounds = self.schedule.rounds(continued=self.last is not None)
        return refine(self.ops, self.style, state, start, self.schedule.key(index), rounds)

    def _with_fixed(self, state: FrameState[T], fixed: T, offsets: T) -> T:
        return self.ops.apply_fixed(self.style, state.size, fixed, offsets)

    def _advected(self, index: int, state: FrameState[T]) -> T | None:
        """Offsets of the neighbouring frame, advected to this one; None = this is the first frame."""
        if self.last is None:
            return None
        motion, neighbour = self.animation.motion(index, self.last.index), self.last
        displacement, visible = self.ops.upload(motion.displacement), self.ops.upload(motion.visible)
        return self.ops.advect(self.style, state, neighbour.offsets, neighbour.state.bins, displacement, visible)

    def _merged(self, index: int, state: FrameState[T], previous: T | None, advected: T | None) -> T:
        """Initial offsets (section 3.3): random merge of advected and previous offsets; random ones without either."""
        key = self.schedule.key(index)
        if previous is None and advected is None:
            return self.ops.random_offsets(self.style, state.size, key)
        if previous is None or advected is None:
            only = advected if previous is None else previous
            assert only is not None
            return self.ops.merge(self.style, state.size, only, only, 1.0, key)
        probability = self.animation.merge_probability(index, self.forward)
        return self.ops.merge(self.style, state.size, advected, previous, probability, key)

    def _add_temporal_terms(self, index: int, state: FrameState[T], advected: T | None) -> None:
        """Store in `state` the advected data that the temporal terms compare with."""
        energy = self.style.energy
        if advected is not None and energy.w_tc > 0:
            state.advected = advected
            state.advected_colours = self.ops.colours_at(self.style, state.size, advected)
        if advected is not None and energy.has_change_terms:
            self._add_change(index, state, advected)
        ribbons = self.animation.ribbons(index)
        if ribbons is not None:
            state.ribbons = self.ops.upload(ribbons)

    def _add_change(self, index: int, state: FrameState[T], advected: T) -> None:
        """Add the change since the neighbouring frame (eq. 10) to the guides of the frame.

        Departure: C_t-1 of eq. 10 is the advected offset of each tap's own pixel, not that of the patch's centre,
        extrapolated. The sum is then the same for all patches that contain the tap, and the term of the output equals
        that of eq. 4, because the neighbour's picture consists of the style's colours at its offsets.
        """
        assert self.last is not None
        motion = self.animation.motion(index, self.last.index)
        guides = warp_back(self.animation.target(self.last.index).guides, motion.displacement)
        warped = np.asarray(guides[..., None] if guides.ndim == 2 else guides, np.uint8)
        self.ops.add_change(self.style, state, advected, warped, self.ops.upload(motion.visible))


def order(start: int, stop: int, forward: bool) -> range:
    """The frame numbers [start, stop) in the order of a sweep."""
    return range(start, stop) if forward else range(stop - 1, start - 1, -1)
