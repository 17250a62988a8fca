"""Multistyle as a live stream: analysis and painting of one frame after the other. A batch job calls the same parts."""

from __future__ import annotations

from concurrent.futures import Executor

from pipeline.arrays import Arrays, State, flatten, part
from pipeline.frames import Frame
from pipeline.methods.live import References
from pipeline.methods.multistyle.analysis import StrokeAnalysis
from pipeline.methods.multistyle.analyzer import StrokeAnalyzer
from pipeline.methods.multistyle.painter import Painter
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.tasks import Clock, no_clock


class MultistyleSession:
    """Paints one stream of frames of one size, without a design: see `pipeline.methods.base.Session`."""

    def __init__(self, params: MultistyleParams, size: tuple[int, int], seed: int = 0, clock: Clock = no_clock) -> None:
        self.params, self.size, self.seed = params, size, seed
        self.analyzer = StrokeAnalyzer(params, size, seed, clock)
        self.painter = Painter(params, size, seed, clock)

    def step(self, frame: Frame) -> Frame:
        return self.paint(self.analyze(frame))

    def analyze(self, frame: Frame) -> StrokeAnalysis:
        return self.analyzer.step(frame)

    def paint(self, analysis: StrokeAnalysis) -> Frame:
        return self.painter.paint(analysis)

    def use_helper(self, helper: Executor) -> None:
        self.painter.threads = 2

    def reconfigure(
        self, params: MultistyleParams, size: tuple[int, int],
        references: References | None = None, output_size: tuple[int, int] | None = None,
    ) -> MultistyleSession:  # fmt: skip
        """Continue with other parameters: strokes persist, accumulated paintings do not. Another size starts anew.

        `output_size` is ignored: strokes are made of the pixels of `size`.
        """
        after = MultistyleSession(params, size, self.seed, self.analyzer.clock)
        after.painter.threads = self.painter.threads
        if size == self.size:
            after.analyzer.restore(self.analyzer.state())
        return after

    def state(self) -> State:
        """State as arrays by name; a session restored from it continues with the same bytes."""
        return flatten({"analyzer": self.analyzer.state(), "painter": self.painter.state()})

    def restore(self, state: Arrays) -> None:
        self.analyzer.restore(part(state, "analyzer"))
        self.painter.restore(part(state, "painter"))
