"""Received frames, decoded within bounds.

aiortc decodes frames of any size, and keeps any number of frames that wait to be decoded or to be read. It has no hook
for another decoder, so `install` replaces the function of its decoder threads.
"""

from __future__ import annotations

import asyncio
import queue
import threading
from collections import deque
from concurrent.futures import Future
from functools import partial
from typing import TypeAlias

import av
from aiortc import rtcrtpreceiver
from aiortc.jitterbuffer import JitterFrame
from aiortc.mediastreams import VIDEO_TIME_BASE
from aiortc.rtcrtpparameters import RTCRtpCodecParameters
from av.stream import Stream

from workers.live.codecs import video_context

MOST_UNREAD = 4
"""Decoded frames that wait to be read; further ones are dropped."""
MOST_UNDECODED = 30
"""Received frames that wait to be decoded; if there are more, they are dropped until a new key frame."""

Encoded: TypeAlias = "queue.Queue[tuple[RTCRtpCodecParameters, JitterFrame] | None]"
Decoded: TypeAlias = "asyncio.Queue[av.VideoFrame | None]"


def install(max_side_px: int) -> None:
    """Decode what all connections of this process receive with `decode`."""
    rtcrtpreceiver.decoder_worker = partial(decode, max_side_px)


def decode(
    max_side_px: int, loop: asyncio.AbstractEventLoop, encoded: Encoded, decoded: Decoded, failed: threading.Event
) -> None:
    """Decode frames of one track until None comes. Sound is dropped. A frame of more than `max_side_px`**2 pixels is
    refused before memory is allocated for it.

    Args:
        failed: set to ask the sender for a key frame.
    """
    name, context = "", None
    unread: deque[Future[None]] = deque(maxlen=MOST_UNREAD)
    while (item := encoded.get()) is not None:
        codec, frame = item
        kind, _, wanted = codec.mimeType.lower().partition("/")
        if kind != "video":
            continue
        if encoded.qsize() > MOST_UNDECODED:
            failed.set()
            continue
        if context is None or wanted != name:
            name, context = wanted, video_context(wanted, max_side_px)
        try:
            pictures = context.decode(_packet(frame))
        except (av.FFmpegError, ValueError):
            failed.set()
            continue
        for picture in pictures:
            waiting = decoded.qsize() + sum(not sent.done() for sent in unread)
            if waiting < MOST_UNREAD:
                unread.append(asyncio.run_coroutine_threadsafe(decoded.put(picture), loop))
    asyncio.run_coroutine_threadsafe(decoded.put(None), loop)


def _packet(frame: JitterFrame) -> av.Packet[Stream]:
    packet: av.Packet[Stream] = av.Packet(frame.data)
    packet.pts, packet.time_base = frame.timestamp, VIDEO_TIME_BASE
    return packet
