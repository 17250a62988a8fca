"""One running session: frames in, answers out, on a worker that may die.

`FramePolicy` and `ResolutionLadder` decide; this module acts. For one event loop only.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace

from workers.contract.request import Json
from workers.live.codecs import BUILT_ON
from workers.live.model import FrameRequest, LiveOrder, Packet, RenderedFrame, Size, WireFormat
from workers.live.policy import FramePolicy, StageStart
from workers.live.resolution import FrameCost, FrameRateMeter, ResolutionLadder, SizeReason, scaled
from workers.live.statistics import FrameStatistics
from workers.live.worker import LiveWorker, LiveWorkerLost, LiveWorkers, NoLiveWorker

log = logging.getLogger(__name__)

WORKER_WITHIN_S = 60.0
"""Seconds within which a worker must be ready. On a new machine this includes compiling the kernels."""
LEAVE_WITHIN_S = 10.0


@dataclass(frozen=True)
class Answer:
    """A painted frame, to be sent."""

    packet: Packet
    painted: RenderedFrame
    waited_s: float
    """Seconds from its arrival until its analysis began."""


@dataclass(frozen=True)
class Resized:
    """The frame size changes, beginning with the next answer."""

    size: Size
    scale: float
    why: SizeReason


@dataclass(frozen=True)
class Replaced:
    """The worker died; another one continues the stream."""

    reason: str


@dataclass(frozen=True)
class KeyframeNeeded:
    """The client must send a key frame."""

    reason: str


Item = Answer | Resized | Replaced | KeyframeNeeded


class Stream:
    """One session.

    Args:
        workers: source of the session's worker, and of a new one if that dies.
        order: method, parameters and size of the first frames.
        adaptive: whether frames may be painted at a smaller size.
        clock: seconds; `Packet.at_s` has the same clock.
    """

    def __init__(
        self,
        workers: LiveWorkers,
        order: LiveOrder,
        adaptive: bool = True,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.order = order
        self._workers, self._clock = workers, clock
        self._policy = FramePolicy(built_on=order.wire.send in BUILT_ON)
        self._ladder, self._pace = ResolutionLadder(adaptive), FrameRateMeter(order.wire.fps)
        self._worker: LiveWorker | None = None
        self._input_size = self._shown_size = order.size
        self._key_wanted = False
        self._items: deque[Item] = deque()
        self._moved = asyncio.Event()
        """Set after every change of state."""
        self._suspended_by: set[str] = set()
        self._changing = asyncio.Lock()
        self._replacing: asyncio.Task[None] | None = None
        self._newest: asyncio.Task[None] | None = None
        """Task that paints the newest frame."""
        self._tasks: set[asyncio.Task[None]] = set()
        self._failure: Exception | None = None
        self.total, self._second = FrameStatistics(clock()), FrameStatistics(clock())
        self._counted = (0, 0)
        """Counts of received and dropped frames at the last full second."""

    # -- life

    async def open(self) -> None:
        """Take a worker and begin. Raises NoLiveWorker, and the errors of `LiveRenderer.open`."""
        self._worker = await self._take()

    async def aclose(self) -> None:
        """Stop, and return the worker after it has finished its frames, whose answers are dropped."""
        self._suspend("closed")
        self._wake()
        if self._replacing is not None:
            self._replacing.cancel()
        if self._tasks:
            await asyncio.wait(self._tasks, timeout=LEAVE_WITHIN_S)
        if self._worker is not None:
            worker, self._worker = self._worker, None
            await worker.leave()

    def detach(self) -> None:
        """The connection is lost: drop the waiting frame. Frames in progress are finished, and their answers
        dropped."""
        self._suspend("away")
        self._items.clear()
        self._policy.leave()
        self._wake()

    async def attach(self, wire: WireFormat, size: Size, adaptive: bool) -> None:
        """Continue for another connection with its codecs and frame sizes. Raises like `open`."""
        self._suspend("away")
        order = replace(self.order, wire=wire)
        await self._on_worker(lambda worker: worker.open(order), order)
        self._policy.built_on = wire.send in BUILT_ON
        self._policy.leave()
        self._items.clear()
        self._ladder.adaptive, self._pace, self._input_size = adaptive, FrameRateMeter(wire.fps), size
        self._release("away")

    # -- frames

    @property
    def size(self) -> Size:
        """Analysis size for frames of the present size."""
        return scaled(self._input_size, self._ladder.scale)

    def offer(self, packet: Packet) -> None:
        """A frame has arrived."""
        self._pace.arrived(packet.at_s)
        if self._policy.arrive(packet):
            self._put(KeyframeNeeded("earlier frames are lost"))
        self._pump()

    def want_key(self) -> None:
        """The next answer shall be a key frame."""
        self._key_wanted = True

    async def next(self) -> Item | None:
        """The next item; None once closed. Raises the error that ended the stream. Call `sent` for each `Answer`."""
        await self._until(lambda: bool(self._items) or "closed" in self._suspended_by)
        return self._items.popleft() if self._items else None

    def sent(self, answer: Answer, latency_s: float) -> None:
        """The answer was sent, `latency_s` after its frame arrived."""
        stages = {"wait": answer.waited_s, **answer.painted.stages_s}
        for figures in (self.total, self._second):
            figures.answered(latency_s, stages)
        self._policy.sent()
        self._wake()
        self._pump()

    async def finish(self) -> None:
        """Wait until every received frame is answered or dropped."""
        await self._until(lambda: self._policy.idle)

    def figures(self) -> Json:
        """Statistics of the whole session."""
        self.total.received, self.total.dropped = self._policy.received, self._policy.dropped
        return self.total.as_json(self._clock()) | self._shown()

    def second(self) -> Json:
        """Statistics since the last call."""
        received, dropped = self._counted
        self._counted = (self._policy.received, self._policy.dropped)
        self._second.received, self._second.dropped = self._counted[0] - received, self._counted[1] - dropped
        now = self._clock()
        figures, self._second = self._second.as_json(now), FrameStatistics(now)
        return figures | self._shown()

    def _shown(self) -> Json:
        width, height = self.size
        why = self._ladder.why
        measured = {"latency_ms": round(1000 * why.latency_s, 1), "deadline_ms": round(1000 * why.deadline_s, 1)}
        chosen = {"reason": why.reason, **(measured if why.deadline_s else {})}
        return {"width": width, "height": height, "scale": self._ladder.scale, "size": chosen}

    # -- changes

    async def change(self, order: LiveOrder) -> None:
        """Apply the parameters, references and filter of this order. Raises like `LiveRenderer.change`; nothing is
        changed then."""
        await self._on_worker(lambda worker: worker.change(order), order)

    async def _on_worker(self, call: Callable[[LiveWorker], Awaitable[None]], order: LiveOrder) -> None:
        """Call the worker while no frame is in progress; then use `order`. If the worker dies in the call, the call
        is repeated on a new worker, which starts with the previous order."""
        async with self._idle():
            try:
                await call(self._open_worker())
            except LiveWorkerLost as error:
                self._lose(self._open_worker(), str(error))
                await self._until(lambda: self._replacing is None)
                await call(self._open_worker())
            self.order = order

    @asynccontextmanager
    async def _idle(self) -> AsyncIterator[None]:
        """Wait until no frame is in progress, and begin none until the block ends."""
        async with self._changing:
            self._suspend("change")
            try:
                await self._until(lambda: not self._policy.working and self._replacing is None)
                if self._failure is not None:
                    raise self._failure
                yield
            finally:
                self._release("change")

    # -- work

    def _pump(self) -> None:
        if (start := self._policy.start()) is not None:
            self._newest = self._spawn(self._paint(start, self._work(start), self._newest))

    def _work(self, start: StageStart) -> FrameRequest:
        if start.frame.size != self._input_size:
            self._input_size, self._ladder.why = start.frame.size, SizeReason()
            self._ladder.restart()
        key, self._key_wanted = self._key_wanted, False
        return FrameRequest(tuple(packet.data for packet in start.packets), start.frame.size, self.size, key)

    async def _paint(self, start: StageStart, work: FrameRequest, before: asyncio.Task[None] | None) -> None:
        """Process a frame from its analysis to its answer. It waits for the task `before`, so that answers keep the
        order of frames."""
        began, rung, worker = self._clock(), self._ladder.rung, self._open_worker()
        analyzing, painting = asyncio.ensure_future(worker.analyze(work)), asyncio.ensure_future(worker.paint())
        analyzing.add_done_callback(lambda done: self._analyzed(done, start))
        try:
            painted = await painting
            if before is not None:
                await asyncio.wait([before])
        except LiveWorkerLost as error:
            self._lose(worker, str(error))
        except Exception as error:
            self._fail(error)
        else:
            if worker is not self._worker:
                return  # already counted as lost with its worker
            self._finished(Answer(start.frame, painted, began - start.frame.at_s), work.work_size, rung)

    def _analyzed(self, done: asyncio.Future[None], start: StageStart) -> None:
        if done.cancelled() or done.exception() is not None:
            return  # `paint` reports the same error
        self._policy.analyzed(start)
        self._pump()

    def _finished(self, answer: Answer, size: Size, rung: int) -> None:
        self._policy.painted()
        self._measure(answer, rung)
        if "away" in self._suspended_by:
            self._policy.leave()
        else:
            self._show(size)
            self._put(answer)
        self._wake()

    def _measure(self, answer: Answer, rung: int) -> None:
        now, cost = self._clock(), FrameCost.of(answer.painted.stages_s)
        self._ladder.painted(now, self._pace.period_s, now - answer.packet.at_s, cost, rung)
        self._policy.alone = not self._ladder.is_behind(now, self._pace.period_s)

    def _show(self, size: Size) -> None:
        """Announce another size of answers before the first answer of that size."""
        if size != self._shown_size:
            self._shown_size = size
            self._put(Resized(size, self._ladder.scale, self._ladder.why))

    # -- crashes and errors

    def _open_worker(self) -> LiveWorker:
        assert self._worker is not None, "the stream is open"
        return self._worker

    async def _take(self) -> LiveWorker:
        async def one() -> LiveWorker:
            while True:
                worker = await self._workers.take()
                try:
                    await worker.open(self.order)
                    return worker
                except LiveWorkerLost:
                    log.warning("a live worker died before its first frame")
                    await worker.leave()
                except BaseException:
                    await worker.leave()
                    raise

        try:
            return await asyncio.wait_for(one(), WORKER_WITHIN_S)
        except TimeoutError:
            raise NoLiveWorker("No live worker was ready in time.", remedy="Try again in a minute.") from None

    def _lose(self, worker: LiveWorker, reason: str) -> None:
        """The worker has died: drop its frames and take a new worker. Called once by each of its frames."""
        if worker is not self._worker or "closed" in self._suspended_by:
            return
        self._worker = None
        log.warning("a live worker has died: %s", reason)
        self._suspend("replacing")
        if self._policy.lost():
            self._put(KeyframeNeeded("the worker died"))
        self._ladder.restart()
        self._replacing = self._spawn(self._replace_worker(worker, reason))
        self._wake()

    async def _replace_worker(self, lost: LiveWorker, reason: str) -> None:
        try:
            self._worker = await self._take()
            self._key_wanted = True
            self._put(Replaced(reason))
        except Exception as error:
            self._fail(error)
        finally:
            self._replacing = None
            self._release("replacing")
            await lost.leave()

    def _fail(self, error: Exception) -> None:
        self._failure = self._failure or error
        self._suspend("failed")
        self._wake()

    # -- helpers

    def _put(self, item: Item) -> None:
        self._items.append(item)
        self._wake()

    def _suspend(self, why: str) -> None:
        self._suspended_by.add(why)
        self._policy.suspended = True

    def _release(self, why: str) -> None:
        self._suspended_by.discard(why)
        self._policy.suspended = bool(self._suspended_by)
        self._wake()
        self._pump()

    def _wake(self) -> None:
        self._moved.set()

    async def _until(self, true: Callable[[], bool]) -> None:
        """Wait until the condition holds; raise the error that has ended the stream."""
        while not true():
            if self._failure is not None:
                raise self._failure
            self._moved.clear()
            await self._moved.wait()

    def _spawn(self, work: Awaitable[None]) -> asyncio.Task[None]:
        task = asyncio.ensure_future(work)
        assert isinstance(task, asyncio.Task)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task
