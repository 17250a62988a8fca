"""Builds the index of a video.

Times come from the packets, without decoding, where each packet holds one picture and its time. Other files (AVI with
B-frames, fields in packets of their own, streams without times) are decoded once, if that is quick; FFmpeg's
best-effort times are used.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import av
import numpy as np
from av.container import InputContainer
from av.video.stream import VideoStream
from numpy.typing import NDArray

from pipeline.video.container import (
    AVI,
    MATROSKA,
    MOV,
    MPEGTS,
    choice_notes,
    decoder_of,
    open_container,
    video_stream,
)
from pipeline.video.index import Index
from pipeline.video.media import SEQUENCE_FPS, Limits, Note, SourceOptions
from pipeline.video.packets import decoded_times
from pipeline.video.timeline import Timeline, timed_packets
from pipeline.video.truncation import Reading, is_cut_off, missing_frames, reported_errors

_SEEKABLE = (MOV, MATROSKA, AVI)
"""Demuxers that give the same times after a seek as in a read from the start."""
_HIDING = ("vp8", "vp9", "av1", "libvpx", "libvpx-vp9", "libdav1d")
"""Decoders of codecs with pictures that only serve as references."""
_DECODED_PIXELS = 8_000_000_000
"""A video of at most this size, pixels of all pictures, is decoded for its times: about 20 s on one core."""
_FINEST = 1000
"""Most ticks that a tick is divided into, to give pictures of equal times different ones."""


def build_index(path: Path, limits: Limits, options: SourceOptions | None = None) -> Index:
    """Build the index. Raises UnreadableMedia, NoVideoStream, BadParameter (there is no such stream)."""
    options = options or SourceOptions()
    with open_container(path, limits) as container:
        stream = video_stream(container, options.picture)
        timeline = Timeline(container)
        with reported_errors(container) as errors:
            packets = _shown(container, stream, timeline)
        index = _index(packets, container, stream)
        if (index is None or _may_hide(packets, stream)) and _is_quick(packets, stream):
            index = _decoded(path, limits, options)
        index = index or _estimated(len(packets), stream)
        read = Reading(len(packets), bool(packets) and packets[-1].incomplete, timeline.end_s, errors)
        cut = is_cut_off(path, stream, index, read)
        index = replace(
            index,
            missing=missing_frames(stream, index, cut, read),
            incomplete=_incomplete(packets, len(index.pts)),
        )
        notes = (*choice_notes(container, stream), *_correction_note(timeline.corrections), *index.notes)
        index = replace(index, notes=notes)
        return index.without_holes() if container.format.name == AVI and _is_steady(index, limits) else index


def _is_steady(index: Index, limits: Limits) -> bool:
    """Whether frames take one tick each: an empty chunk, or a picture that is not coded, leaves a hole in an AVI."""
    steps = np.diff(index.pts)
    return index.exact and len(steps) > 0 and bool(np.median(steps) == 1) and int(steps.sum()) < limits.frames


class _Packet(NamedTuple):
    pts: int | None
    time: int | None
    """`pts`, or for want of it the decoding time, which in AVI is the place; in ticks, corrected."""
    duration: int
    key: bool
    incomplete: bool


def _shown(container: InputContainer, stream: VideoStream, timeline: Timeline) -> list[_Packet]:
    """Every packet that yields a picture."""
    vp8, broadcast = stream.codec_context.name in ("vp8", "libvpx"), container.format.name == MPEGTS
    avi = container.format.name == AVI  # its presentation times are made up by the demuxer
    tick = stream.time_base or Fraction(1, 1000)
    found: list[_Packet] = []
    try:
        for packet, shift_us in timed_packets(container, [stream], timeline):
            hidden = packet.is_discard or (vp8 and packet.size > 0 and not memoryview(packet)[0] & 0x10)
            if packet.size and not hidden:
                time = packet.dts if packet.pts is None or avi else packet.pts
                shifted = None if time is None else time + round(Fraction(shift_us, 1_000_000) / tick)
                # A counter of a broadcast that jumps is no damage of the packet: streams may be joined there.
                incomplete = packet.is_corrupt and not broadcast
                found.append(_Packet(packet.pts, shifted, packet.duration or 0, packet.is_keyframe, incomplete))
    except (av.FFmpegError, OSError):
        pass  # truncated file: use the packets read so far
    return found


def _index(packets: Sequence[_Packet], container: InputContainer, stream: VideoStream) -> Index | None:
    """The index from the times of the packets; None: they are not those of the pictures."""
    reordered = container.format.name == AVI and stream.codec_context.has_b_frames  # AVI stores no times
    if not packets or reordered or any(packet.pts is None for packet in packets):
        return None
    table = sorted(packets, key=lambda packet: packet.time or 0)
    stored = np.array([packet.pts for packet in table], np.int64)
    seekable = container.format.name in _SEEKABLE
    keys = _keys(table, stored) if seekable else np.empty(0, np.int64)
    times = [packet.time or 0 for packet in table]
    return _timed(times, table[-1].duration, stream, stored, np.union1d([0], keys))


def _keys(table: Sequence[_Packet], stored: NDArray[np.int64]) -> NDArray[np.int64]:
    """Frames to which a seek leads: key frames whose stored time is their own and fits its place."""
    rising = np.maximum.accumulate(stored) == stored
    alone = np.ones(len(stored), bool)
    alone[1:] &= np.diff(stored) != 0
    alone[:-1] &= np.diff(stored) != 0
    key = np.array([packet.key for packet in table])
    return np.flatnonzero(key & alone) if rising.all() else np.empty(0, np.int64)


def _timed(
    times: Sequence[int], last: int, stream: VideoStream, stored: NDArray[np.int64] | None, keys: NDArray[np.int64]
) -> Index:
    """The index of frames with these times, ascending; equal ones are spread up to the next."""
    tick = stream.time_base or Fraction(1, 1000)
    pts = np.array(times, np.int64)
    steps = np.diff(pts)
    usual = max(1, int(np.median(steps[steps > 0])) if (steps > 0).any() else round(_frame_s(stream) / tick))
    equal = int((steps == 0).sum())
    finer = 1
    if equal:
        pts, finer = spread(pts, usual)
    note = Note("corrected-times", f"The times of {equal} pictures that equal the time before were corrected.")
    if equal == 1:
        note = Note("corrected-times", "The time of a picture that equals the time before was corrected.")
    end = int(pts[-1]) + (last or usual) * finer
    return Index(pts, keys, end, tick / finer, True, stored=stored, notes=(note,) if equal else ())


def spread(pts: NDArray[np.int64], usual: int) -> tuple[NDArray[np.int64], int]:
    """Strictly increasing times: equal ones are spread evenly up to the next time.

    Args:
        pts: ascending times, ticks.
        usual: ticks from the last time to the end.

    Returns:
        The times, and the number of their ticks in one tick of `pts`. Times that would need a much finer tick are
        replaced by a steady rate.
    """
    distinct, first, counts = np.unique(pts, return_index=True, return_counts=True)
    steps = np.diff(np.append(distinct, distinct[-1] + usual))
    finer = int(np.ceil(counts / steps).max())
    if finer > _FINEST:
        return pts[0] + np.arange(len(pts), dtype=np.int64) * usual, 1
    within = np.arange(len(pts)) - np.repeat(first, counts)
    return np.repeat(distinct * finer, counts) + within * np.repeat(steps * finer, counts) // np.repeat(
        counts, counts
    ), finer


def _decoded(path: Path, limits: Limits, options: SourceOptions) -> Index:
    """The index of a video that is decoded for it, by one thread, as every read of it will be."""
    with open_container(path, limits) as container:
        stream = video_stream(container, options.picture)
        times = decoded_times(container, stream, decoder_of(stream, limits, threads=1))
        if not times or None in times:
            return _estimated(len(times), stream, exact=True)
        known = np.maximum.accumulate(np.array(times, np.int64))
        return _timed([int(time) for time in known], 0, stream, None, np.zeros(1, np.int64))


def _may_hide(packets: Sequence[_Packet], stream: VideoStream) -> bool:
    """Whether some packets may hold pictures that are never shown: these have the time of the next one."""
    times = {packet.time for packet in packets}
    return stream.codec_context.name in _HIDING and len(times) < len(packets)


def _is_quick(packets: Sequence[_Packet], stream: VideoStream) -> bool:
    context = stream.codec_context
    return len(packets) * max(1, context.width * context.height) <= _DECODED_PIXELS


def _estimated(count: int, stream: VideoStream, exact: bool = False) -> Index:
    """Index of frames without times: `count` frames at the nominal rate."""
    rate = 1 / _frame_s(stream)
    note = Note("assumed", f"The file stores no times: {float(rate):g} frames per second were assumed.")
    return Index(np.arange(count, dtype=np.int64), np.zeros(1, np.int64), count, 1 / rate, exact, notes=(note,))


def _frame_s(stream: VideoStream) -> Fraction:
    """Nominal duration of a frame, seconds."""
    return 1 / Fraction(stream.average_rate or stream.guessed_rate or SEQUENCE_FPS)


def _incomplete(packets: Sequence[_Packet], frames: int) -> frozenset[int]:
    """Frames whose packets the demuxer marks as cut off."""
    table: Iterable[_Packet] = sorted(packets, key=lambda packet: packet.time or 0)
    return frozenset(min(number, frames - 1) for number, packet in enumerate(table) if packet.incomplete)


def _correction_note(corrections: int) -> tuple[Note, ...]:
    if not corrections:
        return ()
    places = "one place" if corrections == 1 else f"{corrections} places"
    message = f"The file's times begin again or jump at {places}: what follows was joined without a gap."
    return (Note("corrected-times", message),)
