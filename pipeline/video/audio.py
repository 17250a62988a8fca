"""Sound tracks of the source for the output.

A track is copied if its codec is usual in the container (`SoundCodecs`), its packets follow one another without holes,
and the muxer accepts it. Any other track is decoded, made continuous by FFmpeg's `aresample=async=1` (holes become
silence, overlaps are cut), and encoded. Both keep the times of the file.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Any, TypeAlias

import av
from av.audio.frame import AudioFrame
from av.audio.stream import AudioStream
from av.container import InputContainer, OutputContainer
from av.filter import Graph
from av.packet import Packet

from pipeline.errors import BadParameter
from pipeline.formats.base import SoundCodecs
from pipeline.video.container import finished, open_container, sound_streams
from pipeline.video.media import Limits, Note
from pipeline.video.timeline import Timeline, timed_packets

_RATE = 48000
_LAYOUTS = {1: "mono", 2: "stereo", 6: "5.1", 8: "7.1"}
"""Channels -> layout that all encoders accept; other numbers are mixed to stereo."""
_BITS_PER_S = 80_000
"""Bit rate of one channel that is encoded with loss."""
_HOLE_S = Fraction(1, 20)
"""A hole of this length is filled, so the track is encoded."""
_SILENCE_S = 1
"""Longer holes are filled piece by piece."""
_LONGEST_HOLE_S = 600
"""Sound after a longer hole is left out: its times are wrong."""
_MOST_TRACKS = 16
_CONTINUOUS = "async=1:min_hard_comp=0.010"

Timed: TypeAlias = "tuple[Fraction, Packet[Any]]"
"""Time from the start of the output, seconds, and a packet ready to be muxed."""


@dataclass(frozen=True)
class Track:
    """A sound track of a file.

    Attributes:
        index: of its stream.
        start_s: time of its first sample, seconds.
        regular: whether its packets follow one another and their format does not change.
        shifts: see `Timeline`.
    """

    index: int
    start_s: Fraction
    regular: bool
    shifts: tuple[int, ...]


@dataclass
class _Scan:
    """The packets of one track so far."""

    stream: AudioStream
    start: Fraction | None = None
    due: Fraction | None = None
    last: Fraction | None = None
    regular: bool = True

    def add(self, packet: Packet[Any], shift_us: int) -> None:
        if packet.pts is None:
            return
        at = packet.pts * packet.time_base + Fraction(shift_us, 1_000_000)
        if self.start is None:
            self.start = self._first_sample(packet, Fraction(shift_us, 1_000_000))
        if packet.is_discard:
            self.regular &= self.last is None
            return
        steady = self.last is None or (at > self.last and (self.due is None or abs(at - self.due) < _HOLE_S))
        self.regular &= steady and not shift_us and not packet.has_sidedata("new_extradata")
        self.last, self.due = at, at + packet.duration * packet.time_base if packet.duration else None

    def _first_sample(self, packet: Packet[Any], shift: Fraction) -> Fraction | None:
        """Time of the first sample, if it is in this packet: encoders put silence before it, which is not played."""
        try:
            frames = self.stream.decode(packet)
        except (av.FFmpegError, ValueError):
            return None
        times = (frame.pts * frame.time_base for frame in frames if frame.pts is not None and frame.time_base)
        return next((time + shift for time in times), None)


def audio_of(source: InputContainer) -> AudioStream | None:
    """The sound track that players select by default; None = there is none that can be decoded."""
    streams, best = sound_streams(source), source.streams.best("audio")
    return next((stream for stream in streams if best is not None and stream.index == best.index), (*streams, None)[0])


def tracks_of(path: Path, numbers: tuple[int, ...] | None = None) -> list[Track]:
    """The sound tracks of a file that hold sound.

    Args:
        numbers: tracks to take; None: all, but at most 16.

    Raises: UnreadableMedia, BadParameter (there is no track of a number).
    """
    with open_container(path, Limits()) as source:
        streams = sound_streams(source)
        for number in numbers or ():
            if not 0 <= number < len(streams):
                remedy = f"Use 0 to {len(streams) - 1}." if streams else "The file has no sound."
                message = f"The file has {len(streams)} sound tracks."
                raise BadParameter(message, field="source.sound", value=number, remedy=remedy)
        chosen = [*streams[:_MOST_TRACKS]] if numbers is None else [streams[number] for number in numbers]
        found = {stream.index: _Scan(stream) for stream in chosen}
        timeline = Timeline(source)
        for packet, shift_us in _readable(source, chosen, timeline):
            found[packet.stream_index].add(packet, shift_us)
    shifts = timeline.shifts
    return [Track(at, scan.start, scan.regular, shifts) for at, scan in found.items() if scan.start is not None]


@dataclass
class TrackWriter:
    """Adds one track to the output.

    Attributes:
        zero_s: time in the source that becomes 0.
        notes: what is not as in the source; complete when the packets have been read.
    """

    path: Path
    track: Track
    zero_s: Fraction
    notes: list[Note] = field(default_factory=list)

    def add(self, out: OutputContainer, codecs: SoundCodecs, stack: ExitStack, copies: bool) -> Iterator[Timed]:
        """Add the stream to `out` and return its packets.

        Args:
            codecs: of the container.
            stack: closes the file.
            copies: whether the track may be copied.
        """
        source = stack.enter_context(open_container(self.path, Limits()))
        stream = next(s for s in sound_streams(source) if s.index == self.track.index)
        context = stream.codec_context
        if copies and self.track.regular and _can_copy(stream, codecs.copied, out.format.name):
            target = out.add_stream_from_template(stream)
            packets = self._copied(source, stream, target)
        else:
            layout = _LAYOUTS.get(context.layout.nb_channels, "stereo")
            made = out.add_stream(codecs.encoder, rate=_RATE, layout=layout)
            assert isinstance(made, AudioStream)
            target = made
            if codecs.sample_format:
                target.codec_context.format = codecs.sample_format
            target.codec_context.bit_rate = _BITS_PER_S * target.codec_context.layout.nb_channels
            packets = self._encoded(source, stream, target)
        for name in ("language", "title", "handler_name"):
            if stream.metadata.get(name):
                target.metadata[name] = stream.metadata[name]
        return packets

    def _copied(self, source: InputContainer, stream: AudioStream, target: AudioStream) -> Iterator[Timed]:
        tick = stream.time_base or Fraction(1, 1000)
        zero = round(self.zero_s / tick)
        for packet, _shift in _readable(source, [stream], Timeline(source, self.track.shifts)):
            if packet.pts is None:
                continue
            packet.pts -= zero
            packet.dts = packet.pts
            if packet.pts + (packet.duration or 0) > 0:
                packet.stream = target
                yield packet.pts * tick, packet

    def _encoded(self, source: InputContainer, stream: AudioStream, target: AudioStream) -> Iterator[Timed]:
        for piece in self._continuous(source, stream, target):
            yield from _ready(target.encode(piece), target)
        yield from _ready(target.encode(None), target)

    def _continuous(self, source: InputContainer, stream: AudioStream, target: AudioStream) -> Iterator[AudioFrame]:
        """Sound from time 0 on in the encoder's format, without holes."""
        done, made, due = 0, None, Fraction(0)
        for frame, start_s in self._decoded(source, stream):
            start = due if start_s is None else start_s - self.zero_s
            due = start + Fraction(frame.samples, frame.sample_rate)
            hole = start - Fraction(done, _RATE)
            if hole > _LONGEST_HOLE_S:
                self.notes.append(Note("sound", f"The sound was cut before a hole of {float(hole):.0f} s."))
                break
            changed = made is not None and not made.fits(frame)
            if made is not None and (changed or hole > _SILENCE_S):
                for piece in made.rest():
                    done += piece.samples
                    yield piece
                made = None
            while made is None and (samples := round((start - Fraction(done, _RATE)) * _RATE)) > _SILENCE_S * _RATE:
                yield _silence(target, done, min(samples, _RATE))
                done += min(samples, _RATE)
            made = made or _Resampler(frame, target, done)
            for piece in made.push(frame, start):
                done += piece.samples
                yield piece
        yield from made.rest() if made is not None else ()

    def _decoded(self, source: InputContainer, stream: AudioStream) -> Iterator[tuple[AudioFrame, Fraction | None]]:
        """Decoded sound and its time in the source, seconds; None: it follows the piece before."""
        lost, shift = 0, Fraction(0)
        timeline = Timeline(source, self.track.shifts)
        for packet, shift_us in chain(_readable(source, [stream], timeline), [(Packet(), 0)]):
            shift = Fraction(shift_us, 1_000_000) if packet.size else shift
            try:
                frames = stream.decode(packet if packet.size else None)
            except (av.FFmpegError, ValueError):
                lost += 1
                continue
            for frame in frames:
                known = frame.pts is not None and frame.time_base is not None
                yield frame, Fraction(frame.pts or 0) * (frame.time_base or 0) + shift if known else None
        if lost:
            noun = "piece" if lost == 1 else "pieces"
            self.notes.append(Note("sound", f"{lost} damaged {noun} of sound became silence."))


