"""The painting of a live session as a WebRTC stream (WHEP)."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager
from fractions import Fraction

import av
from aiortc import RTCRtpSender
from aiortc.mediastreams import MediaStreamError, MediaStreamTrack
from av.stream import Stream
from starlette.concurrency import run_in_threadpool

from service.live.viewers import ViewedFrame, ViewedSound, Viewer, Viewers, ViewFormat
from service.live.webrtc.peers import Peer
from workers.live.codecs import BUILT_ON, Decoder, decoder

CLOCK = Fraction(1, 90_000)
"""Duration of a tick of RTP video (RFC 6184), seconds."""
MIME = {"h264": "video/h264", "vp8": "video/vp8"}


class PaintingTrack(MediaStreamTrack):
    """The frames of a session as a WebRTC track. If the player accepts their codec, they are passed on unchanged;
    otherwise they are decoded, and aiortc encodes them again.

    Args:
        passed: codec of frames that are passed on unchanged, or "".
    """

    kind = "video"

    def __init__(self, viewers: Viewers, passed: str, max_side_px: int) -> None:
        super().__init__()
        self._watching: AbstractContextManager[Viewer] = viewers.watch()
        self._viewer = self._watching.__enter__()
        self._passed, self._max_side_px = passed, max_side_px
        self._decoder: Decoder | None = None
        self._began_s, self._last = time.perf_counter(), -1

    async def recv(self) -> av.VideoFrame | av.Packet[Stream]:
        """The next frame. Raises MediaStreamError: the session has ended, or continues in another codec."""
        while (item := await self._viewer.next()) is not None:
            if isinstance(item, ViewedFrame):
                return await self._made(item)
            if isinstance(item, ViewedSound):
                continue
            if self._passed and item.codec != self._passed:
                break
            self._decoder = None if self._passed else decoder(item.codec, self._max_side_px)
        self.stop()
        raise MediaStreamError

    async def _made(self, frame: ViewedFrame) -> av.VideoFrame | av.Packet[Stream]:
        made: av.VideoFrame | av.Packet[Stream]
        if self._decoder is None:
            made = av.Packet(frame.payload)
        else:
            size = (frame.header.width, frame.header.height)
            picture = await run_in_threadpool(self._decoder.decode, frame.payload, size)
            made = av.VideoFrame.from_ndarray(picture, format="rgb24")
        self._last = max(self._last + 1, round((time.perf_counter() - self._began_s) / CLOCK))
        made.pts, made.time_base = self._last, CLOCK
        return made

    def stop(self) -> None:
        if self.readyState == "live":
            self._watching.__exit__(None, None, None)
        super().stop()


def play(peer: Peer, viewers: Viewers, form: ViewFormat, offer: str, max_side_px: int) -> None:
    """Send the frames of a session to a peer; call before the offer is answered."""
    passed = form.codec if form.codec in BUILT_ON and MIME[form.codec].rpartition("/")[2] in offer.lower() else ""
    track = PaintingTrack(viewers, passed, max_side_px)
    transceiver = peer.connection.addTransceiver(track, direction="sendonly")
    if passed:
        known = RTCRtpSender.getCapabilities("video").codecs
        transceiver.setCodecPreferences([codec for codec in known if codec.mimeType.lower() == MIME[passed]])
    track.on("ended", peer.closed.set)
