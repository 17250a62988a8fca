"""Films with a flash and a click at the same times, made to be unusual, and what is seen and heard of a film."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.container import OutputContainer

from pipeline.video.join import join
from pipeline.video.media import Note, SourceOptions
from pipeline.video.reader import VideoReader
from pipeline.video.writer import SegmentSpec, segment_writer

WIDTH, HEIGHT, RATE = 96, 64, 48000
FLASHES = (5, 15, 25, 35)
FRAMES = 40
MARKS_S = [0.2, 0.6, 1.0, 1.4]
"""Times of the flashes at 25 frames per second."""


def frame(number: int, flashes: Sequence[int] = FLASHES) -> np.ndarray:
    """A gray picture with a moving block; white if the number is one of `flashes`."""
    made = np.full((HEIGHT, WIDTH, 3), 40, np.uint8)
    made[20:40, 10 + number : 30 + number] = (150, 60, 60)
    return np.full_like(made, 255) if number in flashes else made


def film(
    path: Path, codec: str = "libx264", sound: str | None = "aac", times_ms: Sequence[int] | None = None,
    frames: Sequence[int] = range(FRAMES), offset_s: float = 0.0, options: dict[str, str] | None = None,
    layout: str = "mono", rate: int = RATE, keeps: Callable[[float], bool] = lambda time_s: True,
) -> Path:  # fmt: skip
    """Encode frames of the film, with the clicks that belong to them.

    Args:
        times_ms: times of the packets in the order of display, for encoders without B-frames; None: 25 a second.
        offset_s: time of the first frame and sample, besides what the container adds.
        keeps: whether a packet of sound at this time is written.
    """
    shift = Fraction(offset_s).limit_denominator(1000)
    with av.open(str(path), "w") as out:
        video = out.add_stream(codec, rate=25, options=options or {"g": "10"})
        video.width, video.height, video.pix_fmt = WIDTH, HEIGHT, "yuvj420p" if codec == "mjpeg" else "yuv420p"
        track = out.add_stream(sound, rate=rate, layout=layout) if sound else None
        packets: list[tuple[Fraction, Any]] = []
        for at, number in enumerate(frames):
            shown = av.VideoFrame.from_ndarray(frame(number), format="rgb24")
            shown.pts, shown.time_base = at, Fraction(1, 25)
            packets += [(packet.dts * packet.time_base, packet) for packet in video.encode(shown)]
        packets += [(packet.dts * packet.time_base, packet) for packet in video.encode(None)]
        for at, (_time, packet) in enumerate(packets if times_ms else []):
            packet.time_base, packet.pts, packet.dts = Fraction(1, 1000), times_ms[at], times_ms[at]  # type: ignore[index]
            packets[at] = (Fraction(times_ms[at], 1000), packet)  # type: ignore[index]
        if track is not None:
            first, last = frames[0] / 25, (frames[-1] + 1) / 25
            marks = [time - first for time in MARKS_S if first <= time < last]
            heard = samples(track, marks, len(frames) / 25, rate, layout)
            packets += [(p.pts * p.time_base, p) for p in heard if keeps(float(p.pts * p.time_base))]
        _mux(out, packets, shift)
    return path


def samples(stream: Any, at_s: Sequence[float], seconds: float, rate: int, layout: str) -> list[Any]:
    """Silence with clicks of 10 ms on all channels, encoded."""
    channels = av.AudioLayout(layout).nb_channels
    wave = np.zeros((1, int(seconds * rate) * channels), np.int16)
    for at in at_s:
        begin = int(at * rate) * channels
        wave[0, begin : begin + rate // 100 * channels] = 20000
    packets: list[Any] = []
    for begin in range(0, wave.shape[1] // channels, 1024):
        piece = av.AudioFrame.from_ndarray(
            np.ascontiguousarray(wave[:, begin * channels : (begin + 1024) * channels]), format="s16", layout=layout
        )
        piece.sample_rate, piece.time_base, piece.pts = rate, Fraction(1, rate), begin
        packets += stream.encode(piece)
    return packets + stream.encode(None)


def _mux(out: OutputContainer, packets: list[tuple[Fraction, Any]], shift: Fraction) -> None:
    for _time, packet in sorted(packets, key=lambda timed: timed[0]):
        ticks = round(shift / packet.time_base)
        packet.pts += ticks
        packet.dts = None if packet.dts is None else packet.dts + ticks
        out.mux(packet)


def joined(path: Path, *parts: Path) -> Path:
    path.write_bytes(b"".join(part.read_bytes() for part in parts))
    return path


def painted(
    source: Path, out: Path, container: str = "mp4", options: SourceOptions | None = None,
    piece: tuple[int, int] | None = None,
) -> tuple[Note, ...]:  # fmt: skip
    """The source's own frames as two segments, joined: what a job does, without painting. Returns the notes."""
    with VideoReader(source, options=options) as reader:
        start, stop = piece or (0, reader.frames)
        spec = SegmentSpec(container, reader.size, reader.time_base, reader.fps, 10)
        segments = []
        edges = sorted({start, (start + stop) // 2, stop})
        for first, last in pairwise(edges):
            path = out.with_name(f"{out.stem}-{first}.segment")
            segments.append((reader.index.time(first) * reader.time_base, path))
            with segment_writer(path, spec) as writer:
                for at, picture in enumerate(reader.read(first, last), start=first):
                    writer.write(at, picture, reader.index.time(at), reader.index.time(at + 1))
        end_s = None if piece is None else reader.index.time(stop) * reader.time_base
        return (*reader.notes, *join(segments, out, container, source, end_s=end_s, options=options))


def flash_times(path: Path) -> list[float]:
    """Times, s, at which a film becomes white."""
    found, before = [], 0.0
    with av.open(str(path)) as source:
        for picture in source.decode(video=0):
            level = float(picture.to_ndarray(format="gray").mean())
            if level > 200 >= before:
                found.append(float(picture.pts * picture.time_base))
            before = level
    return found


def click_times(path: Path, track: int = 0) -> list[float]:
    """Times, s, at which sound rises from silence."""
    found: list[float] = []
    quiet_s = -1.0
    with av.open(str(path)) as source:
        for piece in source.decode(audio=track):
            values = (
                np.abs(piece.to_ndarray().astype(np.float64)).reshape(-1, piece.samples).max(axis=0)
                if (piece.format.is_planar)
                else np.abs(piece.to_ndarray().astype(np.float64)).reshape(piece.samples, -1).max(axis=1)
            )
            loud = values > (0.2 if values.dtype.kind == "f" and piece.format.name.startswith("flt") else 6000)
            for at in np.flatnonzero(loud):
                time = float(piece.pts * piece.time_base) + at / piece.sample_rate
                if time - quiet_s > 0.04:
                    found.append(time)
                quiet_s = time
    return found


def edited(path: Path, out: Path, **edits: Sequence[tuple[float, float]]) -> Path:
    """An MP4 file with other edit lists: edits as (start in the track, -1 for none, and duration), s."""
    data = path.read_bytes()
    boxes = {kind: (at, size) for at, size, kind in _boxes(data, 0, len(data))}
    moov, size = boxes[b"moov"]
    assert moov > boxes[b"mdat"][0], "the table is at the end, so that samples keep their places"
    parts = [data[at : at + n] for at, n, _kind in _boxes(data, moov + 8, moov + size)]
    scale = struct.unpack(">I", next(p for p in parts if p[4:8] == b"mvhd")[20:24])[0]
    parts = [_edited_track(part, scale, edits) if part[4:8] == b"trak" else part for part in parts]
    out.write_bytes(data[:moov] + _box(b"moov", *parts) + data[moov + size :])
    return out


def _edited_track(track: bytes, scale: int, edits: dict[str, Sequence[tuple[float, float]]]) -> bytes:
    kind = track[track.index(b"hdlr") + 12 :][:4].decode()
    if kind not in edits:
        return track
    ticks = struct.unpack(">I", track[track.index(b"mdhd") + 16 :][:4])[0]
    old = track.find(b"elst")
    base = max(0, struct.unpack(">i", track[old + 16 : old + 20])[0]) if old > 0 else 0
    rows = [(round(s * scale), -1 if at < 0 else round(at * ticks) + base) for at, s in edits[kind]]
    table = struct.pack(">II", 0, len(rows)) + b"".join(struct.pack(">IiI", n, at, 0x10000) for n, at in rows)
    parts: list[bytes] = []
    for at, n, name in _boxes(track, 8, len(track)):
        part = bytearray(track[at : at + n])
        if name == b"tkhd":
            part[28:32] = struct.pack(">I", sum(row[0] for row in rows))
        if name != b"edts":
            parts += [bytes(part)] + ([_box(b"edts", _box(b"elst", table))] if name == b"tkhd" else [])
    return _box(b"trak", *parts)


def _box(kind: bytes, *parts: bytes) -> bytes:
    body = b"".join(parts)
    return struct.pack(">I4s", 8 + len(body), kind) + body


def _boxes(data: bytes, at: int, end: int) -> list[tuple[int, int, bytes]]:
    found = []
    while at + 8 <= end:
        size, kind = struct.unpack(">I4s", data[at : at + 8])
        found.append((at, size, kind))
        at += size
    return found


def write_avi(
    path: Path, fourcc: bytes, chunks: Sequence[bytes], keys: Sequence[bool], length: int | None = None
) -> Path:
    """A plain AVI file of given chunks at 25 frames per second; an empty chunk repeats a picture.

    Args:
        length: number of frames that the header announces; None: the number of chunks.
    """
    count = len(chunks) if length is None else length
    header = struct.pack("<14I", 40000, 0, 0, 0x10, count, 0, 1, 1 << 16, WIDTH, HEIGHT, 0, 0, 0, 0)
    about = (b"vids", fourcc, 0, 0, 0, 0, 1, 25, 0, count, 1 << 16, 0xFFFFFFFF, 0, 0, 0, WIDTH, HEIGHT)
    stream = struct.pack("<4s4sIHHIIIIIIII4H", *about)
    form = struct.pack("<IiiHH4sIiiII", 40, WIDTH, HEIGHT, 1, 24, fourcc, WIDTH * HEIGHT * 3, 0, 0, 0, 0)
    lists = _list(b"hdrl", _chunk(b"avih", header), _list(b"strl", _chunk(b"strh", stream), _chunk(b"strf", form)))
    movi, table = b"", b""
    for chunk, key in zip(chunks, keys, strict=True):
        table += b"00dc" + struct.pack("<III", 0x10 if key else 0, len(movi) + 4, len(chunk))
        movi += _chunk(b"00dc", chunk)
    body = b"AVI " + lists + _list(b"movi", movi) + _chunk(b"idx1", table)
    path.write_bytes(b"RIFF" + struct.pack("<I", len(body)) + body)
    return path


def _chunk(name: bytes, body: bytes) -> bytes:
    return name + struct.pack("<I", len(body)) + body + bytes(len(body) % 2)


def _list(name: bytes, *parts: bytes) -> bytes:
    body = b"".join(parts)
    return b"LIST" + struct.pack("<I", len(body) + 4) + name + body


def coded(path: Path) -> tuple[list[bytes], list[bool]]:
    """The packets of a file's video, and whether each is a key."""
    with av.open(str(path)) as source:
        found = [(bytes(packet), packet.is_keyframe) for packet in source.demux(video=0) if packet.size]
    return [data for data, _key in found], [key for _data, key in found]


NOT_CODED = b"\0\0\1\xb6" + bytes([0b01010000 | 0b0000, 0b01011111])
"""An MPEG-4 picture (P, 25 ticks a second) that repeats the one before."""
