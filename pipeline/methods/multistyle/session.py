"""Multistyle as a stream: the eye looks, the painter paints. A batch job calls the same two."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from typing import Any

from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.methods.abstraction.state import Clock, State, flatten, no_clock, part
from pipeline.methods.multistyle.look import Eye
from pipeline.methods.multistyle.paint import Painter
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.sight import Sight


class MultistyleSession:
    """Video painting of one stream of frames of one size, without a design: see `pipeline.methods.base.Session`."""

    def __init__(self, params: MultistyleParams, size: tuple[int, int], seed: int = 0, clock: Clock = no_clock) -> None:
        self.params, self.size, self.seed = params, size, seed
        self.eye = Eye(params, size, seed, clock)
        self.painter = Painter(params, size, seed, clock)

    def step(self, frame: Frame) -> Frame:
        return self.paint(self.look(frame))

    def look(self, frame: Frame) -> Sight:
        return self.eye.step(frame)

    def paint(self, seen: Sight) -> Frame:
        return self.painter.paint(seen)

    def hurry(self, helper: Executor) -> None:
        self.painter.threads = 2

    def follow(
        self, params: Any, size: tuple[int, int], references: Mapping[str, Iterator[Frame]] | None = None
    ) -> MultistyleSession:
        """Strokes live on with other parameters, though no paint lingers; at another size they are laid afresh."""
        after = MultistyleSession(params, size, self.seed, self.eye.clock)
        after.painter.threads = self.painter.threads
        if size == self.size:
            after.eye.restore(self.eye.state())
        return after

    def state(self) -> State:
        """All it remembers, as arrays by name; a session restored from it goes on with the same bytes."""
        return flatten({"eye": self.eye.state(), "painter": self.painter.state()})

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.eye.restore(part(state, "eye"))
        self.painter.restore(part(state, "painter"))
