"""Frames over a socket: their order, reported errors, authentication, and the death of the peer."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable, Coroutine, Iterator
from queue import SimpleQueue
from typing import Any

import pytest

from pipeline.errors import BadFrame
from pipeline.video.guard.wire import HEADER, lengths, parsed
from workers.live.channel import GREET_S, SECRET_BYTES, LiveWorkerClient, LiveWorkerServer
from workers.live.messages import decode_frame, decode_request, encode_frame, encode_request
from workers.live.model import FrameRequest, RenderedFrame
from workers.live.worker import LiveWorkerLost

SECRET = bytes(range(SECRET_BYTES))
SIZE = (4, 2)


class Mirror:
    """Returns its input; some payloads raise errors."""

    def __init__(self) -> None:
        self._payloads: SimpleQueue[bytes] = SimpleQueue()

    def analyze(self, work: FrameRequest) -> None:
        self._payloads.put(work.payloads[-1])

    def paint(self) -> RenderedFrame:
        data = self._payloads.get()
        if data == b"bad":
            raise BadFrame("Not a frame.", field="payload", remedy="Send a JPEG.")
        if data == b"odd":
            raise ZeroDivisionError("a brush without hairs")
        if data == b"slow":
            time.sleep(0.3)
        return RenderedFrame(data, SIZE, True)


@pytest.fixture
def post() -> Iterator[LiveWorkerServer]:
    made = LiveWorkerServer(Mirror(), "127.0.0.1", SECRET)
    yield made
    made.close()


def run(
    act: Callable[[LiveWorkerClient], Coroutine[Any, Any, None]], post: LiveWorkerServer, secret: bytes = SECRET
) -> None:
    async def connected() -> None:
        channel = await LiveWorkerClient.connect(post.address, secret)
        try:
            await act(channel)
        finally:
            channel.close()

    asyncio.run(asyncio.wait_for(connected(), 20))


def work(data: bytes) -> FrameRequest:
    return FrameRequest((data,), SIZE, SIZE)


def test_large_answers_arrive_complete_in_frame_order(post: LiveWorkerServer) -> None:
    payloads = [bytes([i]) * (1 if i % 2 else 3_000_000) for i in range(6)]

    async def act(channel: LiveWorkerClient) -> None:
        both = [(channel.analyze(work(data)), channel.paint()) for data in payloads]
        assert [await analyzed for analyzed, _ in both] == [None] * 6
        assert [(await painted).data for _, painted in both] == payloads

    run(act, post)


def test_a_frame_is_analyzed_while_the_previous_one_is_painted(post: LiveWorkerServer) -> None:
    async def act(channel: LiveWorkerClient) -> None:
        _, slow = channel.analyze(work(b"slow")), channel.paint()
        await channel.analyze(work(b"next"))
        assert not slow.done()
        assert (await slow).data == b"slow"
        assert (await channel.paint()).data == b"next"

    run(act, post)


def test_errors_are_reported_and_the_stream_goes_on(post: LiveWorkerServer) -> None:
    async def act(channel: LiveWorkerClient) -> None:
        await channel.analyze(work(b"bad"))
        with pytest.raises(BadFrame) as raised:
            await channel.paint()
        assert (raised.value.field, raised.value.remedy) == ("payload", "Send a JPEG.")
        await channel.analyze(work(b"odd"))
        with pytest.raises(RuntimeError, match="ZeroDivisionError: a brush without hairs"):
            await channel.paint()
        await channel.analyze(work(b"fine"))
        assert (await channel.paint()).data == b"fine"

    run(act, post)


def test_frame_requests_and_rendered_frames_round_trip() -> None:
    frame = FrameRequest((b"first", b"", b"last"), (640, 480), (320, 240), key=True)
    painted = RenderedFrame(b"made", (320, 240), False, {"analyze": 0.25})
    for sent, made in ((encode_request(frame), frame), (encode_frame(painted), painted)):
        text, data = sent[HEADER.size :][: lengths(sent[: HEADER.size])[0]], sent[-lengths(sent[: HEADER.size])[1] :]
        assert (decode_request if made is frame else decode_frame)(parsed(text), data) == made


def test_the_server_accepts_consecutive_connections(post: LiveWorkerServer) -> None:
    async def act(channel: LiveWorkerClient) -> None:
        channel.analyze(work(b"x"))
        assert (await channel.paint()).data == b"x"

    for _ in range(3):
        run(act, post)


def test_an_unauthenticated_connection_gets_no_answer(post: LiveWorkerServer) -> None:
    async def act(channel: LiveWorkerClient) -> None:
        analyzed, painted = channel.analyze(work(b"x")), channel.paint()
        for awaited in (analyzed, painted):
            with pytest.raises(LiveWorkerLost):
                await awaited

    run(act, post, secret=bytes(SECRET_BYTES))


def test_a_silent_connection_does_not_block_others(post: LiveWorkerServer) -> None:
    async def act(channel: LiveWorkerClient) -> None:
        channel.analyze(work(b"x"))
        assert (await channel.paint()).data == b"x"

    with socket.create_connection(post.address):
        began = time.perf_counter()
        run(act, post)
        assert time.perf_counter() - began < GREET_S + 2


def test_pending_and_later_calls_fail_after_the_peer_dies() -> None:
    async def die(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readexactly(SECRET_BYTES + 8)
        writer.close()

    async def act() -> None:
        server = await asyncio.start_server(die, "127.0.0.1", 0)
        channel = await LiveWorkerClient.connect(server.sockets[0].getsockname()[:2], SECRET)
        for _ in range(2):
            analyzed, painted = channel.analyze(work(b"x")), channel.paint()
            with pytest.raises(LiveWorkerLost):
                await analyzed
            with pytest.raises(LiveWorkerLost):
                await painted
        channel.close()
        server.close()

    asyncio.run(asyncio.wait_for(act(), 20))
