"""The online method itself: one frame in, one frame out, from past frames only (zhang2011online, algorithm 1).

A session has three parts, each with a memory of its own, each seeing every frame in turn:

    eye     flow, settled frame, Lab, importance, edges, ink
    hand    segmentation, region colours
    brush   boundaries, paint, overlay

A part needs of another only what that one hands on for the same frame, so that they may work on different frames at
once (`relay`); the result is the same however they overlap.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any

from numpy.typing import NDArray

from pipeline.aside import Aside
from pipeline.colour.scheme import ColourStats, learn
from pipeline.frames import Frame, Plane
from pipeline.methods.abstraction.brush import Brush, Painting
from pipeline.methods.abstraction.carry import carry
from pipeline.methods.abstraction.eye import Eye, Percept
from pipeline.methods.abstraction.hand import Hand
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.state import Clock, State, flatten, no_clock, part

AHEAD = 6
"""Frames the eye may be ahead of the brush: enough to even out, little to keep."""


class AbstractionSession:
    """Online abstraction of one stream of frames of one size. Not thread-safe.

    Args:
        params: the method's.
        size: (width, height), px.
        reference: colour scheme to move towards, or None for mean region colours.
        shot: number of the first frame's shot in the whole video.
        clock: called with a stage's name, times it.
    """

    def __init__(
        self, params: AbstractionParams, size: tuple[int, int], reference: ColourStats | None = None, shot: int = 0,
        clock: Clock = no_clock,
    ) -> None:  # fmt: skip
        self.aside = Aside()
        self.eye = Eye(params, size, reference is not None, shot, clock, self.aside)
        self.hand = Hand(params, size, reference, clock)
        self.brush = Brush(params, size, clock, self.aside)

    def step(self, frame: Frame, mask: Plane | None = None) -> Frame:
        """The next frame of the stream, stylised. `mask`: the user's importance from this frame on, 0..1, or None."""
        return self.paint(self.look(frame, mask))

    def look(self, frame: Frame, mask: Plane | None = None) -> Percept:
        """The eye's half of a step; may run a frame ahead of `paint`, on another thread."""
        return self.eye.step(frame, mask)

    def paint(self, seen: Percept) -> Frame:
        """The hand's and the brush's half."""
        return self.finish(seen).frame

    def finish(self, seen: Percept) -> Painting:
        """`paint`, with what the frame is made from."""
        self.brush.expect(seen)
        painting = self.complete(seen)
        if self.aside.helper is not None:
            self.eye.rest()
        return painting

    def complete(self, seen: Percept) -> Painting:
        """What is left of `finish` when the brush expects the frame."""
        return self.brush.step(self.hand.step(seen))

    def hurry(self, helper: Executor) -> None:
        """Let what can wait be done aside by `helper`, which has one thread: see `pipeline.methods.base.Session`."""
        self.aside.helper = helper

    def follow(
        self, params: AbstractionParams, size: tuple[int, int],
        references: Mapping[str, Iterator[Frame]] | None = None,
    ) -> AbstractionSession:  # fmt: skip
        """A session that goes on from here, see `pipeline.methods.base.Session`: regions keep ids, places, colours."""
        reference = self.hand.palette.reference
        if references is not None:
            reference = learn(references["reference"]) if "reference" in references else None
        after = AbstractionSession(params, size, reference, clock=self.eye.clock)
        after.aside.helper = self.aside.helper
        after.restore(carry(self.state(), size, after.eye.coarse))
        return after

    def state(self) -> State:
        """All it remembers, as arrays by name; a session restored from it goes on with the same bytes."""
        return flatten({"eye": self.eye.state(), "hand": self.hand.state(), "brush": self.brush.state()})

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.eye.restore(part(state, "eye"))
        self.hand.restore(part(state, "hand"))
        self.brush.restore(part(state, "brush"))


class Relay:
    """Runs a session's eye on a thread of its own, ahead of hand and brush on the caller's. A context manager.

    Two threads, not three: eye and the rest cost about the same, and every thread more fights for the interpreter.
    When the eye is done sooner, it takes some of the brush's work.
    """

    def __init__(self, session: AbstractionSession) -> None:
        self.session = session
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="eye")

    def __enter__(self) -> Relay:
        self.session.brush.aside = Aside()
        return self

    def __exit__(self, *failure: object) -> None:
        self.session.brush.aside = self.session.aside
        self._thread.shutdown(cancel_futures=True)

    def run(
        self, frames: Iterable[Frame], masks: Mapping[int, Plane] | None = None, first: int = 0
    ) -> Iterator[Painting]:  # fmt: skip
        """What `step` gives for each frame in turn, with what it was made from.

        Args:
            masks: importance by frame number, see `AbstractionSession.step`.
            first: number of the first frame.
        """
        waiting: deque[Future[Percept]] = deque()
        for number, frame in enumerate(frames, first):
            seen = self._next(waiting) if len(waiting) == AHEAD else None
            waiting.append(self._thread.submit(self.session.eye.step, frame, masks.get(number) if masks else None))
            if seen:
                yield self.session.complete(seen)
        while waiting:
            yield self.session.complete(self._next(waiting))

    def _next(self, waiting: deque[Future[Percept]]) -> Percept:
        """The next frame to be painted. If the eye is well ahead it first does what the brush begins with."""
        ahead = len(waiting) > AHEAD // 2 and waiting[AHEAD // 2].done()
        self.session.brush.aside.helper = self._thread if ahead else None
        seen = waiting.popleft().result()
        self.session.brush.expect(seen)
        return seen
