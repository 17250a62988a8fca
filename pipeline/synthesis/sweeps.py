"""An animation at one level: forward through time, then backward, each frame beginning with what its neighbour found.

Section 3.3 of benard2013stylizing: a sweep visits its frames in order; each is initialised by a random merge of what is
known of it already (the sweep before, or the coarser level) with its neighbour's offsets, carried along the motion;
then it is refined, held to the neighbour by the temporal terms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Generic, Protocol

import numpy as np

from pipeline.flow.warp import fetch
from pipeline.synthesis.engine import refine
from pipeline.synthesis.images import NOWHERE, Offsets, Target
from pipeline.synthesis.motion import Motion
from pipeline.synthesis.operations import Key, Loaded, Operations, Past, Sitting, T


class Shot(Protocol):
    """The animation at one level, as a sweep asks for it: each frame about once, in the sweep's order."""

    def target(self, index: int) -> Target: ...
    def motion(self, index: int, other: int) -> Motion:
        """From frame `index` to frame `other` = index - 1 or index + 1."""
        ...

    def given(self, index: int) -> Offsets | None:
        """Offsets of painted pixels, NOWHERE elsewhere; None = the frame is not painted on."""
        ...

    def share(self, index: int, forward: bool) -> float:
        """How much of the merge comes from the neighbour in time."""
        ...

    def ribbons(self, index: int) -> Offsets | None:
        """float32 (2, h, w, 2): each pixel's place in the last and in the next key, as offsets."""
        ...


@dataclass(frozen=True)
class Rounds:
    """How hard to look."""

    iterations: int = 4
    search_px: float = 32.0
    seed: int = 0
    stream: int = 0
    """Level and sweep; the frame's number is added in the low 20 bits."""

    def key(self, index: int) -> Key:
        return self.seed, ((self.stream << 20) | (index & 0xFFFFF)) & 0xFFFFFFFF


@dataclass
class Seated(Generic[T]):
    """A finished frame, as its neighbour needs it."""

    index: int
    sitting: Sitting[T]
    offsets: T


@dataclass
class Sweep(Generic[T]):
    """One pass over frames of one level.

    Args:
        style: the style at this level.
        known: what is known of a frame already: offsets of the sweep before or of the coarser level; None = nothing.
        keep_first: the first frame visited is done already (it ended the sweep before).
    """

    ops: Operations[T]
    style: Loaded[T]
    shot: Shot
    known: Callable[[int, Sitting[T]], T | None]
    rounds: Rounds
    forward: bool
    keep_first: bool = False
    last: Seated[T] | None = None
    """The neighbour to begin with: the frame visited last by the run before this one."""
    tick: Callable[[], None] = field(default=lambda: None)

    def run(self, frames: Iterable[int]) -> Iterator[Seated[T]]:
        """Visit frames in the sweep's order and yield each when it is done."""
        for index in frames:
            self.tick()
            sitting = self.ops.seat(self.style, self.shot.target(index))
            offsets = self._visit(index, sitting)
            self.last = Seated(index, sitting, offsets)
            yield self.last

    def _visit(self, index: int, sitting: Sitting[T]) -> T:
        given = self.shot.given(index)
        fixed = None if given is None else self.ops.upload(given)
        known = self.known(index, sitting)
        if self.last is None and self.keep_first and known is not None:
            return known if fixed is None else self._impose(sitting, fixed, known)
        advected = self._advected(index, sitting)
        start = self._merged(index, sitting, known, advected)
        if fixed is not None:
            sitting.given = fixed
            start = self._impose(sitting, fixed, start)
        if given is not None and (given[..., 0] > NOWHERE).all():
            return start
        self._remember(index, sitting, advected)
        rounds, key = self.rounds, self.rounds.key(index)
        return refine(self.ops, self.style, sitting, start, key, rounds.iterations, rounds.search_px)

    def _impose(self, sitting: Sitting[T], fixed: T, offsets: T) -> T:
        return self.ops.impose(self.style, sitting.size, fixed, offsets)

    def _advected(self, index: int, sitting: Sitting[T]) -> T | None:
        if self.last is None:
            return None
        motion, there = self.shot.motion(index, self.last.index), self.last
        way, visible = self.ops.upload(motion.way), self.ops.upload(motion.visible)
        return self.ops.advect(self.style, sitting, there.offsets, there.sitting.bins, way, visible)

    def _merged(self, index: int, sitting: Sitting[T], known: T | None, advected: T | None) -> T:
        """Section 3.3: advected or known, at random; anywhere where there is neither."""
        key = self.rounds.key(index)
        if known is None and advected is None:
            return self.ops.scatter(self.style, sitting.size, key)
        if known is None or advected is None:
            only = advected if known is None else known
            assert only is not None
            return self.ops.merge(self.style, sitting.size, only, only, 1.0, key)
        share = self.shot.share(index, self.forward)
        return self.ops.merge(self.style, sitting.size, advected, known, share, key)

    def _remember(self, index: int, sitting: Sitting[T], advected: T | None) -> None:
        """What the temporal terms compare with."""
        goal = self.style.goal
        if advected is not None and (goal.w_tc > 0 or goal.keyed):
            sitting.was = advected
        if advected is not None and goal.w_tc > 0:
            sitting.before = self.ops.recall(self.style, sitting.size, advected)
        if advected is not None and goal.keyed:
            sitting.past = self._past(index, advected)
        ribbons = self.shot.ribbons(index)
        if ribbons is not None:
            sitting.ribbons = self.ops.upload(ribbons)

    def _past(self, index: int, advected: T) -> Past[T]:
        """The neighbour's colours and guides as seen from here: what eq. 10 takes the change from."""
        assert self.last is not None
        motion = self.shot.motion(index, self.last.index)
        guides = fetch(self.shot.target(self.last.index).guides, motion.way)
        seen = guides[..., None] if guides.ndim == 2 else guides
        then = self.ops.seat(self.style, Target(np.asarray(seen, np.uint8)))
        then.bins = self.last.sitting.bins
        self.ops.render(self.style, then, advected)
        return Past(then.packed, self.ops.margined(motion.visible, self.style.goal.radius))


def carried_ribbons(
    ops: Operations[T], style: Loaded[T], shot: Shot, frames: Iterable[int], start: Offsets
) -> Iterator[tuple[int, Offsets]]:
    """A key's pixels followed from frame to frame: for each pixel, its place in the key, as an offset.

    Args:
        frames: in order, away from the key, which is the first.
        start: the key's own offsets.

    Section 4.1 of benard2013stylizing: ribbons. Places are moved, not turned: they are points, not patches.
    """
    plain = replace(style, style=replace(style.style, bins=None, usable=None))
    before: tuple[int, T] | None = None
    for index in frames:
        if before is None:
            found = ops.upload(start)
        else:
            motion = shot.motion(index, before[0])
            sitting = Sitting((start.shape[1], start.shape[0]), before[1], before[1])
            way, visible = ops.upload(motion.way), ops.upload(motion.visible)
            found = ops.advect(plain, sitting, before[1], None, way, visible)
        before = index, found
        yield index, ops.fetch(found)


def order(start: int, stop: int, forward: bool) -> range:
    """The frames [start, stop) as a sweep visits them."""
    return range(start, stop) if forward else range(stop - 1, start - 1, -1)
