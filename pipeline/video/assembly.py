"""A film of several shots: their finished films, one after the other, in one file with sound.

Pictures are copied if all films are encoded alike. If one of them has another size or encoding, all are encoded again
in the size of the first: a smaller or larger picture is scaled into it, with black borders. Every shot keeps the
durations of its frames. The sound of a shot is cut, or continued with silence, to the length of its pictures, so that
it stays in step however many shots come before; it is encoded once, for the whole film.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import accumulate, chain
from pathlib import Path

import av
import cv2
import numpy as np
from av.audio.frame import AudioFrame
from av.audio.resampler import AudioResampler

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter
from pipeline.formats import output_format
from pipeline.frames import Frame
from pipeline.video.audio import audio_of
from pipeline.video.container import open_container, video_stream
from pipeline.video.join import join
from pipeline.video.media import Limits
from pipeline.video.reader import VideoReader
from pipeline.video.writer import SegmentSpec, segment_writer

_RATE = 48000
_HOLE_SAMPLES = _RATE // 20
"""A shorter hole is the delay of decoders and filters."""
_SILENT_SAMPLES = _RATE
"""Silence is written in pieces of this length."""


@dataclass(frozen=True)
class _Film:
    """A shot's film: what tells whether its packets can follow another's, and its length."""

    path: Path
    encoding: tuple[object, ...]
    length_s: Fraction
    sounds: bool


def assemble(
    films: Sequence[Path],
    out: Path,
    format_: str,
    quality: int = 20,
    profile: str = "",
    progress: Callable[[float], None] = lambda done: None,
) -> None:
    """Write the films one after the other at `out`. The same films give the same bytes.

    Args:
        films: finished films of one format that holds moving pictures in a container; at least one.
        format_: the name of that format.
        quality, profile: of their encoding, used if the films have to be encoded again.
        progress: called with the fraction done, 0..1; may raise an exception to abort.

    Raises: UnreadableMedia (a file is no film), BadParameter (films that differ have opacity or more than 8 bits, which
    would be lost).
    """
    found = [_examined(path) for path in films]
    with tempfile.TemporaryDirectory(dir=out.parent, prefix="assembly-") as folder:
        if len({film.encoding for film in found}) > 1:
            found = list(_encoded_alike(found, Path(folder), (format_, quality, profile), progress))
        starts = [*accumulate((film.length_s for film in found[:-1]), initial=Fraction(0))]
        sound = Path(folder) / "sound.wav"
        has_sound = any(film.sounds for film in found) and output_format(format_).sound is not None
        if has_sound:
            _write_sound(sound, films, [film.length_s for film in found])
        segments = [(start, film.path) for start, film in zip(starts, found, strict=True)]
        join(segments, out, format_, sound if has_sound else None, progress)


def _examined(path: Path) -> _Film:
    with open_container(path, Limits()) as source:
        stream = video_stream(source)
        context = stream.codec_context
        encoding = (context.name, context.width, context.height, context.pix_fmt, int(context.color_trc),
                    bytes(context.extradata or b""))  # fmt: skip
        end = Fraction(0)
        for packet in source.demux(stream):
            if packet.size and packet.pts is not None:
                end = max(end, (packet.pts + (packet.duration or 0)) * packet.time_base)
        return _Film(path, (*encoding, stream.time_base), end, audio_of(source) is not None)


def _encoded_alike(
    films: Sequence[_Film], folder: Path, output: tuple[str, int, str], progress: Callable[[float], None]
) -> Iterator[_Film]:
    """The films, encoded again with one specification: size, time base and nominal rate are those of the first."""
    with VideoReader(films[0].path) as first:
        spec = SegmentSpec(output[0], first.size, first.index.time_base, first.index.fps, *output[1:])
    if spec.profile.depth_bits > 8 or spec.profile.has_alpha:
        raise BadParameter(
            "The films of the shots have different sizes or encodings, and this format would lose by another encoding.",
            field="output.profile", value=spec.profile.title, remedy="Use a profile of 8 bits without opacity.",
        )  # fmt: skip
    for number, film in enumerate(films):
        path = folder / f"{number:04d}"
        ticks = 0
        with VideoReader(film.path) as reader, segment_writer(path, spec) as writer:
            times = [
                round(reader.index.time(k) * reader.index.time_base / spec.time_base)
                for k in range(len(reader.index.pts))
            ]
            ends = [*times[1:], round(film.length_s / spec.time_base)]
            for index, frame in enumerate(reader.read(0, len(reader.index.pts))):
                stop = max(ticks + 1, ends[index] - times[0])
                writer.write(index, fitted(frame, spec.size), ticks, stop)
                ticks = stop
        progress((number + 1) / (2 * len(films)))
        yield _Film(path, (), ticks * spec.time_base, film.sounds)


def fitted(frame: Frame, size: tuple[int, int]) -> Frame:
    """The frame scaled into (width, height) px, its sides in proportion, in the middle of black borders."""
    width, height = size
    scale = min(width / frame.shape[1], height / frame.shape[0])
    inner = max(1, round(frame.shape[1] * scale)), max(1, round(frame.shape[0] * scale))
    if (frame.shape[1], frame.shape[0]) == size:
        return frame
    scaled = cv2.resize(frame, inner, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
    canvas = np.zeros((height, width, 3), np.uint8)
    left, top = (width - inner[0]) // 2, (height - inner[1]) // 2
    canvas[top : top + inner[1], left : left + inner[0]] = scaled
    return canvas


def _write_sound(path: Path, films: Sequence[Path], lengths_s: Sequence[Fraction]) -> None:
    """Stereo sound of all films at 48 kHz. Positions count from the start of the whole, so that no error adds up."""
    with av.open(f"file:{path}", "w", format="wav", options={"rf64": "auto", "fflags": "+bitexact"}) as target:
        stream = target.add_stream("pcm_s16le", rate=_RATE, layout="stereo")
        done, end_s = 0, Fraction(0)
        for film, length_s in zip(films, lengths_s, strict=True):
            end_s += length_s
            for piece in _samples(film, round(end_s * _RATE) - done):
                piece.pts, piece.time_base = done, Fraction(1, _RATE)
                done += piece.samples
                target.mux(stream.encode(piece))
        target.mux(stream.encode(None))


def _samples(film: Path, count: int) -> Iterator[AudioFrame]:
    """The first `count` samples of a film's sound from time 0, silence where it has none."""
    done = 0
    for piece in _continuous(film, count):
        taken = _first(piece, count - done)
        done += taken.samples
        yield taken
        if done == count:
            return
    yield from _silence(count - done)


