"""A session on controlled workers: order, drops, back-pressure, parameter changes, worker deaths."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import wraps
from typing import Any

import pytest

from pipeline.errors import BadFrame, BadInput
from tests.workers.live_toys import ToyWorkers
from workers.live.model import LiveOrder, Packet, WireFormat
from workers.live.stream import Answer, KeyframeNeeded, Replaced, Resized, Stream
from workers.live.worker import NoLiveWorker

SIZE = (64, 64)


def looped(test: Callable[..., Awaitable[None]]) -> Callable[..., None]:
    @wraps(test)
    def run() -> None:
        asyncio.run(asyncio.wait_for(test(), 20))

    return run


def order(send: str = "jpeg", fps: float = 30) -> LiveOrder:
    return LiveOrder("echo", {}, 0, {}, SIZE, WireFormat(send, "jpeg", fps=fps))


def packet(number: int, key: bool = True, size: tuple[int, int] = SIZE, data: bytes = b"x") -> Packet:
    return Packet(number, 1000 + number, size, key, data, time.perf_counter())


@asynccontextmanager
async def opened(workers: ToyWorkers, chosen: LiveOrder | None = None) -> AsyncIterator[Stream]:
    stream = Stream(workers, chosen or order())
    await stream.open()
    yield stream
    await stream.aclose()


async def take(stream: Stream) -> Any:
    """The next item; an answer counts as sent at once."""
    item = await asyncio.wait_for(stream.next(), 5)
    if isinstance(item, Answer):
        stream.sent(item, 0.01)
    return item


@looped
async def test_answers_arrive_in_order_with_sequence_numbers_and_times() -> None:
    async with opened(ToyWorkers(analyze_s=0.002, paint_s=0.002)) as stream:
        got = []
        for number in range(8):
            stream.offer(packet(number))
            got.append((await take(stream)).packet)
        assert [(p.sequence, p.timestamp) for p in got] == [(n, 1000 + n) for n in range(8)]
        assert stream.figures()["dropped"] == 0


@looped
async def test_a_fast_client_gets_the_newest_frame() -> None:
    workers = ToyWorkers(analyze_s=0.01, paint_s=0.01)
    async with opened(workers) as stream:
        got: list[int] = []

        async def read() -> None:
            while True:
                if isinstance(item := await take(stream), Answer):  # a busy machine may have smaller frames, too
                    got.append(item.packet.sequence)

        reading = asyncio.create_task(read())
        began = time.monotonic()
        for number in range(100):
            stream.offer(packet(number))
            await asyncio.sleep(0.002)
        await stream.finish()
        took_s = time.monotonic() - began
        await asyncio.sleep(0)
        reading.cancel()
        assert got == sorted(got)
        assert got[-1] == 99
        assert 3 <= len(got) <= took_s / workers.paint_s + 1, "one after the other; the rest is dropped"
        figures = stream.figures()
        assert figures["received"] == 100 == figures["painted"] + figures["dropped"]


@looped
async def test_no_frame_begins_while_an_answer_is_unsent() -> None:
    workers = ToyWorkers()
    async with opened(workers) as stream:
        for number in range(50):
            stream.offer(packet(number))
            await asyncio.sleep(0.001)
        assert len(workers.made[0].received) <= 3
        while (await take(stream)).packet.sequence != 49:
            pass


@looped
async def test_a_parameter_change_takes_effect_between_frames() -> None:
    workers = ToyWorkers(analyze_s=0.005, paint_s=0.005)
    async with opened(workers) as stream:
        stream.offer(packet(1))
        await stream.change(replace(stream.order, params={"add": 2}))
        assert stream.order.params == {"add": 2}
        assert (await take(stream)).packet.sequence == 1
        with pytest.raises(BadInput):
            await stream.change(replace(stream.order, params={"add": 13}))
        assert stream.order.params == {"add": 2}
        stream.offer(packet(2))
        assert (await take(stream)).packet.sequence == 2


@looped
async def test_a_dead_worker_is_replaced() -> None:
    workers = ToyWorkers(analyze_s=60, paint_s=60)
    async with opened(workers) as stream:
        await stream.change(replace(stream.order, params={"add": 4}))
        stream.offer(packet(1))  # in work until the worker dies
        while not workers.made[0].received:
            await asyncio.sleep(0.001)
        stream.offer(packet(2))
        await asyncio.sleep(0.001)
        workers.made[0].die()
        workers.analyze_s = workers.paint_s = 0
        stream.offer(packet(3))
        assert isinstance(await take(stream), Replaced)
        assert (await take(stream)).packet.sequence == 3
        assert workers.made[0].left
        assert workers.made[1].opened is not None
        assert workers.made[1].opened.params == {"add": 4}
        assert workers.made[1].received[0].key
        figures = stream.figures()
        assert (figures["received"], figures["painted"], figures["dropped"]) == (3, 1, 2)


@looped
async def test_a_dead_worker_under_a_video_codec_requests_a_key_frame() -> None:
    workers = ToyWorkers(analyze_s=0.01)
    async with opened(workers, order("h264")) as stream:
        stream.offer(packet(1))
        await asyncio.sleep(0.001)
        workers.made[0].die()
        assert isinstance(await take(stream), KeyframeNeeded)
        assert isinstance(await take(stream), Replaced)
        stream.offer(packet(2, key=False))
        stream.offer(packet(3))
        assert (await take(stream)).packet.sequence == 3


@looped
async def test_a_worker_death_during_a_parameter_change_is_recovered() -> None:
    workers = ToyWorkers()
    async with opened(workers) as stream:
        workers.made[0].die()
        await stream.change(replace(stream.order, params={"add": 7}))
        assert workers.made[1].changes == 1
        assert stream.order.params == {"add": 7}


@looped
async def test_the_stream_ends_if_a_dead_worker_cannot_be_replaced() -> None:
    workers = ToyWorkers(analyze_s=0.01, most=1)
    async with opened(workers) as stream:
        stream.offer(packet(1))
        await asyncio.sleep(0.001)
        workers.made[0].die()
        with pytest.raises(NoLiveWorker):
            await take(stream)
        with pytest.raises(NoLiveWorker):
            await stream.change(replace(stream.order, params={}))


@looped
async def test_a_bad_frame_ends_the_stream() -> None:
    async with opened(ToyWorkers()) as stream:
        stream.offer(packet(1))
        stream.offer(packet(2, data=b"bad"))
        with pytest.raises(BadFrame):
            while True:
                await take(stream)


@looped
async def test_overload_lowers_the_size_and_announces_it_before_the_first_smaller_frame() -> None:
    workers = ToyWorkers(analyze_s=0.03, paint_s=0.03)
    async with opened(workers, order(fps=100)) as stream:

        async def send() -> None:
            for number in range(400):
                stream.offer(packet(number))
                await asyncio.sleep(0.01)

        sending = asyncio.create_task(send())
        while not isinstance(item := await take(stream), Resized):
            pass
        sending.cancel()
        assert item.why.reason == "slow" and item.scale < 1, "how small: tests/workers/test_live_resolution.py"
        assert (await take(stream)).painted.size == item.size == (round(64 * item.scale), round(64 * item.scale))


@looped
async def test_frames_of_another_size_change_the_size() -> None:
    async with opened(ToyWorkers()) as stream:
        stream.offer(packet(1))
        await take(stream)
        stream.offer(packet(2, size=(128, 96)))
        item = await take(stream)
        assert (item.size, item.why.reason) == ((128, 96), "input")
        assert (await take(stream)).painted.size == (128, 96)


@looped
async def test_a_new_connection_continues_the_stream() -> None:
    workers = ToyWorkers(analyze_s=0.005)
    async with opened(workers) as stream:
        for number in range(3):
            stream.offer(packet(number))
        await asyncio.sleep(0.02)
        stream.detach()
        stream.offer(packet(5))
        await asyncio.sleep(0.02)
        await stream.attach(WireFormat("jpeg", "webp"), SIZE, adaptive=True)
        stream.offer(packet(0))
        answer = await take(stream)
        assert answer.packet.sequence == 0
        assert workers.made[0].opened is not None
        assert workers.made[0].opened.wire.receive == "webp"
        figures = stream.figures()
        assert figures["received"] == figures["painted"] + figures["dropped"] == 5


@looped
async def test_closing_returns_the_worker_and_wakes_waiting_readers() -> None:
    workers = ToyWorkers(analyze_s=0.01, paint_s=0.01)
    async with opened(workers) as stream:
        waiting = asyncio.create_task(stream.next())
        stream.offer(packet(1))
        await asyncio.sleep(0.001)
        await stream.aclose()
        assert workers.made[0].left
        assert isinstance(await waiting, Answer | None)


@looped
async def test_figures_of_a_second_cover_that_second_only() -> None:
    async with opened(ToyWorkers()) as stream:
        stream.offer(packet(1))
        await take(stream)
        first, second = stream.second(), stream.second()
        assert (first["received"], first["painted"], first["width"], first["scale"]) == (1, 1, 64, 1.0)
        assert (second["received"], second["painted"]) == (0, 0)
        assert set(first["stages_ms"]) == {"wait", "analyze", "paint"}
