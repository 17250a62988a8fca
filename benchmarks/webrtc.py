"""Latency and loss of frames sent with WHIP, painted, and played with WHEP: real WebRTC connections over loopback.

    python -m benchmarks.webrtc --seconds 600                         an acceptance run, 640x480 at 30 fps
    python -m benchmarks.webrtc --size 352x288@30 --filter steady     another size; a filter behind abstraction
    python -m benchmarks.webrtc --server http://127.0.0.1:8420        a running service

A row of black and white squares at the top of every frame encodes its number. Latency is measured from the time at
which the sender passes a frame to its encoder to the time at which the player has decoded the painting, and so includes
both encoders, the network and the player's jitter buffer. A frame is lost if the player never shows it, including
frames that the service drops for a newer one. Sender and player use aiortc and share the processors with the service.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from fractions import Fraction

import av
import httpx
import numpy as np
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription, VideoStreamTrack
from aiortc.mediastreams import MediaStreamError, MediaStreamTrack

from benchmarks.clips import clip
from benchmarks.live import service
from pipeline.frames import Frame

BITS = 12
"""Number of squares that encode a frame's number; numbers repeat after 4,096 frames."""
CLIP_FRAMES = 60
SETTLE_S = 5.0
"""Seconds at the start that are not counted, while connections are made and encoders adapt their bit rates."""
ANSWER_S = 20.0
_SDP = {"Content-Type": "application/sdp"}
_SQUARE_GRAY = 128


