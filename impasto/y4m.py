"""Uncompressed video on pipes: YUV4MPEG2 (`yuv4mpeg`, as FFmpeg and mjpegtools write it) and raw RGB frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import BinaryIO, NoReturn

import av
import numpy as np
from av.video.reformatter import ColorRange
from numpy.typing import NDArray

from pipeline.errors import UnreadableMedia
from pipeline.frames import Frame
from pipeline.video.fields import deinterlaced
from pipeline.video.geometry import customary_matrix, geometry_of, to_frame
from pipeline.video.media import Fields, Limits, check_size
from pipeline.video.pixel_formats import YuvConverter

MAGIC = b"YUV4MPEG2"
MAX_LINE = 1024
"""Bytes of a header line."""
PIXEL_FORMATS = {
    "420": "yuv420p",
    "420jpeg": "yuv420p",
    "420mpeg2": "yuv420p",
    "420paldv": "yuv420p",
    "422": "yuv422p",
    "444": "yuv444p",
    "mono": "gray",
    "420p10": "yuv420p10le",
    "422p10": "yuv422p10le",
    "444p10": "yuv444p10le",
}
"""Tag `C` of the header -> FFmpeg's name. Chroma samples count as in the middle, as swscale takes them."""
WRITTEN = {"yuv420p": "420mpeg2", "yuv422p": "422", "yuv444p": "444"}
"""Pixel formats that are written -> tag `C`."""


_FIELDS: dict[str, Fields] = {"p": "progressive", "?": "progressive", "t": "top", "b": "bottom"}
"""Tag `I` of the header."""


@dataclass(frozen=True)
class StreamFormat:
    """The header of a YUV4MPEG2 stream."""

    size: tuple[int, int]
    """(width, height) of the stored pictures, px."""
    fps: Fraction
    pixel_format: str = "yuv420p"
    aspect: Fraction | None = None
    """Width over height of a stored pixel; None: unknown, taken as square."""
    full_range: bool = False
    fields: Fields = "progressive"
    """"top" or "bottom": the first field of every picture."""


class Y4mReader:
    """Frames of a YUV4MPEG2 stream, read on demand. Iterate once. Interlaced pictures are deinterlaced, each with the
    one after it.

    Args:
        fields: "auto": as the header says; otherwise as in `pipeline.video.media.SourceOptions`.

    Raises: UnreadableMedia, MediaTooLarge.
    """

    def __init__(self, stream: BinaryIO, limits: Limits | None = None, fields: Fields = "auto") -> None:
        self._stream = stream
        self.format = _parse(_line(stream))
        self._fields: Fields = self.format.fields if fields == "auto" else fields
        check_size(*self.format.size, limits or Limits())

    def __iter__(self) -> Iterator[Frame]:
        geometry = None
        for _number, picture in deinterlaced(enumerate(self._pictures()), self._fields):
            geometry = geometry or geometry_of(picture, self.format.aspect)
            yield to_frame(picture, geometry)

    def _pictures(self) -> Iterator[av.VideoFrame]:
        index = 0
        while line := _line(self._stream):
            if line.split(b" ")[0] != b"FRAME":
                _damaged(f"Frame {index} does not begin with FRAME.")
            yield self._picture(index)
            index += 1

    def _picture(self, index: int) -> av.VideoFrame:
        picture = av.VideoFrame(*self.format.size, self.format.pixel_format)
        picture.color_range = ColorRange.JPEG if self.format.full_range else ColorRange.MPEG
        for number, plane in enumerate(picture.planes):
            row_bytes = _row_bytes(picture, number)
            data = _exactly(self._stream, row_bytes * plane.height, f"frame {index}")
            rows = np.zeros((plane.height, plane.line_size), np.uint8)
            rows[:, :row_bytes] = np.frombuffer(data, np.uint8).reshape(plane.height, row_bytes)
            plane.update(rows.tobytes())
        return picture


