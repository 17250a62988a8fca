"""The online method: one frame in, one frame out, using past frames only (zhang2011online, algorithm 1).

A session consists of three stages. Each stage keeps its own state and processes every frame in order:

    analyzer     flow, denoised frame, CIELAB, importance, edges, lines
    regions      segmentation, region colours
    compositor   region boundaries, fill, line overlay

A stage depends on the results of the earlier stages for the same frame only, so that the stages may process different
frames at the same time (`PipelinedRunner`); the result does not depend on how they overlap.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import NamedTuple

from pipeline.arrays import Arrays, State, flatten, part
from pipeline.colour.scheme import ColourStats, from_histogram, learn
from pipeline.frames import Flow, Frame, Plane
from pipeline.kernels.executors import FrameExecutor, LazyExecutor, Ready, ThreadExecutor
from pipeline.methods.abstraction.analysis import FrameAnalysis, FrameAnalyzer, FrameFeatures, SmoothedFrame
from pipeline.methods.abstraction.compositor import CompositedFrame, Compositor, OutlinedRegions
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.printed import PrintedAnalyzer
from pipeline.methods.abstraction.region_stage import ColouredRegions, RegionStage
from pipeline.methods.abstraction.resample_state import resample_state
from pipeline.methods.abstraction.sizes import sizes_of
from pipeline.methods.given_motion import NO_MOTION, GivenMotion
from pipeline.methods.live import References
from pipeline.methods.tasks import Clock, no_clock

AHEAD = 6
"""Frames the analyzer may be ahead of the compositor: evens out their run times at little memory."""
THIRD_THREAD_FROM_PX = 480
"""Shorter side of the frames from which further threads pay, px."""

FEATURE_THREADS = 3
"""Threads that compute features and edges of different frames; each has little more to do than half a processor."""


def scheme_of(references: References) -> ColourStats | None:
    """The colour scheme of a live session's inputs; None: the video's own colours. Raises BadInput."""
    if "histogram" in references:
        return from_histogram(references["histogram"], "inputs.histogram")
    return learn(references["reference"]) if "reference" in references else None


class AbstractionSession:
    """Online abstraction of one stream of frames of one size. Not thread-safe.

    Args:
        params: the method's parameters.
        size: (width, height) of the incoming frames, px; they are analysed at `sizes_of`.
        reference: target colour scheme; None = mean region colours.
        shot: index of the first frame's shot in the video, from 0.
        clock: context manager factory that times a named stage.
        output_size: (width, height) of the outgoing frames, px; None = `size`. Larger ones are drawn with sharp edges
            for any `params.edges`, because curves can be drawn at any size.
    """

    def __init__(
        self, params: AbstractionParams, size: tuple[int, int], reference: ColourStats | None = None, shot: int = 0,
        clock: Clock = no_clock, output_size: tuple[int, int] | None = None,
    ) -> None:  # fmt: skip
        self.background = FrameExecutor()
        params = params.effective()
        self.sizes = sizes = sizes_of(params, size, output_size)
        analyzer = PrintedAnalyzer if params.algorithm == "printed" else FrameAnalyzer
        self.analyzer = analyzer(params, sizes, reference is not None, shot, clock, self.background)
        self.regions = RegionStage(params, sizes.work, reference, clock)
        self.compositor = Compositor(params, sizes, clock, self.background)

    def step(self, frame: Frame, mask: Plane | None = None) -> Frame:
        """The next frame of the stream, stylised. `mask`: the user's importance from this frame on, 0..1, or None."""
        return self.paint(self.analyze(frame, mask))

    def analyze(self, frame: Frame, mask: Plane | None = None) -> FrameAnalysis:
        """First half of a step; may run some frames ahead of `paint`, on another thread."""
        return self.analyzer.step(frame, mask)

    def paint(self, analysis: FrameAnalysis) -> Frame:
        """Second half of a step: segmentation, colours and compositing."""
        return self.finish(analysis).frame

    def finish(self, analysis: FrameAnalysis) -> CompositedFrame:
        """`paint` with the intermediate results of the frame."""
        self.compositor.prepare(analysis)
        painting = self.complete(analysis)
        if self.background.helper is not None:
            self.analyzer.finish_frame()
        return painting

    def complete(self, analysis: FrameAnalysis) -> CompositedFrame:
        """Second part of `finish`, after `Compositor.prepare`."""
        return self.compositor.step(self.compositor.outline(self.regions.step(analysis)))

    def use_helper(self, helper: Executor) -> None:
        """Run background work on `helper`, an executor of one thread: see `pipeline.methods.base.Session`."""
        self.background.helper = helper

    def reconfigure(
        self, params: AbstractionParams, size: tuple[int, int],
        references: References | None = None, output_size: tuple[int, int] | None = None,
    ) -> AbstractionSession:  # fmt: skip
        """A session that continues this one: regions keep ids, places and colours. See `base.Session`."""
        reference = self.regions.palette.reference
        if references is not None:
            reference = scheme_of(references)
        after = AbstractionSession(params, size, reference, clock=self.analyzer.clock, output_size=output_size)
        after.background.helper = self.background.helper
        after.restore(resample_state(self.state(), after.sizes, after.analyzer.coarse))
        return after

    def state(self) -> State:
        """The complete state as arrays by name; a session restored from it continues with the same output bytes."""
        return flatten(
            {"analyzer": self.analyzer.state(), "regions": self.regions.state(), "compositor": self.compositor.state()}
        )

    def restore(self, state: Arrays) -> None:
        self.analyzer.restore(part(state, "analyzer"))
        self.regions.restore(part(state, "regions"))
        self.compositor.restore(part(state, "compositor"))