@dataclass
class Figures:
    """Measurements of one run."""

    sent: dict[int, float] = field(default_factory=dict)
    """Time at which a frame was handed to the encoder, s, by its number."""
    latencies_s: list[float] = field(default_factory=list)
    """Latencies in the order in which frames were shown."""
    seen: set[int] = field(default_factory=set)

    def shown(self, number: int, now: float, since: float) -> None:
        """The player has decoded frame `number` (modulo 4,096)."""
        newest = len(self.sent) - 1
        frame = newest - (newest - number) % (1 << BITS)
        began = self.sent.get(frame)
        if began is None or began < since or frame in self.seen:
            return
        self.seen.add(frame)
        self.latencies_s.append(now - began)

    def row(self, since: float, until: float) -> str:
        """Frames sent in [since, until), lost ones, and percentiles of the latency."""
        counted = [frame for frame, at in self.sent.items() if since <= at < until]
        lost = sum(1 for frame in counted if frame not in self.seen)
        if not self.latencies_s:
            return f"{len(counted)} frames sent, none shown"
        p50, p95, p99 = (1e3 * float(np.percentile(self.latencies_s, p)) for p in (50, 95, 99))
        worst, part = 1e3 * max(self.latencies_s), max(1, len(self.latencies_s) // 10)
        first, last = (1e3 * float(np.median(each)) for each in (self.latencies_s[:part], self.latencies_s[-part:]))
        return (
            f"{len(counted)} frames sent, {lost} lost ({lost / max(1, len(counted)):.2%}); latency p50 {p50:.0f} ms, "
            f"p95 {p95:.0f} ms, p99 {p99:.0f} ms, longest {worst:.0f} ms; median of the first "
            f"tenth {first:.0f} ms, of the last {last:.0f} ms"
        )


class NumberedClip(VideoStreamTrack):
    """A clip at a constant frame rate; each frame carries its number."""

    def __init__(self, frames: Sequence[Frame], fps: float, figures: Figures) -> None:
        super().__init__()
        self._frames, self._fps, self._figures = frames, fps, figures
        self._began = time.perf_counter()

    async def recv(self) -> av.VideoFrame:
        number = len(self._figures.sent)
        await asyncio.sleep(max(0.0, self._began + number / self._fps - time.perf_counter()))
        picture = numbered(self._frames[number % len(self._frames)], number)
        frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
        frame.pts, frame.time_base = round(90_000 * number / self._fps), Fraction(1, 90_000)
        self._figures.sent[number] = time.perf_counter()
        return frame


def numbered(frame: Frame, number: int) -> Frame:
    """The frame with `number` (modulo 4,096) as black and white squares along its upper edge."""
    out = frame.copy()
    for bit, (rows, columns) in enumerate(_squares(frame.shape[1])):
        out[rows, columns] = 255 * (number >> bit & 1)
    return out


def number_of(frame: Frame) -> int:
    """Read a frame's number; also works after painting and encoding."""
    squares = (frame[rows, columns] for rows, columns in _squares(frame.shape[1]))
    inner = (square[square.shape[0] // 4 : -(square.shape[0] // 4), 2:-2] for square in squares)
    return sum(int(square.mean() > _SQUARE_GRAY) << bit for bit, square in enumerate(inner))


def _squares(width: int) -> Iterator[tuple[slice, slice]]:
    side = width // BITS
    for bit in range(BITS):
        yield slice(0, side), slice(bit * side, (bit + 1) * side)


async def run(address: str, size: tuple[int, int], fps: float, seconds: float, query: str) -> str:
    """Send and play for `SETTLE_S` and then for `seconds`; the row of figures."""
    figures = Figures()
    peers = [RTCPeerConnection(RTCConfiguration(iceServers=[])) for _ in range(2)]
    sender, player = peers
    async with httpx.AsyncClient(base_url=address, timeout=ANSWER_S) as http:
        sender.addTrack(NumberedClip(clip(size, CLIP_FRAMES), fps, figures))
        session = await _connect(http, sender, f"/v1/live/whip?{query}")
        player.addTransceiver("video", direction="recvonly")
        await _connect(http, player, f"/v1/live/whep?session={session}")
        since = time.perf_counter() + SETTLE_S
        watching = asyncio.create_task(_watch(player.getReceivers()[0].track, figures, since))
        await asyncio.sleep(SETTLE_S + seconds)
        until = time.perf_counter()
        await asyncio.sleep(2)
        watching.cancel()
        for peer in peers:
            await peer.close()
    return figures.row(since, until)


async def _connect(http: httpx.AsyncClient, peer: RTCPeerConnection, path: str) -> str:
    """Connect with an SDP offer; the id of the session. A player waits until the session has its first frame."""
    await peer.setLocalDescription(await peer.createOffer())
    deadline = time.monotonic() + ANSWER_S
    while True:
        answer = await http.post(path, content=peer.localDescription.sdp, headers=_SDP)
        if answer.status_code == 201:
            break
        if time.monotonic() > deadline:
            sys.exit(f"{path}: {answer.status_code} {answer.text}")
        await asyncio.sleep(0.2)
    await peer.setRemoteDescription(RTCSessionDescription(answer.text, "answer"))
    return str(answer.headers.get("Impasto-Session", ""))


async def _watch(track: MediaStreamTrack, figures: Figures, since: float) -> None:
    try:
        while True:
            frame = await track.recv()
            if isinstance(frame, av.VideoFrame):
                picture = np.asarray(frame.to_ndarray(format="rgb24"), np.uint8)
                figures.shown(number_of(picture), time.perf_counter(), since)
    except MediaStreamError:
        return


@contextmanager
def _service(given: str | None) -> Iterator[str]:
    if given:
        yield given
        return
    with service("local") as (address, _):
        yield address


def main(arguments: list[str] | None = None) -> None:
    """Print one row."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.webrtc")
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--size", default="640x480@30", help="WIDTHxHEIGHT@FPS")
    parser.add_argument("--filter", choices=("steady",), help="behind abstraction")
    parser.add_argument("--server", help="address of a running service; one is started if omitted")
    options = parser.parse_args(arguments or [])
    width, _, rest = options.size.partition("x")
    height, _, fps = rest.partition("@")
    query = "method=abstraction" + (f"&filter={options.filter}" if options.filter else "")
    with _service(options.server) as address:
        size = (int(width), int(height))
        print(f"{options.size}: " + asyncio.run(run(address, size, float(fps or 30), options.seconds, query)))


if __name__ == "__main__":
    main(sys.argv[1:])
