"""Whether a video file ends before the end that its header announces.

Headers round: a file counts as cut off only if more than two frames, and more than the longest pause between two frames
of the file, are missing; or if its last packet is incomplete.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np
from av.container import InputContainer
from av.video.stream import VideoStream
from numpy.typing import NDArray

from pipeline.video.container import open_container
from pipeline.video.media import Limits

_MOV, _AVI = "mov,mp4,m4a,3gp,3g2,mj2", "avi"
_ANNOUNCING = frozenset({_MOV, _AVI, "matroska,webm", "asf", "flv"})
"""Demuxers that read the length from a header. Others estimate it from the data in the file."""
Gap = tuple[int, int]
"""(frame, count): `count` frames are missing before frame number `frame` of the file."""
_ROUNDED_FRAMES = 2.5
_PAUSES = 1.5
_GAP_FRAMES = 8
_STEADY = 0.95
"""Least share of equal intervals in a video of constant frame rate."""


@dataclass(frozen=True)
class Ending:
    """Measurements of the end of a file.

    Attributes:
        end_s: end of the last frame.
        mean_s, longest_s: mean and longest time between two frames.
        cut: whether the data of a frame are cut off.
    """

    end_s: float
    mean_s: float
    longest_s: float
    cut: bool

    @property
    def tolerated_s(self) -> float:
        """Missing time, seconds, that does not indicate missing frames."""
        return 0.5 * self.mean_s if self.cut else max(_ROUNDED_FRAMES * self.mean_s, _PAUSES * self.longest_s)


def missing_at_end(path: Path, limits: Limits, stream: VideoStream, count: int, ending: Ending | None) -> int:
    """Number of frames that the header announces after the last one of the file.

    Args:
        count: frames of the file.
        ending: None = unknown, so that none are missing.
    """
    name = stream.container.format.name
    if ending is None or name not in _ANNOUNCING:
        return 0
    announced_s = _announced_end_s(stream)
    if announced_s - ending.end_s <= ending.tolerated_s:
        return 0
    of_the_file = name not in (
        _MOV,
        _AVI,
    )  # the header contains the duration of the longest stream, which may be the sound
    if of_the_file and announced_s - _last_end_s(path, limits) <= ending.tolerated_s:
        return 0
    if not of_the_file and stream.frames > count:
        return int(stream.frames) - count
    return max(1, round((announced_s - ending.end_s) / ending.mean_s))


def gaps_between(pts: NDArray[np.int64]) -> tuple[Gap, ...]:
    """Gaps of at least eight missing frames in the middle of a video of constant frame rate.

    This is for containers without a table of frames, where the demuxer skips data that it cannot read.

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
    container = stream.container
    if container.format.name == _AVI and stream.average_rate:
        return float(stream.frames / stream.average_rate)
    if container.format.name == _MOV and stream.duration and stream.time_base:
        return float(((stream.start_time or 0) + stream.duration) * stream.time_base)
    assert isinstance(container, InputContainer)
    return (container.duration or 0) / av.time_base


def _last_end_s(path: Path, limits: Limits) -> float:
    """End of the last packet of any stream, s."""
    last_s = 0.0
    with open_container(path, limits) as container:
        try:
            for packet in container.demux():
                if packet.size and packet.pts is not None and packet.time_base:
                    last_s = max(last_s, float((packet.pts + (packet.duration or 0)) * packet.time_base))
        except (av.FFmpegError, OSError):
            pass
    return last_s
