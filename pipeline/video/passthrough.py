"""Copies title, dates, chapters, subtitles and timecode of a source to the output. What the output's container cannot
hold is named in the notes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
from av.container import InputContainer, OutputContainer
from av.packet import Packet
from av.stream import Stream
from av.subtitles.stream import SubtitleStream
from av.subtitles.subtitle import AssSubtitle, SubtitleSet
from av.video.stream import VideoStream

from pipeline.errors import UnreadableMedia
from pipeline.formats.base import OutputFormat
from pipeline.video.audio import Timed
from pipeline.video.container import film_streams, open_container
from pipeline.video.media import Limits, Note
from pipeline.video.timecode import is_timecode, shifted, usual_rate
from pipeline.video.timeline import timed_packets

_TEXT_CODECS = ("mov_text", "ass", "webvtt")
"""Codecs to which other texts are converted: the first one that the format holds."""
_TEXTS = frozenset({"mov_text", "webvtt", "subrip", "srt", "ass", "ssa", "text"})
_OF_THE_FILE = frozenset({"major_brand", "minor_version", "compatible_brands", "encoder", "duration", "timecode"})
"""Tags that describe the source's file, not the film."""
_TIMECODE = ("timecode", "reel_name")


@dataclass(frozen=True)
class Passthrough:
    """Copies the data of one source file to an output from the source's time `zero_s` to `end_s` (None: to its end)."""

    path: Path
    zero_s: Fraction
    end_s: Fraction | None = None
    whole: bool = True
    """Whether the output shows the whole film: otherwise its timecode begins at its first frame's."""

    def add(self, source: InputContainer, out: OutputContainer, film: VideoStream, form: OutputFormat) -> list[Note]:
        """Set tags, chapters and timecode of `out`, and name what is left out or converted."""
        out.metadata.update({k: v for k, v in source.metadata.items() if k.lower() not in _OF_THE_FILE})
        out.set_chapters(self._chapters(source))
        return [*self._timecode(source, film, form), *left_out(source, form)]

    def subtitles(self, source: InputContainer, out: OutputContainer, form: OutputFormat) -> Iterator[Timed]:
        """Add the subtitles that the format holds, or that are texts; their packets."""
        kept = {s.index: _Text.added(out, s, form) for s in _held(source, form)}
        return self._packets(source, kept) if kept else iter(())

    def _packets(self, source: InputContainer, kept: Mapping[int, _Text]) -> Iterator[Timed]:
        try:
            for packet, shift_us in timed_packets(source, [text.stream for text in kept.values()]):
                text = kept[packet.stream_index]
                made = text.converted(packet) if packet.size and packet.pts is not None else None
                if made is not None:
                    yield from self._shifted(made, shift_us, text.target)
        except (av.FFmpegError, OSError):
            return

    def _shifted(self, packet: Packet[Any], shift_us: int, target: Stream) -> Iterator[Timed]:
        """The packet in the output's time; one that begins before the output begins with it."""
        tick = packet.time_base
        start = (packet.pts or 0) + round((Fraction(shift_us, 1_000_000) - self.zero_s) / tick)
        packet.pts = packet.dts = max(0, start)
        packet.stream = target
        left = (packet.duration or 0) + min(0, start)
        if start < 0:
            packet.duration = left
        if start >= 0 or left > 0:
            yield max(0, start) * tick, packet

    def _chapters(self, source: InputContainer) -> list[Any]:
        """The chapters in the output's time, cut to it."""
        found = []
        for chapter in source.chapters():
            tick = chapter["time_base"] or Fraction(1, 1000)
            zero = round(self.zero_s / tick)
            last = chapter["end"] if self.end_s is None else min(chapter["end"], round(self.end_s / tick))
            start, end = max(0, chapter["start"] - zero), last - zero
            if end > start:
                found.append({**chapter, "start": start, "end": end})
        return found

    def _timecode(self, source: InputContainer, film: VideoStream, form: OutputFormat) -> list[Note]:
        """Write the timecode of the output's first frame, and the reel."""
        tags = [source.metadata, *(stream.metadata for stream in source.streams)]
        found = {k.lower(): v for each in reversed(tags) for k, v in each.items() if k.lower() in _TIMECODE}
        if "timecode" not in found:
            return []
        films = film_streams(source)
        rate = usual_rate(films[0].average_rate) if films else None
        if form.timecode and rate is not None and is_timecode(found["timecode"]):
            if not self.whole:
                begin = (films[0].start_time or 0) * (films[0].time_base or Fraction(0))
                found["timecode"] = shifted(found["timecode"], round((self.zero_s - begin) * rate), rate)
            film.metadata.update(found)
            film.codec_context.framerate = rate
            return []
        where = form.title if rate is not None else "this rate"
        return [Note("left-out", f"The timecode {found['timecode']} was left out: {where} cannot hold it.")]


