"""The sink that publishes to a WHIP server (WebRTC, RFC 9725). Needs the extra `webrtc` (aiortc).

FFmpeg's own WHIP muxer is not used: version 8.1 and aiortc fail to agree in the DTLS handshake.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine
from contextlib import suppress
from fractions import Fraction
from typing import TypeVar
from urllib.parse import urljoin

import av
import httpx

from impasto.live.broadcast import OutputLost
from impasto.live.sink import Sink, upscaled
from impasto.live.sources import Size
from pipeline.errors import BadInput
from pipeline.frames import Frame

try:
    from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
    from aiortc.mediastreams import MediaStreamError, MediaStreamTrack
except ModuleNotFoundError as missing:
    raise BadInput(
        f"WHIP needs {missing.name}.", field="--output", remedy="Install it: pip install 'impasto[webrtc]'."
    ) from None

CLOCK = Fraction(1, 90_000)
"""Duration of a tick of RTP video, seconds."""
CONNECT_S = 10.0
"""Longest time for the offer and its answer, and for the connection, seconds."""
T = TypeVar("T")


class _Newest(MediaStreamTrack):
    """A track with the newest frame that was put. For the event loop only."""

    kind = "video"

    def __init__(self) -> None:
        super().__init__()
        self._frames: asyncio.Queue[av.VideoFrame | None] = asyncio.Queue(1)

    def put(self, frame: av.VideoFrame | None) -> None:
        if self._frames.full():
            self._frames.get_nowait()
        self._frames.put_nowait(frame)

    async def recv(self) -> av.VideoFrame:
        frame = await self._frames.get()
        if frame is None:
            self.stop()
            raise MediaStreamError
        return frame


class WhipSink(Sink):
    """Publishes frames to `whip://host/path` (HTTP) or `whips://host/path` (HTTPS); `?token=` becomes a bearer token.

    aiortc encodes on threads of its own. A frame that waits for it is replaced by the next.

    Raises: BadInput (no server there, or it refuses); `put`, OutputLost.
    """

    def __init__(self, address: str, size: Size) -> None:
        self._address, self._size = address, (size[0] - size[0] % 2, size[1] - size[1] % 2)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="impasto-whip", daemon=True)
        self._thread.start()
        self._last, self._lost = -1, False
        try:
            self._run(self._connect())
        except BaseException:
            self._end()
            raise

    async def _connect(self) -> None:
        url = httpx.URL(self._address.replace("whip", "http", 1))
        token = url.params.get("token", "")
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._peer, self._track = RTCPeerConnection(RTCConfiguration(iceServers=[])), _Newest()
        self._connected = asyncio.Event()
        self._peer.on("connectionstatechange", self._changed)
        self._peer.addTransceiver(self._track, direction="sendonly")
        await self._peer.setLocalDescription(await self._peer.createOffer())
        try:
            self._resource = await self._publish(url.copy_remove_param("token"))
            async with asyncio.timeout(CONNECT_S):
                await self._connected.wait()
        except (httpx.HTTPError, TimeoutError, BadInput) as error:
            await self._peer.close()
            if isinstance(error, BadInput):
                raise
            raise self._refused(str(error) or "no connection in time") from None

    async def _publish(self, url: httpx.URL) -> str:
        """Send the offer, accept the answer; the address of the resource that ends the session."""
        headers = {"Content-Type": "application/sdp", **self._headers}
        async with httpx.AsyncClient(timeout=CONNECT_S, follow_redirects=True) as http:
            answer = await http.post(url, content=self._peer.localDescription.sdp, headers=headers)
        if answer.status_code != 201:
            raise self._refused(f"it answers {answer.status_code} {answer.text[:200]}")
        await self._peer.setRemoteDescription(RTCSessionDescription(answer.text, "answer"))
        return urljoin(str(answer.url), str(answer.headers.get("Location", "")))

    def _refused(self, why: str) -> BadInput:
        return BadInput(
            f"It cannot be streamed to: {why}.", field="--output", value=self._address,
            remedy="Check the address and its token, and that the server accepts WHIP there.",
        )  # fmt: skip

    def _changed(self) -> None:
        state = self._peer.connectionState
        if state == "connected":
            self._connected.set()
        self._lost = state in ("failed", "closed")

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> None:
        if self._lost:
            raise OutputLost(
                "The WebRTC connection is lost.", field="--output", value=self._address,
                remedy="Check the server and the network, then start again.",
            )  # fmt: skip
        at = round(when_s / CLOCK)
        if at > self._last:
            picture = av.VideoFrame.from_ndarray(upscaled(frame, self._size), format="rgb24")
            picture.pts, picture.time_base, self._last = at, CLOCK, at
            self._loop.call_soon_threadsafe(self._track.put, picture)

    def finish(self, end_s: float) -> str:
        if not self._lost:
            self._run(self._leave())
        self._end()
        return self._address

    async def _leave(self) -> None:
        async with httpx.AsyncClient(timeout=CONNECT_S) as http:
            with suppress(httpx.HTTPError):  # the server notices that the connection is closed
                await http.delete(self._resource, headers=self._headers)
        self._track.put(None)
        await self._peer.close()

    def _run(self, work: Coroutine[object, None, T]) -> T:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    def _end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(CONNECT_S)
