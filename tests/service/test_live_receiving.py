"""Frames that WebRTC receives: their size is checked before they are decoded, and few of them wait."""

from __future__ import annotations

import asyncio
import queue
import resource
import threading
from fractions import Fraction
from typing import Any

import av
import pytest
from aiortc import rtcrtpreceiver
from aiortc.jitterbuffer import JitterFrame
from aiortc.rtcrtpparameters import RTCRtpCodecParameters
from av.codec.codec import Codec
from av.video.codeccontext import VideoCodecContext

from service.live.webrtc.receiving import MOST_UNREAD, decode, install

ENCODERS = {"VP8": "libvpx", "H264": "libx264"}
FAST = {"VP8": {"deadline": "realtime", "cpu-used": "8", "lag-in-frames": "0"}, "H264": {"preset": "ultrafast"}}


def encoded(codec: str, size: tuple[int, int]) -> bytes:
    """A key frame."""
    context = Codec(ENCODERS[codec], "w").create()
    assert isinstance(context, VideoCodecContext)
    context.width, context.height = size
    context.pix_fmt, context.time_base, context.thread_count = "yuv420p", Fraction(1, 30), 1
    context.options = FAST[codec]
    frame = av.VideoFrame(*size, "yuv420p")
    frame.pts = 0
    return bytes([*context.encode(frame), *context.encode(None)][0])


def codec_of(kind: str, name: str) -> RTCRtpCodecParameters:
    return RTCRtpCodecParameters(mimeType=f"{kind}/{name}", clockRate=90_000, payloadType=96)


def decoded(codec: RTCRtpCodecParameters, payloads: list[bytes], max_side_px: int) -> tuple[list[Any], bool]:
    """What waits after a thread has decoded the payloads, and whether it asks for a key frame."""

    async def run() -> tuple[list[Any], bool]:
        put: Any = queue.Queue()
        got: asyncio.Queue[Any] = asyncio.Queue()
        failed = threading.Event()
        for number, payload in enumerate(payloads):
            put.put((codec, JitterFrame(payload, 3000 * number)))
        put.put(None)
        await asyncio.to_thread(decode, max_side_px, asyncio.get_running_loop(), put, got, failed)
        await asyncio.sleep(0)
        return [got.get_nowait() for _ in range(got.qsize())], failed.is_set()

    return asyncio.run(run())


@pytest.mark.parametrize("name", ENCODERS)
def test_a_received_frame_larger_than_the_limit_is_not_decoded(name: str) -> None:
    payload = encoded(name, (8192, 8192))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    pictures, failed = decoded(codec_of("video", name), [payload] * 3, 1920)
    assert (pictures, failed) == ([None], True)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50 << 10, "KiB; a picture has 100 MB"


@pytest.mark.parametrize("name", ENCODERS)
def test_few_received_frames_wait(name: str) -> None:
    payload = encoded(name, (64, 48))
    pictures, _ = decoded(codec_of("video", name), [payload] * 20, 1920)
    # a picture that is on its way between the threads may be counted twice or not at all
    assert MOST_UNREAD <= len(pictures) <= MOST_UNREAD + 2 and pictures[-1] is None
    assert {(picture.width, picture.height) for picture in pictures[:-1]} == {(64, 48)}
    late, failed = decoded(codec_of("video", name), [payload] * 2000, 1920)
    assert len(late) <= MOST_UNREAD + 2 and failed


def test_sound_is_not_decoded() -> None:
    assert decoded(codec_of("audio", "opus"), [b"x"] * 500, 1920) == ([None], False)


def test_the_decoder_is_the_one_that_aiortc_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rtcrtpreceiver, "decoder_worker", rtcrtpreceiver.decoder_worker)
    install(640)
    started: Any = rtcrtpreceiver.decoder_worker
    assert (started.func, started.args) == (decode, (640,))