class _Resampler:
    """FFmpeg's filter graph for sound of one format. Its first sample is sample `first` of the output."""

    def __init__(self, like: AudioFrame, target: AudioStream, first: int) -> None:
        self._key, self._rate = _format_of(like), like.sample_rate
        context, graph = target.codec_context, Graph()
        graph.threads = 1
        self._source = graph.add_abuffer(
            sample_rate=self._rate, format=like.format, layout=like.layout, time_base=Fraction(1, self._rate)
        )
        begin = round(Fraction(first, _RATE) * self._rate)
        layout = context.layout.name
        even = graph.add("aresample", f"{_RATE}:{_CONTINUOUS}:first_pts={begin}")
        form = graph.add("aformat", f"sample_fmts={context.format.name}:channel_layouts={layout}:sample_rates={_RATE}")
        self._sink = graph.add("abuffersink")
        graph.link_nodes(self._source, even, form, self._sink).configure()
        self._graph, self._at = graph, first

    def fits(self, frame: AudioFrame) -> bool:
        return _format_of(frame) == self._key

    def push(self, frame: AudioFrame, start_s: Fraction) -> Iterator[AudioFrame]:
        frame.pts, frame.time_base = round(start_s * self._rate), Fraction(1, self._rate)
        self._source.push(frame)
        return self._finished()

    def rest(self) -> Iterator[AudioFrame]:
        self._source.push(None)
        return self._finished()

    def _finished(self) -> Iterator[AudioFrame]:
        for piece in finished(self._sink):
            piece.pts, piece.time_base = self._at, Fraction(1, _RATE)
            self._at += piece.samples
            yield piece


