"""Whether a video file is cut off or has holes, as the demuxer reports it, and how many frames are missing then.

Neither a pause nor a header that announces more than there is counts as damage by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import av
import av.logging
import numpy as np
from av.container import InputContainer
from av.video.stream import VideoStream
from numpy.typing import NDArray

from pipeline.video.container import AVI, MATROSKA, MOV, logging_at
from pipeline.video.index import Gap, Index

_FLV = "flv"
_GAP_FRAMES = 1.5
_STEADY = 0.9
"""Least share of equal intervals in a video of constant frame rate."""


@dataclass(frozen=True)
class Reading:
    """Facts from reading all packets.

    Attributes:
        packets: number of packets with a picture.
        last_incomplete: whether the last of them is marked as incomplete.
        end_s: end of the last packet of any stream, seconds.
        errors: see `reported_errors`.
    """

    packets: int
    last_incomplete: bool
    end_s: float
    errors: list[str]


@contextmanager
def reported_errors(container: InputContainer) -> Iterator[list[str]]:
    """The errors that the Matroska demuxer reports within the block. Other demuxers mark the packets instead."""
    found: list[str] = []
    if container.format.name != MATROSKA:
        yield found
        return
    with logging_at(av.logging.ERROR), av.logging.Capture() as logs:
        yield found
    found += [text.strip() for _level, name, text in logs if name == MATROSKA]


def is_cut_off(path: Path, stream: VideoStream, index: Index, read: Reading) -> bool:
    """Whether the demuxer finds the end of the file within its data."""
    if read.last_incomplete or any("prematurely" in error for error in read.errors):
        return True
    if stream.container.format.name == MOV:
        size, entries = path.stat().st_size, stream.index_entries
        return any(entries[at].pos + entries[at].size > size for at in range(max(0, len(entries) - 2), len(entries)))
    if stream.container.format.name == AVI:
        return len(stream.index_entries) > read.packets
    return stream.container.format.name == _FLV and _ends_early(stream, index, read)


def _ends_early(stream: VideoStream, index: Index, read: Reading) -> bool:
    """Whether an FLV file, whose demuxer does not report a cut, ends long before its header says."""
    if not len(index.pts):
        return False
    pause_s = float(np.diff(index.pts).max(initial=0) * index.time_base)
    return _announced_end_s(stream) - read.end_s > max(2.5 / index.fps, 1.5 * pause_s)


def missing_frames(stream: VideoStream, index: Index, cut: bool, read: Reading) -> tuple[Gap, ...]:
    """Missing frames of a file that is cut off or has holes, from its header and from its frame rate."""
    if not index.exact or not len(index.pts):
        return ()
    holes = gaps_between(index.pts) if read.errors else ()
    announced = int(stream.frames) - read.packets
    if announced <= 0 and index.fps:
        end_s = float(index.end * index.time_base)
        announced = round((_announced_end_s(stream) - end_s) * index.fps)
    return (*holes, (len(index.pts), announced)) if cut and announced > 0 else holes


def gaps_between(pts: NDArray[np.int64]) -> tuple[Gap, ...]:
    """Steps that are longer than one and a half usual ones, as missing frames; none if the frame rate varies.

    Args:
        pts: presentation times, ticks, ascending.
    """
    steps = np.diff(pts)
    usual = float(np.median(steps)) if len(steps) else 0.0
    if not usual or np.mean(np.abs(steps - usual) <= 0.2 * usual + 1) < _STEADY:
        return ()
    places = np.flatnonzero(steps > _GAP_FRAMES * usual)
    return tuple((int(place) + 1, round(float(steps[place]) / usual) - 1) for place in places)


def _announced_end_s(stream: VideoStream) -> float:
    """End of the video according to the header, s; 0: unknown."""
    if stream.duration and stream.time_base:
        return float(((stream.start_time or 0) + stream.duration) * stream.time_base)
    container = stream.container
    assert isinstance(container, InputContainer)
    return (container.duration or 0) / av.time_base
