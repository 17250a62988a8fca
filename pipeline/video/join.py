"""Concatenation of segments without re-encoding, with what else the source carries, into the finished file.

The same segments and source give the same bytes: the file contains no creation time and no version.
"""

from __future__ import annotations

import errno
import heapq
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise, takewhile
from pathlib import Path
from typing import Any

import av
from av.container import OutputContainer
from av.packet import Packet
from av.video.stream import VideoStream

from pipeline.errors import UnreadableMedia
from pipeline.formats import output_format
from pipeline.formats.base import Encoding, OutputFormat
from pipeline.video.audio import Timed, Track, TrackWriter, tracks_of
from pipeline.video.container import has_alpha_plane, open_container
from pipeline.video.media import Limits, Note, SourceOptions
from pipeline.video.numbering import has_gaps
from pipeline.video.passthrough import Passthrough, left_out, open_source
from pipeline.video.sequence_options import OPTIONS_FILE, SequenceOptions
from pipeline.video.writer import MUXER_OPTIONS, zip_entry

_PRIMING_S = Fraction(1, 20)
_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Errors of the disk, which no other sound would avoid."""


def join(
    segments: Sequence[tuple[Fraction, Path]],
    out: Path,
    container: str | Encoding,
    sound: Path | None = None,
    progress: Callable[[float], None] = lambda done: None,
    end_s: Fraction | None = None,
    options: SourceOptions | None = None,
    whole: bool = True,
) -> tuple[Note, ...]:
    """Write the finished file at `out`.

    Args:
        segments: (start time, file) of each segment, in order, at least one. The files are written by `segment_writer`
            with the same spec. A start time is the time of the segment's first frame in the source, seconds; the first
            one becomes time 0 of the output, unless the sound begins before it.
        container: an output format, see `pipeline.formats`, or only its name.
        sound: the source, whose sound tracks, subtitles, chapters and tags go along. Ignored for formats without sound.
        end_s: time in the source at which the output ends, seconds; None: where the source ends.
        progress: called with the fraction done, 0..1, after each segment; may raise an exception to abort.
        options: which sound tracks are delivered.
        whole: whether the segments show the film from its first picture on, so that sound before it is kept.

    Returns:
        What was left out or changed.

    Raises: BadParameter (the source has no such sound track; the format needs a constant frame rate).
    """
    encoding = Encoding(container) if isinstance(container, str) else container
    form = output_format(encoding.format)
    if form.frame_suffixes:
        _join_images([path for _start, path in segments], out, progress)
        return _pictures_only(form, sound)
    if form.join:
        form.join(segments, out, progress, encoding.quality)
        return _pictures_only(form, sound)
    film = _Film(segments, out, form, sound, progress, end_s, whole and end_s is None)
    tracks = () if sound is None else _tracks(sound, (options or SourceOptions()).sound)
    refused: list[Note] = []
    for copies, kept in ((True, tracks), (False, tracks)):
        try:
            return (*film.write(kept, copies), *refused)
        except (av.FFmpegError, ValueError) as error:
            if not kept or getattr(error, "errno", None) in _DISK:
                raise
            why = getattr(error, "strerror", None) or error
            what = "could not be copied and was encoded" if copies else "was left out, because it could not be written"
            refused = [Note("sound", f"The sound {what}: {why}.")]
    return (*film.write((), False), *refused)


def _tracks(sound: Path, numbers: tuple[int, ...] | None) -> Sequence[Track]:
    try:
        return tracks_of(sound, numbers)
    except UnreadableMedia:
        return ()  # zips and still images, which no demuxer accepts, have no sound


@dataclass(frozen=True)
class _Film:
    """The arguments of `join`."""

    segments: Sequence[tuple[Fraction, Path]]
    out: Path
    form: OutputFormat
    source: Path | None
    progress: Callable[[float], None]
    end_s: Fraction | None
    whole: bool

    def write(self, tracks: Sequence[Track], copies: bool) -> tuple[Note, ...]:
        """Write the file with these sound tracks, copied if possible."""
        origin_s, first = self.segments[0]
        lead_s = self._lead_s(tracks)
        with ExitStack() as stack:
            options = MUXER_OPTIONS | dict(self.form.mux_options or {})
            target = stack.enter_context(av.open(f"file:{self.out}", "w", format=self.form.container, options=options))
            template = stack.enter_context(open_container(first, Limits()))
            rate, uneven = _steady_rate(self.form, self.segments)
            stream = _film_stream(target, template.streams.video[0], self.form, rate)
            packets = [_pictures(self.segments, stream, lead_s, self.progress)]
            codecs = self.form.sound
            writers = [TrackWriter(self.source, track, origin_s - lead_s) for track in tracks if self.source]
            packets += [writer.add(target, codecs, stack, copies) for writer in writers if codecs]
            notes = self._copy_streams(stack, target, stream, origin_s - lead_s, packets)
            if self.end_s is not None:
                length_s = self.end_s - origin_s
                packets[1:] = [takewhile(lambda timed: timed[0] < length_s, each) for each in packets[1:]]
            _interleave(target, *packets)
        return (*uneven, *notes, *(note for writer in writers for note in writer.notes))

    def _lead_s(self, tracks: Sequence[Track]) -> Fraction:
        """Duration of the sound before the first picture, seconds; 0 for a piece of a film. Encoders put a few silent
        samples before the first one, which are no lead."""
        if not self.whole or not tracks:
            return Fraction(0)
        lead_s = self.segments[0][0] - min(track.start_s for track in tracks)
        return lead_s if lead_s > _PRIMING_S else Fraction(0)

    def _copy_streams(
        self, stack: ExitStack, target: OutputContainer, film: VideoStream, zero_s: Fraction,
        packets: list[Iterator[Timed]],
    ) -> list[Note]:  # fmt: skip
        source = None if self.source is None else open_source(self.source)
        if self.source is None or source is None:
            return []
        stack.enter_context(source)
        carried = Passthrough(self.source, zero_s, self.end_s, self.whole)
        notes = carried.add(source, target, film, self.form)
        packets.append(carried.subtitles(source, target, self.form))
        return notes


def _steady_rate(
    form: OutputFormat, segments: Sequence[tuple[Fraction, Path]]
) -> tuple[Fraction | None, tuple[Note, ...]]:
    """The rate of a film in a format that has one frame rate, with a warning if frames have different durations."""
    if not form.rates:
        return None, ()
    times: list[Fraction] = []
    for start_s, path in segments:
        with open_container(path, Limits()) as source:
            packets = source.demux(source.streams.video[0])
            times += [start_s + (packet.pts or 0) * packet.time_base for packet in packets if packet.size]
    lengths = [later - earlier for earlier, later in pairwise(times)]
    mean = len(lengths) / (times[-1] - times[0]) if lengths else form.rates[0]
    rate = min(form.rates, key=lambda known: abs(known - mean))
    if not lengths or max(lengths) <= Fraction(3, 2) * min(lengths):
        return rate, ()
    message = f"{form.title} has one frame rate: the frames of this video of variable rate are shown evenly."
    return rate, (Note("corrected-times", message),)


def _film_stream(
    target: OutputContainer, template: VideoStream, form: OutputFormat, rate: Fraction | None
) -> VideoStream:
    """A stream of the film's codec. Its header is copied without asking for an encoder: decoders have other names."""
    stream = target.add_stream_from_template(template, opaque=True)
    tag = template.codec_context.codec_tag
    if tag in {profile.tag for profile in form.profiles if profile.tag}:
        stream.codec_context.codec_tag = tag
    if has_alpha_plane(template):
        stream.metadata["alpha_mode"] = "1"
    if rate is not None:
        stream.codec_context.framerate = rate
    return stream


def _pictures_only(form: OutputFormat, path: Path | None) -> tuple[Note, ...]:
    """Notes on sound, subtitles and data of the source, which a format of pictures cannot hold."""
    source = None if path is None else open_source(path)
    if source is None:
        return ()
    with source:
        return tuple(left_out(source, form))


def _interleave(target: OutputContainer, *tracks: Iterator[Timed]) -> None:
    """Mux packets in order of time, so that no track has to be buffered in memory."""
    for _time, packet in heapq.merge(*tracks, key=lambda timed: timed[0]):
        target.mux(packet)


def _pictures(
    segments: Sequence[tuple[Fraction, Path]], target: VideoStream, lead_s: Fraction, progress: Callable[[float], None]
) -> Iterator[Timed]:
    for number, (start_s, path) in enumerate(segments, start=1):
        with open_container(path, Limits()) as source:
            stream = source.streams.video[0]
            tick = stream.time_base or Fraction(1, 1000)
            offset = round((start_s - segments[0][0] + lead_s) / tick)
            for packet in source.demux(stream):
                if packet.size:
                    yield _shifted(packet, offset, tick, target)
        progress(number / len(segments))


def _shifted(packet: Packet[Any], offset: int, tick: Fraction, target: VideoStream) -> Timed:
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
