"""Where answers go: a video file (`film`), numbered frames, a network stream, a window (`window`)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from fractions import Fraction

import av
import cv2
import numpy as np
from av.container import OutputContainer
from av.video.stream import VideoStream

from impasto.cli.delivery import Target, forget, swap, target
from impasto.live.sources import Size, Source
from pipeline.errors import BadInput, ImpastoError
from pipeline.frames import Frame
from pipeline.video.stills import encode_png


class OutputLost(ImpastoError):
    """What took the stream takes no more."""

    code = "output-lost"


class Sink(ABC):
    """Takes frames in order of time. One thread makes it, feeds it and finishes it."""

    beside = False
    """Whether it wants the originals."""

    @abstractmethod
    def put(self, when_s: float, frame: Frame, original: Frame | None) -> None:
        """A frame shown from `when_s` on, seconds from the source's first. Of any size: that of the work may change."""

    def attend(self) -> bool:
        """Called often. False: it wants no more."""
        return True

    @abstractmethod
    def finish(self, end_s: float) -> str:
        """The last frame is shown until `end_s`. Returns where it all is ("" if there was no frame). Called once."""


def open_sink(text: str, source: Source, quality: int) -> Sink:
    """A sink by its name: a file, a folder (`DIR/`), rtmp://..., `window`, or `none` (frames are counted, not kept).

    Raises: BadInput.
    """
    if text == "none":
        return Nothing()
    if text == "window":
        from impasto.live.window import Window

        return Window(source.size)
    if "://" in text:
        return Broadcast(text, source.size, source.fps)
    where = target(text)
    if where.kind == "still" or where.path.suffix == ".zip":
        remedy = "Use a .mp4 or .webm file, or DIR/ for numbered frames."
        raise BadInput("A stream cannot be written to that.", field="--output", value=text, remedy=remedy)
    if where.kind == "frames":
        return Frames(where)
    from impasto.live.film import Film

    return Film(where, source, quality)


class Nothing(Sink):
    """Keeps nothing: for measuring."""

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> None:
        return

    def finish(self, end_s: float) -> str:
        return "none"


class Frames(Sink):
    """A folder of PNGs, numbered from 0000 in the order of answers. It replaces one of an earlier run at the end."""

    def __init__(self, where: Target) -> None:
        self._where, self._count = where, 0
        self._part = where.path.with_name(f".{where.path.name}.part")

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> None:
        if not self._count:
            forget(self._part)
            self._part.mkdir(parents=True)
        (self._part / f"{self._count:04d}.png").write_bytes(encode_png(frame))
        self._count += 1

    def finish(self, end_s: float) -> str:
        if not self._count:
            return ""
        swap(self._part, self._where.path)
        return str(self._where.path)


class Broadcast(Sink):
    """A live stream to a server (RTMP, RTSP, or whatever else FFmpeg takes MPEG-TS for)."""

    def __init__(self, address: str, size: Size, fps: float) -> None:
        self._address, self._size = address, (size[0] - size[0] % 2, size[1] - size[1] % 2)
        kind = "flv" if address.startswith("rtmp") else "rtsp" if address.startswith("rtsp") else "mpegts"
        try:
            self._file: OutputContainer = av.open(address, "w", format=kind, timeout=10)
            self._stream = _h264(self._file, self._size, fps)
            self._file.start_encoding()
        except (av.FFmpegError, OSError, ValueError) as error:
            raise BadInput(
                f"It cannot be streamed to: {error}.", field="--output", value=address,
                remedy="Check the address, and that the server takes a stream there.",
            ) from None  # fmt: skip
        self._last, self._lost = -1, False

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> None:
        at = round(when_s * 1000)
        if at > self._last:
            picture = av.VideoFrame.from_ndarray(at_size(frame, self._size), format="rgb24")
            picture.pts, picture.time_base, self._last = at, Fraction(1, 1000), at
            self._send(picture)

    def _send(self, picture: av.VideoFrame | None) -> None:
        try:
            self._file.mux(self._stream.encode(picture))
        except (av.FFmpegError, OSError) as error:
            self._lost = True
            raise OutputLost(
                f"The server takes no more: {error}.", field="--output", value=self._address,
                remedy="Check the server, then start again.",
            ) from None  # fmt: skip

    def finish(self, end_s: float) -> str:
        if not self._lost:
            self._send(None)
            self._file.close()
        return self._address


def _h264(file: OutputContainer, size: Size, fps: float) -> VideoStream:
    """A stream that nothing is held back in."""
    rate = Fraction(fps).limit_denominator(1001)
    stream = file.add_stream("libx264", rate=rate, options={"preset": "veryfast", "tune": "zerolatency"})
    assert isinstance(stream, VideoStream)
    stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
    stream.codec_context.time_base = Fraction(1, 1000)
    stream.codec_context.gop_size = max(1, round(2 * fps))
    return stream


def at_size(frame: Frame, size: Size) -> Frame:
    """An answer of a lower work resolution is enlarged: what is written has one size."""
    if (frame.shape[1], frame.shape[0]) == size:
        return frame
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_LINEAR), np.uint8)
