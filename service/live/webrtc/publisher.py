"""A live session whose frames come over WebRTC (WHIP, RFC 9725). Its viewers receive the painting."""

from __future__ import annotations

import asyncio
import logging
import time
from dataclasses import dataclass, replace

import av
from aiortc.mediastreams import MediaStreamError, MediaStreamTrack
from starlette.concurrency import run_in_threadpool

from pipeline.errors import ImpastoError
from pipeline.frames import MIN_SIDE_PX
from service.access.keys import Principal
from service.live.closing import Ending
from service.live.frames import Header
from service.live.sessions import LiveSession, Sessions
from service.live.viewers import ViewedFrame, ViewFormat
from service.live.webrtc.peers import Peer
from workers.contract.request import Json
from workers.live.model import FilterOrder, LiveOrder, Packet, WireFormat
from workers.live.stream import Answer, Stream

log = logging.getLogger(__name__)

NOMINAL_FPS = 30.0
"""Assumed frame rate, because WebRTC announces none; the stream measures the actual one."""
WIRE = WireFormat(send="raw", receive="h264", fps=NOMINAL_FPS)
TICKS_PER_S = 90_000
"""Ticks per second of the timestamps of viewers' frames; they count from the first frame."""


@dataclass(frozen=True)
class PaintedFrame:
    """Validated painting parameters."""

    method: str
    params: Json
    seed: int
    filter: FilterOrder | None
    adaptive: bool


class Publisher:
    """Runs one session from the first frame until the peer leaves. `service.live.sessions.Connected`.

    Until then it has no slot: an offer costs nothing, and may never be connected.
    """

    def __init__(self, peer: Peer, sessions: Sessions, painting: PaintedFrame, idle_s: float) -> None:
        self._peer, self._sessions, self._painting, self._idle_s = peer, sessions, painting, idle_s
        self._session: LiveSession | None = None
        self._closed = asyncio.Event()
        self._track: asyncio.Future[MediaStreamTrack] = asyncio.get_running_loop().create_future()
        peer.connection.on("track", self._offered)

    def _offered(self, track: MediaStreamTrack) -> None:
        if track.kind == "video" and not self._track.done():
            self._track.set_result(track)

    async def stop(self, ending: Ending) -> None:
        """End the connection. `ending` is only logged: WebRTC has no message for it."""
        log.info("a WebRTC session ends: %s", ending.message)
        await self._peer.close()

    async def wait_closed(self) -> None:
        await self._closed.wait()

    async def run(self, caller: Principal, session_id: str) -> None:
        """Claim a session of that id once the first frame has come, paint until the peer leaves, then end it."""
        work = asyncio.create_task(self._paint(caller, session_id))
        gone = asyncio.create_task(self._peer.closed.wait())
        try:
            await asyncio.wait({work, gone}, return_when=asyncio.FIRST_COMPLETED)
            work.cancel()
            (result,) = await asyncio.gather(work, return_exceptions=True)
            if isinstance(result, Exception) and not isinstance(result, MediaStreamError | TimeoutError):
                log.warning("a WebRTC session failed: %s", result, exc_info=not isinstance(result, ImpastoError))
        finally:
            gone.cancel()
            if self._session is not None:
                self._sessions.end(self._session)
            await self._peer.close()
            self._closed.set()

    async def _paint(self, caller: Principal, session_id: str) -> None:
        track = await self._track
        first = await self._receive(track)
        self._session = session = await self._sessions.claim(None, caller, self, session_id)
        self._peer.in_use()
        stream = await self._open(session, (first.width, first.height))
        works = [asyncio.create_task(work) for work in (self._read(track, first, stream), self._show(session, stream))]
        try:
            done, _ = await asyncio.wait(works, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for each in works:
                each.cancel()
            await asyncio.gather(*works, return_exceptions=True)
        for each in done:
            each.result()

    async def _receive(self, track: MediaStreamTrack) -> av.VideoFrame:
        async with asyncio.timeout(self._idle_s):
            frame = await track.recv()
        assert isinstance(frame, av.VideoFrame), "a video track"
        return frame

    async def _open(self, session: LiveSession, size: tuple[int, int]) -> Stream:
        live, painting = self._sessions.live, self._painting
        order: LiveOrder = live.order(painting.method, painting.params, {}, painting.seed, size, WIRE)
        stream = live.stream(replace(order, filter=painting.filter), painting.adaptive)
        await stream.open()
        session.stream = stream
        session.viewers.announce(ViewFormat(WIRE.receive, size, WIRE.fps))
        return stream

    async def _read(self, track: MediaStreamTrack, frame: av.VideoFrame, stream: Stream) -> None:
        number, side_px = 0, self._sessions.live.limits.side_px
        while True:
            at_s, size = time.perf_counter(), (frame.width, frame.height)
            if min(size) >= MIN_SIDE_PX and max(size) <= side_px:
                data = await run_in_threadpool(_rgb, frame)
                stream.offer(Packet(number, 0, size, True, data, at_s))
                number += 1
            frame = await self._receive(track)

    async def _show(self, session: LiveSession, stream: Stream) -> None:
        began_s = time.perf_counter()
        while (item := await stream.next()) is not None:
            if not isinstance(item, Answer):
                continue
            now_s, packet, painted = time.perf_counter(), item.packet, item.painted
            latency_s, ticks = now_s - packet.at_s, round((packet.at_s - began_s) * TICKS_PER_S)
            header = Header(painted.key, *painted.size, packet.sequence, max(0, ticks), round(latency_s * 1e6))
            session.viewers.show(ViewedFrame(header, painted.data), stream)
            stream.sent(item, latency_s)
            self._sessions.metrics.latency.observe(latency_s)


def _rgb(frame: av.VideoFrame) -> bytes:
    return frame.to_ndarray(format="rgb24").tobytes()
