"""WebRTC clients for tests, made with aiortc: a WHIP sender like OBS, and a WHEP player."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from fractions import Fraction

import av
import httpx
import numpy as np
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription, VideoStreamTrack
from aiortc.mediastreams import MediaStreamTrack
from numpy.typing import NDArray

SDP = {"Content-Type": "application/sdp"}


class Camera(VideoStreamTrack):
    """Gray frames; the brightness of the left half counts frames, in steps of 8 gray levels."""

    def __init__(self, size: tuple[int, int], fps: int) -> None:
        super().__init__()
        self._size, self._fps, self.sent = size, fps, 0
        self.times: list[float] = []
        self._began = time.perf_counter()

    async def recv(self) -> av.VideoFrame:
        await asyncio.sleep(max(0.0, self._began + self.sent / self._fps - time.perf_counter()))
        picture: NDArray[np.uint8] = np.full((self._size[1], self._size[0], 3), 128, np.uint8)
        picture[:, : self._size[0] // 2] = 8 * (self.sent % 31)
        frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
        frame.pts, frame.time_base = round(90_000 * self.sent / self._fps), Fraction(1, 90_000)
        self.sent += 1
        self.times.append(time.perf_counter())
        return frame


def counted(frame: av.VideoFrame) -> int:
    """The number of a frame of `Camera`, modulo 31."""
    left = frame.to_ndarray(format="gray")[:, : frame.width // 4]
    return round(float(left.mean()) / 8) % 31


async def offered(peer: RTCPeerConnection) -> str:
    await peer.setLocalDescription(await peer.createOffer())
    return peer.localDescription.sdp


async def accept(peer: RTCPeerConnection, answer: httpx.Response) -> str:
    """Accept the answer to an offer; the path of the connection's resource."""
    assert answer.status_code == 201, answer.text
    assert answer.headers["Content-Type"].startswith("application/sdp")
    await peer.setRemoteDescription(RTCSessionDescription(answer.text, "answer"))
    return answer.headers["Location"]


@asynccontextmanager
async def sending(http: httpx.AsyncClient, track: MediaStreamTrack, query: str = "") -> AsyncIterator[httpx.Response]:
    """A WHIP client that sends the track until the block ends."""
    peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    peer.addTrack(track)
    answer = await http.post(f"/v1/live/whip{query}", content=await offered(peer), headers=SDP)
    resource = await accept(peer, answer)
    try:
        yield answer
    finally:
        assert (await http.delete(resource)).status_code in (200, 404)
        await peer.close()


@asynccontextmanager
async def playing(http: httpx.AsyncClient, query: str = "") -> AsyncIterator[MediaStreamTrack]:
    """The track of a WHEP player."""
    peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    peer.addTransceiver("video", direction="recvonly")
    answer = await http.post(f"/v1/live/whep{query}", content=await offered(peer), headers=SDP)
    resource = await accept(peer, answer)
    try:
        yield peer.getReceivers()[0].track
    finally:
        assert (await http.delete(resource)).status_code in (200, 404)
        await peer.close()
