"""Where answers go: a video file, numbered frames, a network stream, a window."""

from __future__ import annotations

import tempfile
from fractions import Fraction
from pathlib import Path
from typing import Protocol, cast

import av
import cv2
import numpy as np
from av.container import OutputContainer
from av.video.stream import VideoStream

from impasto.cli.delivery import Target, deliver, target
from impasto.live.sources import Size, Source
from pipeline.errors import BadInput
from pipeline.frames import Frame
from pipeline.video.join import join
from pipeline.video.stills import encode_png
from pipeline.video.writer import Format, SegmentSpec, segment_writer

TICKS = 90_000
"""Of a second: the clock of frame times in what is written."""


class Sink(Protocol):
    """Takes frames of one size, in order of time."""

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> bool:
        """A frame shown from `when_s` on, seconds from the first; `original` if the sink wants it. False: stop."""
        ...

    def finish(self, end_s: float) -> str:
        """The last frame is shown until `end_s`. Returns where it all is. Call it once, also after Ctrl-C."""
        ...


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
    if where.kind == "still":
        raise BadInput("A stream is not one picture.", field="--output", value=text, remedy="Use a .mp4 file or DIR/.")
    return Frames(where) if where.kind == "frames" else File(where, source, quality)


class Nothing:
    def put(self, when_s: float, frame: Frame, original: Frame | None) -> bool:
        return True

    def finish(self, end_s: float) -> str:
        return "none"


class File:
    """A video with the times and the sound of its source: where frames were dropped, the one before stays longer."""

    def __init__(self, where: Target, source: Source, quality: int) -> None:
        self._where, self._sound = where, source.sound
        self._scratch = tempfile.TemporaryDirectory(prefix="impasto-")
        self._part = Path(self._scratch.name) / "pictures"
        self._spec = SegmentSpec(cast(Format, where.format), source.size, Fraction(1, TICKS), source.fps, quality)
        self._writer = segment_writer(self._part, self._spec).__enter__()
        self._held: tuple[int, Frame] | None = None
        self._origin = 0.0

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> bool:
        start = round(when_s * TICKS)
        if self._held is None:
            self._origin = when_s
        elif start > self._held[0]:
            self._write(start)
        else:
            return True  # two frames of one moment: the first is shown
        self._held = (start, _at_size(frame, self._spec.size))
        return True

    def _write(self, stop: int) -> None:
        assert self._held is not None
        self._writer.write(self._writer.frames, self._held[1], self._held[0], stop)

    def finish(self, end_s: float) -> str:
        if self._held is None:
            self._writer.close()
            self._scratch.cleanup()
            return ""
        self._write(max(round(end_s * TICKS), self._held[0] + 1))
        self._writer.__exit__(None, None, None)
        whole = Path(self._scratch.name) / "whole"
        join([(Fraction(self._origin).limit_denominator(TICKS), self._part)], whole, self._spec.format, self._sound)
        deliver(whole, self._where)
        self._scratch.cleanup()
        return str(self._where.path)


class Frames:
    """A folder of PNGs, numbered from 0000 in the order of answers."""

    def __init__(self, where: Target) -> None:
        self._where, self._count = where, 0
        where.path.mkdir(parents=True, exist_ok=True)
        for old in where.path.glob("*.png"):  # `target` has made sure that they are frames of an earlier run
            old.unlink()

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> bool:
        (self._where.path / f"{self._count:04d}.png").write_bytes(encode_png(frame))
        self._count += 1
        return True

    def finish(self, end_s: float) -> str:
        return str(self._where.path)


class Broadcast:
    """A live stream to a server (RTMP, or whatever FFmpeg writes FLV or MPEG-TS to)."""

    def __init__(self, address: str, size: Size, fps: float) -> None:
        self._address, self._size = address, (size[0] - size[0] % 2, size[1] - size[1] % 2)
        kind = "flv" if address.startswith("rtmp") else "rtsp" if address.startswith("rtsp") else "mpegts"
        try:
            self._file: OutputContainer = av.open(address, "w", format=kind, timeout=10)
            rate = Fraction(fps).limit_denominator(1001)
            stream = self._file.add_stream("libx264", rate=rate, options={"preset": "veryfast", "tune": "zerolatency"})
            assert isinstance(stream, VideoStream)
            stream.width, stream.height, stream.pix_fmt = *self._size, "yuv420p"
            stream.codec_context.time_base = Fraction(1, 1000)
            stream.codec_context.gop_size = max(1, round(2 * fps))
            self._file.start_encoding()
        except (av.FFmpegError, OSError, ValueError) as error:
            raise BadInput(
                f"It cannot be streamed to: {error}.", field="--output", value=address,
                remedy="Check the address, and that the server takes a stream there.",
            ) from None  # fmt: skip
        self._stream, self._last = stream, -1

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> bool:
        at = round(when_s * 1000)
        if at > self._last:
            picture = av.VideoFrame.from_ndarray(_at_size(frame, self._size), format="rgb24")
            picture.pts, picture.time_base, self._last = at, Fraction(1, 1000), at
            self._file.mux(self._stream.encode(picture))
        return True

    def finish(self, end_s: float) -> str:
        self._file.mux(self._stream.encode(None))
        self._file.close()
        return self._address


def _at_size(frame: Frame, size: Size) -> Frame:
    """An answer of a lower work resolution is enlarged: what is written has one size."""
    if (frame.shape[1], frame.shape[0]) == size:
        return frame
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_LINEAR), np.uint8)