def timecode_tag(source: InputContainer) -> str:
    """The timecode of a source's first frame; empty: it has none."""
    tags = [*(stream.metadata for stream in source.streams), source.metadata]
    return next((v for each in tags for k, v in each.items() if k.lower() == "timecode"), "")


def left_out(source: InputContainer, form: OutputFormat) -> list[Note]:
    """What of a source the format cannot hold, and subtitles that are converted."""
    held = _held(source, form)
    kept = {stream.index for stream in held}
    lost = [f"subtitles ({_described(s)})" for s in source.streams.subtitles if s.index not in kept]
    if form.sound is None:
        lost += [f"sound ({_described(s)})" for s in source.streams.audio]
    told = bool(source.chapters())
    lost += [f"data ({_described(s)})" for s in source.streams.data if not (_is_timecode(s) or (told and _is_text(s)))]
    lost += [f"an attachment ({s.name or 'unnamed'})" for s in source.streams.attachments]
    covers = len(source.streams.video) - len(film_streams(source))
    lost += ["a cover picture"] * covers
    changed = [_described(s) for s in held if _codec(s) not in form.subtitles]
    notes = []
    if lost:
        notes.append(f"Left out, because {form.title} cannot hold it: {_listed(lost)}.")
    if changed:
        notes.append(f"Subtitles were converted to {_text_codec(form)}: {_listed(changed)}.")
    return [Note("left-out", message) for message in notes]


def open_source(path: Path) -> InputContainer | None:
    """The container of a source; None for zips and still images, which no demuxer accepts."""
    try:
        return open_container(path, Limits())
    except UnreadableMedia:
        return None


def _held(source: InputContainer, form: OutputFormat) -> list[SubtitleStream]:
    """The subtitles that go along: those of the format's codecs, and texts that can be converted to one of them."""
    texts = bool(_text_codec(form))
    return [s for s in source.streams.subtitles if _codec(s) in form.subtitles or (texts and _is_decodable(s))]


def _text_codec(form: OutputFormat) -> str:
    """The codec to which texts are converted; empty: the format holds none."""
    return next((codec for codec in _TEXT_CODECS if codec in form.subtitles), "")


def _is_decodable(stream: SubtitleStream) -> bool:
    if _codec(stream) not in _TEXTS:
        return False
    try:
        stream.codec_context.open(strict=False)
    except (av.FFmpegError, ValueError):
        return False
    return bool(stream.codec_context.subtitle_header)


@dataclass(frozen=True)
class _Text:
    """A track of subtitles, and its track in the output."""

    stream: SubtitleStream
    target: SubtitleStream

    @classmethod
    def added(cls, out: OutputContainer, stream: SubtitleStream, form: OutputFormat) -> _Text:
        copied = _codec(stream) in form.subtitles
        target = out.add_stream_from_template(stream) if copied else out.add_stream(_text_codec(form))
        assert isinstance(target, SubtitleStream)
        if not copied:
            target.time_base = target.codec_context.time_base = Fraction(1, 1000)
            target.codec_context.subtitle_header = stream.codec_context.subtitle_header
        target.metadata.update({k: v for k, v in stream.metadata.items() if k in ("language", "title", "handler_name")})
        return cls(stream, target)

    def converted(self, packet: Packet[Any]) -> Packet[Any] | None:
        """The packet in the codec of the output; None: it shows no text."""
        if _codec(self.stream) == _codec(self.target):
            return packet
        try:
            found = self.stream.codec_context.decode2(packet)
        except (av.FFmpegError, ValueError):
            return None
        lines = [rect.ass for rect in (found.rects if found else ()) if isinstance(rect, AssSubtitle) and rect.ass]
        if not lines:
            return None
        shown = SubtitleSet.create(b"\\N".join(lines), 0, packet.duration or 0, packet.pts or 0)
        made: Packet[Any] = self.target.codec_context.encode_subtitle(shown)
        made.pts, made.duration, made.time_base = packet.pts, packet.duration, packet.time_base
        return made


def _codec(stream: Stream) -> str:
    return stream.codec_context.codec.canonical_name if stream.codec_context is not None else ""


def _is_timecode(stream: Stream) -> bool:
    return bool(stream.metadata.get("timecode"))


def _is_text(stream: Stream) -> bool:
    """Whether a track may be the names of chapters, which QuickTime keeps in a track of text."""
    return stream.metadata.get("handler_name") == "SubtitleHandler"


def _described(stream: Stream) -> str:
    kind = _codec(stream) or stream.metadata.get("handler_name") or "unknown"
    language = stream.metadata.get("language", "und")
    return kind if language == "und" else f"{kind}, {language}"


def _listed(items: list[str]) -> str:
    return ", ".join(items[:5]) + (f" and {len(items) - 5} more" if len(items) > 5 else "")