class _Waiting(NamedTuple):
    """A frame that is being worked on."""

    analysis: Future[FrameAnalysis]
    outlined: Future[OutlinedRegions] | None
    """None = made on the caller's thread."""


class PipelinedRunner:
    """Runs the analyzer on a thread of its own, ahead of the other stages on the caller's thread. A context manager.

    In frames of `THIRD_THREAD_FROM_PX`, importance, lines, regions and their outlines have threads of their own,
    another one takes a half of the compositor's rows, and others compute the features, edges and line responses of
    several frames at the same time. On two processors, too, no stage keeps one of them waiting.
    In smaller frames threads would compete for the interpreter lock (at 352x288, three threads take a tenth longer);
    there the analyzer's thread, when it is not ahead, leaves edges and lines to the other stages, and takes some of the
    compositor's work when it is.
    """

    def __init__(self, session: AbstractionSession) -> None:
        self.session = session
        self._analyzer = ThreadPoolExecutor(1, thread_name_prefix="analyzer")
        large = min(session.sizes.output) >= THIRD_THREAD_FROM_PX
        self._regions = ThreadPoolExecutor(1, thread_name_prefix="regions") if large else None
        self._deferring = None if large else LazyExecutor()
        self._importance = ThreadPoolExecutor(1, thread_name_prefix="importance") if large else None
        self._lines = ThreadPoolExecutor(1, thread_name_prefix="lines") if large else None
        self._outlines = ThreadPoolExecutor(1, thread_name_prefix="outlines") if large else None
        self._helper = ThreadPoolExecutor(1, thread_name_prefix="compositor") if large else None
        self._features = ThreadPoolExecutor(FEATURE_THREADS, thread_name_prefix="features") if large else None
        self._before: Future[SmoothedFrame] | None = None
        self._analysed = self._composited = 0  # frames; each counted by one thread only

    def __enter__(self) -> PipelinedRunner:
        self.session.compositor.background = FrameExecutor()
        threaded = None
        if self._importance and self._lines and self._features:
            threaded = ThreadExecutor(self._importance, self._lines, self._features)
        self.session.analyzer.background = threaded or self._deferring or self.session.background
        return self

    def __exit__(self, *failure: object) -> None:
        self.session.compositor.background = self.session.analyzer.background = self.session.background
        threads = (self._analyzer, self._regions, self._importance, self._lines, self._outlines, self._helper)
        for thread in (*threads, self._features):
            if thread is not None:  # a part of the face search may still wait, on which the state depends
                thread.shutdown(cancel_futures=failure[0] is not None)

    def run(
        self, frames: Iterable[Frame], masks: Mapping[int, Plane] | None = None, first: int = 0,
        motion: GivenMotion = NO_MOTION,
    ) -> Iterator[CompositedFrame]:  # fmt: skip
        """The result of `AbstractionSession.finish` for each frame, in order.

        Args:
            masks: importance by frame number, see `AbstractionSession.step`.
            first: number of the first frame in the film.
            motion: of the frames, if it need not be estimated.
        """
        waiting: deque[_Waiting] = deque()
        for number, frame in enumerate(frames, first):
            done = self._composite(waiting) if len(waiting) == AHEAD else None
            given = motion.flow(number - 1, number, self.session.sizes.work)
            waiting.append(self._begin(number, frame, masks.get(number) if masks else None, given))
            if done:
                yield done
        while waiting:
            yield self._composite(waiting)

    def _begin(self, number: int, frame: Frame, mask: Plane | None, given: Flow | None) -> _Waiting:
        features = None if self._features is None else self._prepare(self._features, frame, given)
        analysis = self._analyzer.submit(self._analyze, number, frame, mask, given, features)
        regions = self._regions.submit(self._segment, analysis) if self._regions else None
        outlined = self._outlines.submit(self._outline, regions) if self._outlines and regions else None
        return _Waiting(analysis, outlined)

    def _prepare(self, threads: Executor, frame: Frame, given: Flow | None) -> FrameFeatures:
        """Begin what does not depend on earlier results."""
        analyzer, before, first = self.session.analyzer, self._before, self.session.analyzer.gray
        self._before = now = threads.submit(analyzer.smoothed, frame)

        def flow() -> Flow | None:
            return analyzer.flow(first if before is None else before.result().gray, now.result().gray)

        return FrameFeatures(now, Ready(None) if given is not None else threads.submit(flow))

    def _analyze(
        self, number: int, frame: Frame, mask: Plane | None, given: Flow | None, features: FrameFeatures | None
    ) -> FrameAnalysis:  # fmt: skip
        analysis = self.session.analyzer.step(frame, mask, given, features, number)
        self._analysed += 1
        if self._deferring is not None and self._analysed - self._composited > AHEAD // 2:
            self._deferring.finish()
        return analysis

    def _segment(self, analysis: Future[FrameAnalysis]) -> ColouredRegions:
        return self.session.regions.step(analysis.result())

    def _outline(self, regions: Future[ColouredRegions]) -> OutlinedRegions:
        return self.session.compositor.outline(regions.result())

    def _composite(self, waiting: deque[_Waiting]) -> CompositedFrame:
        """Finish the next frame."""
        ahead = len(waiting) > AHEAD // 2 and waiting[AHEAD // 2].analysis.done()
        self.session.compositor.background.helper = self._helper or (self._analyzer if ahead else None)
        analysis, outlined = waiting.popleft()
        self._composited += 1
        compositor = self.session.compositor
        compositor.prepare(analysis.result())
        return compositor.step(outlined.result() if outlined else compositor.outline(self._segment(analysis)))