def _continuous(film: Path, most: int) -> Iterator[AudioFrame]:
    """The film's sound in pieces from time 0 on; a late begin and holes are silent, `most` samples at most."""
    with open_container(film, Limits()) as source:
        track = audio_of(source)
        if track is None:
            return
        resampler, at = AudioResampler("s16", "stereo", _RATE), 0
        for frame in chain(source.decode(track), (None,)):
            start = at if frame is None or frame.time is None else round(frame.time * _RATE)
            if start - at > (_HOLE_SAMPLES if at else 0):
                for piece in _silence(min(start, most) - at):
                    at += piece.samples
                    yield piece
            early = max(0, -start) if at == 0 else 0
            for piece in resampler.resample(frame):
                kept = _first(piece, piece.samples, early)
                early = max(0, early - piece.samples)
                at += kept.samples
                if kept.samples:
                    yield kept


def _first(piece: AudioFrame, most: int, skip: int = 0) -> AudioFrame:
    """At most `most` samples of a piece after the first `skip`."""
    return _packed(piece.to_ndarray()[:, 2 * skip : 2 * (skip + most)])  # left and right alternate


def _silence(samples: int) -> Iterator[AudioFrame]:
    for start in range(0, samples, _SILENT_SAMPLES):
        yield _packed(np.zeros((1, 2 * min(_SILENT_SAMPLES, samples - start)), np.int16))


def _packed(samples: AnyArray) -> AudioFrame:
    frame = AudioFrame.from_ndarray(np.ascontiguousarray(samples, np.int16), format="s16", layout="stereo")
    frame.sample_rate = _RATE
    return frame
