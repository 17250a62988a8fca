"""Concatenation of segments without re-encoding, with the audio of the source, into the finished file.

The same segments and source give the same bytes: the file contains no creation time and no version.
"""

from __future__ import annotations

import heapq
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from fractions import Fraction
from itertools import takewhile
from pathlib import Path
from typing import Any

import av
from av.container import OutputContainer
from av.packet import Packet
from av.video.stream import VideoStream

from pipeline.errors import UnreadableMedia
from pipeline.formats import output_format
from pipeline.video.audio import Timed, add_audio
from pipeline.video.container import open_container
from pipeline.video.media import Limits
from pipeline.video.numbering import has_gaps
from pipeline.video.sequence_options import OPTIONS_FILE, SequenceOptions
from pipeline.video.writer import MUXER_OPTIONS, zip_entry


def join(
    segments: Sequence[tuple[Fraction, Path]],
    out: Path,
    container: str,
    sound: Path | None = None,
    progress: Callable[[float], None] = lambda done: None,
    end_s: Fraction | None = None,
) -> None:
    """Write the finished file at `out`.

    Args:
        segments: (start time, file) of each segment, in order, at least one. The files are written by `segment_writer`
            with the same spec. A start time is the time of the segment's first frame in the source, seconds; the first
            one becomes time 0 of the output.
        container: name of an output format, see `pipeline.formats`.
        sound: a media file whose audio, if any, is added in sync. Ignored for formats without sound.
        end_s: time in the source at which the audio ends, seconds; None: where the source's audio ends.
        progress: called with the fraction done, 0..1, after each segment; may raise an exception to abort.
    """
    form = output_format(container)
    if form.encode:
        _join_images([path for _start, path in segments], out, progress)
        return
    if form.join:
        form.join(segments, out, progress)
        return
    origin_s, first = segments[0]
    with ExitStack() as stack:
        options = MUXER_OPTIONS | dict(form.mux_options or {})
        target = stack.enter_context(av.open(f"file:{out}", "w", format=form.container, options=options))
        template = stack.enter_context(open_container(first, Limits()))
        stream = target.add_stream_from_template(template.streams.video[0])
        pictures = _pictures(segments, stream, progress)
        audio = _sound(stack, sound, target, container, origin_s)
        if end_s is not None:
            length_s = end_s - origin_s
            audio = takewhile(lambda timed: timed[0] < length_s, audio)
        _interleave(target, pictures, audio)


def _sound(
    stack: ExitStack, sound: Path | None, target: OutputContainer, container: str, origin_s: Fraction
) -> Iterator[Timed]:
    if sound is None:
        return iter(())
    try:
        source = stack.enter_context(open_container(sound, Limits()))
    except UnreadableMedia:
        return iter(())  # zips and still images, which no demuxer accepts, have no audio
    return add_audio(source, target, container, origin_s)


def _interleave(target: OutputContainer, *tracks: Iterator[Timed]) -> None:
    """Mux packets in order of time, so that no track has to be buffered in memory."""
    for _time, packet in heapq.merge(*tracks, key=lambda timed: timed[0]):
        target.mux(packet)


def _pictures(
    segments: Sequence[tuple[Fraction, Path]], target: VideoStream, progress: Callable[[float], None]
) -> Iterator[Timed]:
    for number, (start_s, path) in enumerate(segments, start=1):
        with open_container(path, Limits()) as source:
            stream = source.streams.video[0]
            tick = stream.time_base or Fraction(1, 1000)
            offset = round((start_s - segments[0][0]) / tick)
            for packet in source.demux(stream):
                if packet.size:
                    yield _moved(packet, offset, tick, target)
        progress(number / len(segments))


def _moved(packet: Packet[Any], offset: int, tick: Fraction, target: VideoStream) -> Timed:
    packet.pts = (packet.pts or 0) + offset
    packet.dts = packet.pts
    packet.stream = target
    return packet.pts * tick, packet


def _join_images(segments: Sequence[Path], out: Path, progress: Callable[[float], None]) -> None:
    numbers: list[int] = []
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as target:
        for number, segment in enumerate(segments, start=1):
            with zipfile.ZipFile(segment) as source:
                for member in source.infolist():
                    target.writestr(zip_entry(member.filename), source.read(member))
                    numbers.append(int(member.filename.rpartition(".")[0]))
            progress(number / len(segments))
        if has_gaps(numbers):  # the film lacks the numbers that its source lacks
            target.writestr(zip_entry(OPTIONS_FILE), SequenceOptions(missing="skip").document())
