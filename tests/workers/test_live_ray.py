"""Live workers on a real Ray cluster: frames, our errors, a kill in mid-stream, spare workers."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.errors import BadFrame, BadParameter
from tests.waiting import until
from tests.workers.live_toys import Echo
from workers.blobs.disk import DiskBlobs
from workers.live.model import FrameRequest, LiveOrder, Packet, WireFormat
from workers.live.renderer import LiveRenderer
from workers.live.stream import Answer, Replaced, Stream
from workers.settings import FarmSettings

pytestmark = pytest.mark.real("ray")

SIZE = (128, 96)
ORDER = LiveOrder("echo", {}, 0, {}, SIZE, WireFormat("raw", "raw"))
FRAME = np.full((96, 128, 3), 50, np.uint8).tobytes()


class Quick(LiveRenderer):
    """A method that was warmed up before it began; it reports its process."""

    def __init__(self, blobs: DiskBlobs, pids: Path) -> None:
        super().__init__(blobs, lambda name: Echo())  # type: ignore[arg-type, return-value]
        self._pids = pids

    def warm_up(self) -> None:
        (self._pids / str(os.getpid())).touch()

    def open(self, order: LiveOrder) -> None:
        super().open(order)
        (self._pids / "at-work").write_text(str(os.getpid()))


@pytest.fixture(scope="module")
def pids(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("pids")


@pytest.fixture(scope="module")
def workers(tmp_path_factory: pytest.TempPathFactory, pids: Path) -> Iterator[Any]:
    import ray

    from workers.live.ray_workers import RayLiveWorkers
    from workers.pools.ray_cluster import connect

    home = tmp_path_factory.mktemp("ray")
    connect(FarmSettings(home=home, pool="ray", workers=1))
    made = RayLiveWorkers(DiskBlobs(home), 1, partial(Quick, DiskBlobs(home), pids))
    made.start()
    until(lambda: len(list(pids.glob("[0-9]*"))) == 1, 30)
    yield made
    made.stop()
    ray.shutdown()


def test_a_worker_paints_and_errors_keep_their_class(workers: Any) -> None:
    async def run() -> None:
        worker = await workers.take()
        await worker.open(ORDER)
        for number in range(1, 4):
            analyzed, painted = worker.analyze(FrameRequest((FRAME,), SIZE, SIZE)), worker.paint()
            await analyzed
            assert (await painted).data[2] == number
        await worker.analyze(FrameRequest((b"short",), SIZE, SIZE))
        with pytest.raises(BadFrame) as raised:
            await worker.paint()
        assert raised.value.field == "payload"
        with pytest.raises(BadParameter):
            await worker.change(replace(ORDER, params={"add": 999}))
        await worker.leave()

    asyncio.run(asyncio.wait_for(run(), 30))


def test_after_a_kill_9_in_the_middle_of_a_stream_the_worker_that_is_ready_goes_on(workers: Any, pids: Path) -> None:
    """`python -m benchmarks.live --kill` measures the time that this takes."""

    def ready() -> set[int]:
        return {int(path.name) for path in pids.glob("[0-9]*")}

    async def run() -> None:
        stream = Stream(workers, ORDER)
        await stream.open()
        await asyncio.to_thread(until, lambda: len(ready()) >= 2, 30)
        got: list[Any] = []
        reading = asyncio.create_task(_read(stream, got))
        await _send(stream, 20)
        victim = int((pids / "at-work").read_text())
        others = ready() - {victim}
        os.kill(victim, signal.SIGKILL)
        killed_s, number = time.perf_counter(), 20
        while not any(isinstance(item, Answer) and item.packet.at_s > killed_s for item in got):
            await _send(stream, 1, first=number)
            number += 1
        assert any(isinstance(item, Replaced) for item in got)
        assert int((pids / "at-work").read_text()) in others
        reading.cancel()
        await stream.aclose()

    asyncio.run(asyncio.wait_for(run(), 60))


async def _read(stream: Stream, got: list[Any]) -> None:
    while (item := await stream.next()) is not None:
        got.append(item)
        if isinstance(item, Answer):
            stream.sent(item, 0.0)


async def _send(stream: Stream, count: int, first: int = 0) -> None:
    for number in range(first, first + count):
        stream.offer(Packet(number, 0, SIZE, True, FRAME, time.perf_counter()))
        await asyncio.sleep(1 / 40)


def test_a_returned_worker_is_reused(workers: Any, pids: Path) -> None:
    async def one() -> str:
        worker = await workers.take()
        await worker.open(ORDER)
        where = (pids / "at-work").read_text()
        await worker.leave()
        return where

    async def run() -> None:
        assert await one() == await one()

    asyncio.run(asyncio.wait_for(run(), 60))


def test_frames_in_the_object_store_are_released(workers: Any) -> None:
    """Raw 640x480 is 0.9 MB each way: 120 of them would fill the store of 100 MB twice."""
    size = (640, 480)
    payload = bytes(640 * 480 * 3)

    async def run() -> None:
        worker = await workers.take()
        await worker.open(LiveOrder("echo", {}, 0, {}, size, WireFormat("raw", "raw")))
        for _ in range(120):
            analyzed, painted = worker.analyze(FrameRequest((payload,), size, size)), worker.paint()
            await analyzed
            await painted
        await worker.leave()

    asyncio.run(asyncio.wait_for(run(), 60))