def _format_of(frame: AudioFrame) -> tuple[int, str, str]:
    return frame.sample_rate, frame.layout.name, frame.format.name


def _silence(target: AudioStream, first: int, samples: int) -> AudioFrame:
    context = target.codec_context
    piece = AudioFrame(context.format, context.layout, samples)
    for plane in piece.planes:
        plane.update(bytes(plane.buffer_size))
    piece.sample_rate, piece.pts, piece.time_base = _RATE, first, Fraction(1, _RATE)
    return piece


def _can_copy(stream: AudioStream, copied: frozenset[str], container: str) -> bool:
    """Whether the codec is usual in the container and the muxer accepts its header."""
    name = stream.codec_context.codec.canonical_name
    # AAC from transport streams (without extradata) cannot be copied into MP4 unchanged.
    if name not in copied or (name == "aac" and not stream.codec_context.extradata):
        return False
    try:
        with av.open(io.BytesIO(), "w", format=container) as trial:
            trial.add_stream_from_template(stream)
            trial.start_encoding()
    except (av.FFmpegError, ValueError):
        return False
    return True


def _readable(
    source: InputContainer, streams: Sequence[AudioStream], timeline: Timeline
) -> Iterator[tuple[Packet[Any], int]]:
    """Packets and their shifts up to the end of the file, or up to the point where it is truncated."""
    if not streams:
        return
    try:
        for packet, shift_us in timed_packets(source, streams, timeline):
            if packet.size:
                yield packet, shift_us
    except (av.FFmpegError, OSError):
        return


def _ready(packets: list[Packet[Any]], target: AudioStream) -> Iterator[Timed]:
    for packet in packets:
        yield (packet.pts or 0) * packet.time_base, packet
