"""The frame index of a video: presentation times of its frames, read without decoding."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import av
import numpy as np
from av.container import InputContainer
from av.stream import Discard
from av.video.stream import VideoStream
from numpy.typing import NDArray

from pipeline.video.container import open_container, video_stream
from pipeline.video.media import SEQUENCE_FPS, Limits
from pipeline.video.truncation import Ending, Gap, gaps_between, missing_at_end

_SEEKABLE = ("mov,mp4,m4a,3gp,3g2,mj2", "matroska,webm", "avi")
"""Demuxers that give the same times after a seek as in a read from the start."""


@dataclass(frozen=True)
class Index:
    """Presentation times of the frames of a video, in display order.

    `exact`: every frame has a time of its own, and the index of a decoded picture is the rank of its time. Otherwise
    `pts` is generated at the nominal rate, and the number of frames is an estimate.
    """

    pts: NDArray[np.int64]
    """Ticks of `time_base`, strictly increasing."""
    keys: NDArray[np.int64]
    """Frame indices at which decoding can start; decoding can always start at 0."""
    end: int
    """End of the last frame, ticks."""
    time_base: Fraction
    """Duration of a tick, seconds."""
    exact: bool
    missing: tuple[Gap, ...] = ()
    """Where frames are missing that the file should have."""
    incomplete: frozenset[int] = frozenset()
    """Indices of frames whose data are cut off."""
    numbers: tuple[int, ...] = ()
    """Numbers of the frames of an image sequence; empty: frames are counted from 0."""

    @property
    def duration_s(self) -> float:
        return float((self.end - int(self.pts[0])) * self.time_base) if len(self.pts) else 0.0

    @property
    def fps(self) -> float:
        """Mean frame rate, frames per second. Excludes the duration of the last frame, which some files prolong."""
        steps, seconds = len(self.pts) - 1, float((int(self.pts[-1]) - int(self.pts[0])) * self.time_base)
        return steps / seconds if steps > 0 else float(SEQUENCE_FPS)

    def time(self, frame: int) -> int:
        """Start of `frame`, ticks; frames beyond the end have the duration of the last frame."""
        if frame < len(self.pts):
            return int(self.pts[frame])
        last = self.end - int(self.pts[-1])
        return self.end + (frame - len(self.pts)) * last

    def number(self, frame: int) -> int:
        """Number of a frame in the source: in file names of an image sequence, otherwise its index."""
        return self.numbers[frame] if frame < len(self.numbers) else frame

    def key_before(self, frame: int) -> int:
        """The last frame at or before `frame` at which decoding can start."""
        return int(self.keys[np.searchsorted(self.keys, frame, side="right") - 1])


def build_index(path: Path, limits: Limits) -> Index:
    """Build the index from the packets of the video stream, without decoding. Raises UnreadableMedia, NoVideoStream."""
    with open_container(path, limits) as container:
        stream = video_stream(container)
        for other in container.streams:
            if other.index != stream.index:
                other.discard = Discard.all
        packets = list(_shown(container, stream))
        seekable = container.format.name in _SEEKABLE
        index = _index(packets, stream, seekable)
        return replace(
            index,
            missing=_missing(path, limits, packets, stream, index),
            incomplete=_incomplete(packets),
        )


class _Packet(NamedTuple):
    pts: int | None
    time: int | None
    """`pts`, or for want of it the decoding time."""
    duration: int
    key: bool
    incomplete: bool


def _shown(container: InputContainer, stream: VideoStream) -> Iterator[_Packet]:
    """Every packet that yields a picture."""
    vp8 = stream.codec_context.name in ("vp8", "libvpx")
    try:
        for packet in container.demux(stream):
            hidden = packet.is_discard or (vp8 and packet.size > 0 and not memoryview(packet)[0] & 0x10)
            if packet.size and not hidden:
                time = packet.dts if packet.pts is None else packet.pts
                yield _Packet(packet.pts, time, packet.duration or 0, packet.is_keyframe, packet.is_corrupt)
    except (av.FFmpegError, OSError):
        return  # truncated file: use the packets read so far


def _index(packets: list[_Packet], stream: VideoStream, seekable: bool) -> Index:
    times = [packet.pts for packet in packets]
    if packets and None not in times and len(set(times)) == len(times):
        return _exact(packets, stream.time_base or Fraction(1, 1000), seekable)
    return _estimated(len(packets), stream.average_rate or stream.guessed_rate or Fraction(SEQUENCE_FPS))


def _exact(packets: list[_Packet], time_base: Fraction, seekable: bool) -> Index:
    table = sorted(packets, key=lambda packet: packet.pts or 0)
    pts = np.array([packet.pts for packet in table], np.int64)
    keys = np.flatnonzero([packet.key for packet in table]).astype(np.int64) if seekable else np.empty(0, np.int64)
    usual = int(np.median(np.diff(pts))) if len(pts) > 1 else max(1, round(1 / SEQUENCE_FPS / time_base))
    last = table[-1].duration or usual
    return Index(pts, np.union1d([0], keys), int(pts[-1]) + last, time_base, True)


def _estimated(count: int, rate: Fraction) -> Index:
    """Index of frames without times: `count` frames at the nominal rate."""
    return Index(np.arange(count, dtype=np.int64), np.zeros(1, np.int64), count, 1 / rate, False)


def _incomplete(packets: list[_Packet]) -> frozenset[int]:
    """Frames whose packets the demuxer marks as cut off."""
    return frozenset(number for number, packet in enumerate(_by_time(packets)) if packet.incomplete)


def _by_time(packets: list[_Packet]) -> list[_Packet]:
    return sorted(packets, key=lambda packet: packet.time or 0)


def _missing(path: Path, limits: Limits, packets: list[_Packet], stream: VideoStream, index: Index) -> tuple[Gap, ...]:
    count = len(packets)
    last = missing_at_end(path, limits, stream, count, _ending(packets, stream, index))
    within = gaps_between(index.pts) if index.exact and stream.container.format.name == "matroska,webm" else ()
    return (*within, (count, last)) if last else within


def _ending(packets: list[_Packet], stream: VideoStream, index: Index) -> Ending | None:
    """The ending of the file's frames; None if their times are unknown."""
    times = [packet.time for packet in packets if packet.time is not None]
    if len(times) < max(1, len(packets)) or stream.time_base is None:
        return None
    last = max(packet.time + packet.duration for packet in packets if packet.time is not None)
    pauses = np.diff(np.sort(np.array(times, np.int64)))
    tick_s = float(stream.time_base)
    return Ending(
        end_s=max(last, index.end if index.exact else last) * tick_s,
        mean_s=1 / index.fps,
        longest_s=float(pauses.max(initial=0)) * tick_s,
        cut=any(packet.incomplete for packet in packets),
    )
