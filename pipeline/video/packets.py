"""Decoding of packets, and the times of the pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

import av
from av.container import InputContainer
from av.packet import Packet
from av.video.codeccontext import VideoCodecContext
from av.video.stream import VideoStream

from pipeline.video.container import AVI
from pipeline.video.timeline import timed_packets


class BestTimes:
    """Best-effort times of decoded pictures in the order of display: presentation times, unless more of them than of
    the decoding times go back. Source: `guess_correct_pts` in FFmpeg's libavcodec/decode.c."""

    def __init__(self, trusts_pts: bool = True) -> None:
        self._faults = [0 if trusts_pts else 1 << 30, 0]
        self._last: list[int | None] = [None, None]

    def next(self, picture: av.VideoFrame) -> int | None:
        """The time of the next picture, ticks of the stream."""
        for at, time in enumerate((picture.pts, picture.dts)):
            last = self._last[at]
            if time is not None:
                self._faults[at] += last is not None and time <= last
                self._last[at] = time
        if picture.pts is not None and (self._faults[0] <= self._faults[1] or picture.dts is None):
            return picture.pts
        return picture.dts


def decoded(
    packets: Iterator[Packet[Any]], decoder: VideoCodecContext, failed: Callable[[Packet[Any], str], None]
) -> Iterator[av.VideoFrame]:
    """The pictures of the packets, of which an empty one without a time is the last.

    Args:
        failed: called for a packet that cannot be decoded; may raise.
    """
    for packet in packets:
        last = packet.pts is None and not packet.size
        if not packet.size and not last:
            continue
        try:
            pictures = decoder.decode(None if last else packet)
        except (av.FFmpegError, ValueError) as error:
            failed(packet, str(error))
            continue
        yield from pictures


def decoded_times(container: InputContainer, stream: VideoStream, decoder: VideoCodecContext) -> list[int | None]:
    """Times of all pictures in the order of display, ticks of the stream, corrected; None: unknown."""
    tick, avi = stream.time_base or Fraction(1, 1000), container.format.name == AVI
    best, found, places = BestTimes(trusts_pts=not avi), list[int | None](), list[int]()
    decoder.copy_opaque = True
    usual = max(1, round(1 / (Fraction(stream.average_rate or 25) * tick)))

    def packets() -> Iterator[Packet[Any]]:
        try:
            for packet, shift_us in timed_packets(container, [stream]):
                packet.opaque = shift_us
                if packet.dts is not None and packet.size:
                    places.append(packet.dts + round(Fraction(shift_us, 1_000_000) / tick))
                yield packet
        except (av.FFmpegError, OSError):
            yield Packet()

    for picture in decoded(packets(), decoder, lambda packet, why: None):
        time = best.next(picture) if not avi or picture.dts is not None else None
        if time is None:  # the last pictures of a stream without presentation times
            found.append(found[-1] + usual if found and found[-1] is not None else None)
        else:
            found.append(time + round(Fraction(int(str(picture.opaque or 0)), 1_000_000) / tick))
    if avi and len(places) == len(found):  # a picture's time is its place
        return [*places]
    if avi and places and found and found[0] is not None:  # B-frames delay all of them
        delay = found[0] - places[0]
        return [None if time is None else time - delay for time in found]
    return found
