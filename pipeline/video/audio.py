"""Audio of the source for the output: packets are copied if the container supports the codec, otherwise re-encoded."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any, TypeAlias

import av
from av.audio.stream import AudioStream
from av.container import InputContainer, OutputContainer
from av.packet import Packet

_COPIED = {"mp4": frozenset({"aac", "mp3"}), "webm": frozenset({"opus", "vorbis"})}
_ENCODER = {"mp4": ("aac", 48000), "webm": ("libopus", 48000)}
_BITS_PER_S = 160_000

Timed: TypeAlias = "tuple[Fraction, Packet[Any]]"
"""Time from the start of the output, seconds, and a packet ready to be muxed."""


def audio_of(source: InputContainer) -> AudioStream | None:
    """The first audio stream that can be decoded, which players select by default; None = no such stream."""
    return next((s for s in source.streams.audio if s.codec_context is not None), None)


def add_audio(source: InputContainer, out: OutputContainer, container: str, origin_s: Fraction) -> Iterator[Timed]:
    """Add an audio stream to `out` and return an iterator over its packets; the iterator is empty without audio.

    Args:
        container: "mp4" or "webm".
        origin_s: time of the first frame in the source, seconds; it becomes time 0 of the output.
    """
    stream = audio_of(source)
    if stream is None:
        return iter(())
    if _can_copy(stream, container):
        return _copied(source, stream, out.add_stream_from_template(stream), origin_s)
    name, rate = _ENCODER[container]
    layout = "mono" if stream.codec_context.layout.nb_channels == 1 else "stereo"
    target = out.add_stream(name, rate=rate, layout=layout)
    assert isinstance(target, AudioStream)
    target.codec_context.bit_rate = _BITS_PER_S
    return _encoded(source, stream, target, origin_s)


def _can_copy(stream: AudioStream, container: str) -> bool:
    name = stream.codec_context.codec.canonical_name
    # AAC from transport streams (without extradata) cannot be copied into MP4 unchanged.
    return name in _COPIED[container] and (name != "aac" or bool(stream.codec_context.extradata))


def _copied(source: InputContainer, stream: AudioStream, target: AudioStream, origin_s: Fraction) -> Iterator[Timed]:
    tick = stream.time_base or Fraction(1, 1000)
    shift = round(origin_s / tick)
    for packet in _readable(source, stream):
        if packet.pts is None:
            continue
        packet.pts -= shift
        packet.dts = packet.pts
        if packet.pts + (packet.duration or 0) > 0:
            packet.stream = target
            yield packet.pts * tick, packet


def _readable(source: InputContainer, stream: AudioStream) -> Iterator[Packet[Any]]:
    """Packets up to the end of the file, or up to the point where it is truncated."""
    try:
        for packet in source.demux(stream):
            if packet.size:
                yield packet
    except (av.FFmpegError, OSError):
        return


def _encoded(source: InputContainer, stream: AudioStream, target: AudioStream, origin_s: Fraction) -> Iterator[Timed]:
    context = target.codec_context
    resampler = av.AudioResampler(context.format, context.layout, context.rate)
    tick = Fraction(1, context.rate)
    at: int | None = None
    for frame in _decoded(source, stream):
        for piece in resampler.resample(frame):
            start = piece.pts * (piece.time_base or tick) - origin_s if piece.pts is not None else None
            at = round((start or 0) / tick) if at is None else at
            if at + piece.samples > 0:
                piece.pts, piece.time_base = at, tick
                yield from _ready(target.encode(piece), target)
            at += piece.samples
    yield from _ready(target.encode(None), target)


def _decoded(source: InputContainer, stream: AudioStream) -> Iterator[Any]:
    for packet in _readable(source, stream):
        try:
            yield from stream.decode(packet)
        except (av.FFmpegError, ValueError):
            continue  # skip a damaged audio packet


def _ready(packets: list[Packet[Any]], target: AudioStream) -> Iterator[Timed]:
    for packet in packets:
        yield (packet.pts or 0) * packet.time_base, packet
