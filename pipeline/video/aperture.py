"""The part of each stored picture that is shown: clean aperture of MP4 and MOV, PixelCrop of Matroska.

FFmpeg's demuxers read both (`AV_PKT_DATA_FRAME_CROPPING`), but PyAV does not hand them on.
Sources: ISO/IEC 14496-12, CleanApertureBox; RFC 9559, PixelCropTop and its neighbours.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from av.container import InputContainer
from av.video.stream import VideoStream

from pipeline.video.container import MATROSKA, MOV

Crop = tuple[int, int, int, int]
"""Pixels that are not shown: left, top, right, bottom."""
_Box = tuple[bytes, int, int]
"""Kind, start of the content, end."""
_ENTRY = {b"stsd": 8}
_SAMPLE_ENTRY = 78
"""Bytes of a visual sample entry before its boxes."""
_SEGMENT, _TRACKS, _TRACK, _VIDEO, _CLUSTER = 0x18538067, 0x1654AE6B, 0xAE, 0xE0, 0x1F43B675
_CROPS = (0x54CC, 0x54BB, 0x54DD, 0x54AA)
_MOST_BOXES = 10_000


def crop_of(path: Path, container: InputContainer, stream: VideoStream) -> Crop | None:
    """The crop that the container asks for; None: none, or one that leaves nothing."""
    number = [each.index for each in container.streams.video].index(stream.index)
    width, height = stream.codec_context.width, stream.codec_context.height
    try:
        with path.open("rb") as file:
            if container.format.name == MOV:
                found = _clean_aperture(file, number, width, height)
            elif container.format.name == MATROSKA:
                found = _pixel_crop(file, number)
            else:
                return None
    except (struct.error, OSError, ZeroDivisionError):
        return None
    if found is None or min(found) < 0 or not any(found):
        return None
    left, top, right, bottom = found
    return found if left + right < width and top + bottom < height else None


def _clean_aperture(file: BinaryIO, number: int, width: int, height: int) -> Crop | None:
    videos = [box for box in _boxes(file, _named(file, 0, _size(file), b"moov")) if _is_video(file, box)]
    if number >= len(videos):
        return None
    at, end = videos[number][1:]
    for name in (b"mdia", b"minf", b"stbl", b"stsd"):
        at, end = _named(file, at, end, name)
        at += _ENTRY.get(name, 0)
    entry = next(iter(_boxes(file, (at, end))), None)
    if entry is None:
        return None
    start, stop = _named(file, entry[1] + _SAMPLE_ENTRY, entry[2], b"clap")
    file.seek(start)
    values = struct.unpack(">8i", file.read(32)) if stop - start >= 32 else ()
    if not values:
        return None
    across, down, right_of, below = (values[n] / values[n + 1] for n in (0, 2, 4, 6))
    left, top = round((width - across) / 2 + right_of), round((height - down) / 2 + below)
    return left, top, width - round(across) - left, height - round(down) - top


def _is_video(file: BinaryIO, track: _Box) -> bool:
    if track[0] != b"trak":
        return False
    at, _end = _named(file, *_named(file, track[1], track[2], b"mdia"), b"hdlr")
    file.seek(at + 8)
    return file.read(4) == b"vide"


def _named(file: BinaryIO, at: int, end: int, name: bytes) -> tuple[int, int]:
    """Content of the first box of this kind; an empty range if there is none."""
    return next(((start, stop) for kind, start, stop in _boxes(file, (at, end)) if kind == name), (end, end))


def _boxes(file: BinaryIO, within: tuple[int, int]) -> Iterator[_Box]:
    at, end = within
    for _ in range(_MOST_BOXES):
        if at + 8 > end:
            return
        file.seek(at)
        size, kind = struct.unpack(">I4s", file.read(8))
        start = at + 8
        if size == 1:
            size, start = struct.unpack(">Q", file.read(8))[0], at + 16
        stop = end if size == 0 else at + size
        if stop <= start - 1 or stop > end:
            return
        yield kind, start, stop
        at = stop


def _pixel_crop(file: BinaryIO, number: int) -> Crop | None:
    segments = ((start, stop) for name, start, stop in _elements(file, 0, _size(file)) if name == _SEGMENT)
    for name, start, stop in _elements(file, *next(segments, (0, 0))):
        if name == _CLUSTER:
            return None
        if name == _TRACKS:
            tracks = [entry for entry in _elements(file, start, stop) if entry[0] == _TRACK]
            videos = [v for t in tracks for v in _elements(file, t[1], t[2]) if v[0] == _VIDEO]
            if number >= len(videos):
                return None
            values = {name: (at, last) for name, at, last in _elements(file, *videos[number][1:])}
            sides = [_integer(file, values.get(side)) for side in _CROPS]
            return sides[0], sides[1], sides[2], sides[3]
    return None


def _elements(file: BinaryIO, at: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Identifier, start of the content and end of each EBML element."""
    for _ in range(_MOST_BOXES):
        if at >= end:
            return
        file.seek(at)
        name, length = _variable(file, keeps_marker=True)
        size, more = _variable(file)
        start = at + length + more
        unknown = size == (1 << 7 * more) - 1
        stop = end if unknown else start + size
        if stop > end:
            stop = end
        yield name, start, stop
        at = stop


def _variable(file: BinaryIO, keeps_marker: bool = False) -> tuple[int, int]:
    """An EBML number of variable length, and that length in bytes. Raises struct.error at the end of the file."""
    (first,) = struct.unpack("B", file.read(1))
    length = 9 - first.bit_length()
    rest = file.read(length - 1)
    if length > 8 or len(rest) < length - 1:
        raise struct.error("no number")
    value = first if keeps_marker else first & (1 << (8 - length)) - 1
    return int.from_bytes(bytes([value]) + rest, "big"), length


def _integer(file: BinaryIO, place: tuple[int, int] | None) -> int:
    if place is None:
        return 0
    file.seek(place[0])
    return int.from_bytes(file.read(min(8, place[1] - place[0])), "big")


def _size(file: BinaryIO) -> int:
    return file.seek(0, 2)