class Y4mWriter:
    """Writes frames as YUV4MPEG2, 8 bit, limited range, and flushes after each."""

    def __init__(self, stream: BinaryIO, form: StreamFormat) -> None:
        self._stream = stream
        self._to_yuv = YuvConverter(customary_matrix(form.size[1]), form.pixel_format)
        width, height = form.size
        rate = f"{form.fps.numerator}:{form.fps.denominator}"
        tag = WRITTEN[form.pixel_format]
        stream.write(MAGIC + f" W{width} H{height} F{rate} Ip A1:1 C{tag} XCOLORRANGE=LIMITED\n".encode())

    def write(self, frame: Frame) -> None:
        picture = self._to_yuv(np.ascontiguousarray(frame))
        self._stream.write(b"FRAME\n")
        for number, plane in enumerate(picture.planes):
            rows = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)
            self._stream.write(rows[: plane.height, : _row_bytes(picture, number)].tobytes())
        self._stream.flush()


def raw_frames(stream: BinaryIO, size: tuple[int, int]) -> Iterator[Frame]:
    """Frames of raw RGB: height x width x 3 bytes each, no header. Raises UnreadableMedia (an incomplete frame at the
    end)."""
    width, height = size
    index = 0
    while first := stream.read(1):
        data = first + _exactly(stream, 3 * width * height - 1, f"frame {index}")
        pixels: NDArray[np.uint8] = np.frombuffer(data, np.uint8)
        yield pixels.reshape(height, width, 3)
        index += 1


def write_raw(stream: BinaryIO, frame: Frame) -> None:
    """Write one frame as raw RGB, and flush."""
    stream.write(np.ascontiguousarray(frame).tobytes())
    stream.flush()


def _row_bytes(picture: av.VideoFrame, plane: int) -> int:
    deep = 2 if picture.format.components[0].bits > 8 else 1
    return picture.planes[plane].width * deep


def _line(stream: BinaryIO) -> bytes:
    """A header line without its newline; b"" at the end of the stream."""
    line = stream.readline(MAX_LINE)
    if line and not line.endswith(b"\n"):
        _damaged("A header line is cut off or too long.")
    return line.rstrip(b"\n")


def _exactly(stream: BinaryIO, count: int, what: str) -> bytes:
    data = stream.read(count)
    if len(data) < count:
        _damaged(f"The stream ends within {what}.")
    return data


def _parse(line: bytes) -> StreamFormat:
    magic, *words = line.decode("ascii", "replace").split(" ")
    if magic.encode() != MAGIC:
        _damaged("The input is not a YUV4MPEG2 stream.")
    tags = {word[:1]: word[1:] for word in words if word and word[0] != "X"}
    extra = {word[1:] for word in words if word.startswith("X")}
    chroma = tags.get("C", "420")
    if chroma not in PIXEL_FORMATS:
        _damaged(f"The chroma format C{chroma} is not supported.", f"Use one of: {', '.join(PIXEL_FORMATS)}.")
    fields = _FIELDS.get(tags.get("I", "p"))
    if fields is None:
        remedy = "Write pictures with one order of fields (It or Ib), or deinterlace it with FFmpeg's filter bwdif."
        _damaged("The order of the fields changes within the stream (I).", remedy)
    try:
        size, fps = (int(tags["W"]), int(tags["H"])), _ratio(tags.get("F", "25:1"))
    except (KeyError, ValueError):
        _damaged("The header has no valid width and height (W, H) or rate (F).")
    if fps is None or fps <= 0:
        _damaged("The frame rate (F) is unknown.", "Set one, for example with FFmpeg's option -r.")
    return StreamFormat(size, fps, PIXEL_FORMATS[chroma], _aspect(tags), "COLORRANGE=FULL" in extra, fields)


def _aspect(tags: dict[str, str]) -> Fraction | None:
    try:
        return _ratio(tags.get("A", "0:0")) or None
    except ValueError:
        _damaged("The pixel aspect ratio (A) cannot be read.")


def _ratio(text: str) -> Fraction | None:
    above, _, below = text.partition(":")
    return Fraction(int(above), int(below)) if int(below) else None


def _damaged(
    message: str, remedy: str = "Write it with: ffmpeg -i CLIP -f yuv4mpegpipe -pix_fmt yuv420p -"
) -> NoReturn:
    raise UnreadableMedia(message, field="IN", value="-", remedy=remedy)
