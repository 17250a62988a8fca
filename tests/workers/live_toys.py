"""Test doubles for live tests: a small causal method, and workers whose timing and death a test controls."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from collections.abc import Awaitable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np
from pydantic import Field

from pipeline.errors import BadFrame, BadInput
from pipeline.frames import Frame
from pipeline.methods.base import Example, InputSpec, Method, Params, Step, When
from workers.live.model import FrameRequest, LiveOrder, RenderedFrame
from workers.live.worker import LiveWorkerLost, NoLiveWorker


class EchoParams(Params):
    add: int = Field(default=0, ge=0, le=255)
    """Value added to every pixel."""
    analyze_s: float = Field(default=0.0, ge=0)
    paint_s: float = Field(default=0.0, ge=0)
    per_pixel_s: float = Field(default=0.0, ge=0)
    """Additional time of painting, seconds per pixel."""
    open_s: float = Field(default=0.0, ge=0)
    fault: str = ""
    """"analyze", "paint": raise there; "die": kill the process at the third frame."""


class EchoSession:
    """Returns frames with `add` added; the blue value of the top left pixel is the frame's number in the stream."""

    def __init__(self, params: EchoParams, size: tuple[int, int], green: int = 0, received: int = 0) -> None:
        self.params, self.size, self.green, self.received = params, size, green, received

    def step(self, frame: Frame) -> Frame:
        return self.paint(self.analyze(frame))

    def analyze(self, frame: Frame) -> Any:
        assert (frame.shape[1], frame.shape[0]) == self.size
        time.sleep(self.params.analyze_s)
        self.received += 1
        if self.params.fault == "analyze":
            raise RuntimeError("injected fault in analyze")
        if self.params.fault == "die" and self.received == 3:
            os.kill(os.getpid(), signal.SIGKILL)
        return frame, self.received

    def paint(self, analysis: Any) -> Frame:
        frame, number = analysis
        time.sleep(self.params.paint_s + self.params.per_pixel_s * frame.shape[0] * frame.shape[1])
        if self.params.fault == "paint":
            raise RuntimeError("injected fault in paint")
        made = np.asarray(cv2.add(frame, np.full_like(frame, self.params.add)), np.uint8)
        made[0, 0] = (self.params.add, self.green, number % 256)
        return made

    def use_helper(self, helper: Executor) -> None:
        """Do nothing: there is no background work."""

    def reconfigure(
        self, params: Any, size: tuple[int, int], references: Mapping[str, Iterator[Frame]] | None = None,
        output_size: tuple[int, int] | None = None,
    ) -> EchoSession:  # fmt: skip
        green = self.green if references is None else _green(references)
        return EchoSession(params, size, green, self.received)


def _green(references: Mapping[str, Iterator[Frame]]) -> int:
    for frame in references.get("reference", iter(())):
        if frame[0, 0, 0] > 200 and frame[0, 0, 1] < 50:
            raise BadInput("Too red.", field="reference")
        return int(frame[0, 0, 1])
    return 0


class Echo(Method):
    name: ClassVar[str] = "echo"
    title: ClassVar[str] = "Echo"
    summary: ClassVar[str] = "Gives frames back."
    paper: ClassVar[str] = "nobody"
    Params: ClassVar[type[Params]] = EchoParams
    inputs: ClassVar[tuple[InputSpec, ...]] = (
        InputSpec("video", "video", True, "Video", "A video."),
        InputSpec("reference", "image-or-video", False, "Reference", "Its green."),
        InputSpec("numbers", "json", False, "Numbers", "Not for live.", applies_when=(When(way="film"),)),
    )
    steps: ClassVar[tuple[Step, ...]] = ()
    artefacts: ClassVar[tuple[str, ...]] = ()
    examples: ClassVar[tuple[Example, ...]] = ()

    def stream(
        self, params: Any, size: tuple[int, int], seed: int, references: Mapping[str, Iterator[Frame]]
    ) -> EchoSession:
        time.sleep(params.open_s)
        return EchoSession(params, size, _green(references))

    def live_filter(self, params: Any, size: tuple[int, int]) -> None:
        return None


@dataclass
class ToyWorker:
    """A live worker inside the test's event loop; the test sets how long work takes and when the worker dies."""

    workers: ToyWorkers
    opened: LiveOrder | None = None
    alive: bool = True
    left: bool = False
    changes: int = 0

    def __post_init__(self) -> None:
        self._analyzed: asyncio.Queue[FrameRequest | Exception] = asyncio.Queue()
        self.death = asyncio.Event()
        self.received: list[FrameRequest] = []

    def open(self, order: LiveOrder) -> Awaitable[None]:
        return asyncio.ensure_future(self._open(order))

    async def _open(self, order: LiveOrder) -> None:
        await self._live(0.0)
        self.opened = order

    def analyze(self, work: FrameRequest) -> Awaitable[None]:
        return asyncio.ensure_future(self._analyze(work))

    async def _analyze(self, work: FrameRequest) -> None:
        self.received.append(work)
        await self._live(self.workers.analyze_s)
        self._analyzed.put_nowait(BadFrame("No frame.") if work.payloads[-1] == b"bad" else work)

    def paint(self) -> Awaitable[RenderedFrame]:
        return asyncio.ensure_future(self._paint())

    async def _paint(self) -> RenderedFrame:
        death = asyncio.ensure_future(self.death.wait())
        got = asyncio.ensure_future(self._analyzed.get())
        await asyncio.wait({death, got}, return_when=asyncio.FIRST_COMPLETED)
        await self._live(self.workers.paint_s)
        work = got.result()
        if isinstance(work, Exception):
            raise work
        return RenderedFrame(
            work.payloads[-1],
            work.work_size,
            work.key,
            {"analyze": self.workers.analyze_s, "paint": self.workers.paint_s},
        )

    def change(self, order: LiveOrder) -> Awaitable[None]:
        return asyncio.ensure_future(self._change(order.params))

    async def _change(self, params: Mapping[str, Any]) -> None:
        await self._live(0.0)
        if params.get("add") == 13:
            raise BadInput("Unlucky.")
        self.changes += 1

    async def leave(self) -> None:
        self.left = True

    async def _live(self, seconds: float) -> None:
        with suppress(TimeoutError):
            await asyncio.wait_for(self.death.wait(), seconds) if seconds else await asyncio.sleep(0)
        if self.death.is_set():
            raise LiveWorkerLost("The process has died.")

    def die(self) -> None:
        self.death.set()


class ToyWorkers:
    kind = "toy"

    def __init__(self, analyze_s: float = 0.0, paint_s: float = 0.0, most: int = 100) -> None:
        self.analyze_s, self.paint_s, self.most = analyze_s, paint_s, most
        self.made: list[ToyWorker] = []

    def start(self) -> None: ...
    def stop(self) -> None: ...

    async def take(self) -> ToyWorker:
        if len(self.made) >= self.most:
            raise NoLiveWorker("None is left.")
        self.made.append(ToyWorker(self))
        return self.made[-1]
