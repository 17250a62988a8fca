"""Encoding of a run of frames as one *segment*: a file that starts with a keyframe and has no references to other
segments, so that segments can be concatenated without re-encoding (see `join`).

The same frames give the same bytes: the encoders run with a fixed number of threads, x264 does not use its AVX-512 code
(see `_X264_REPEATABLE_ASM`), and the file contains no date and no version. There are no B-frames, so that packets are
in display order and segments can be joined without reordering.

Segments of a GIF are lossless, since its palette is chosen from all of them (see `gif`).

H.264 in 4:2:0, the only variant that all browsers play, requires even sides and can crop only by multiples of two.
An odd side is therefore extended by one repeated row or column. VP9 and PNG keep odd sizes.
"""

from __future__ import annotations

import zipfile
from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

import av
import cv2
import numpy as np
from av.video.codeccontext import VideoCodecContext
from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc
from av.video.stream import VideoStream

from pipeline.errors import BadParameter
from pipeline.frames import Frame, same_size
from pipeline.video.geometry import YuvConverter, customary_matrix
from pipeline.video.stills import encode_png

Format = Literal["mp4", "webm", "png", "gif"]
FORMATS: tuple[Format, ...] = ("mp4", "webm", "png", "gif")
MUXER_OPTIONS = {"fflags": "+bitexact"}
_THREADS = 2
_CPU_AVX_512F = 13
"""`CV_CPU_AVX_512F` in the headers of OpenCV, which its Python module does not export."""
_X264_REPEATABLE_ASM = "MMX2,SSE2Fast,LZCNT,SSSE3,SSE4.2,AVX,FMA3,BMI2,AVX2"
"""CPU features that x264 may use on a processor with AVX-512. With its AVX-512 macroblock-tree code, the same frames of
96x64 gave different files in 3 to 15 % of the runs; without it they never did, at the same speed."""
MAX_GIF_SIDE_PX = 720
"""Longest side of a GIF; larger frames are scaled down."""
_KEY_EVERY = 60
_ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)
_BT601_TAG = 6


@dataclass(frozen=True)
class SegmentSpec:
    """Encoding parameters, the same for all segments of a video."""

    format: Format
    size: tuple[int, int]
    """(width, height) of the input frames, px."""
    time_base: Fraction
    """Duration of a tick, seconds."""
    fps: float
    """Nominal frame rate: a hint for the encoder's rate control and for players."""
    quality: int = 20
    """Constant rate factor, 0 (lossless) to 51; PNG is always lossless, GIF always has 256 colours."""

    @property
    def coded_size(self) -> tuple[int, int]:
        """(width, height) of the encoded video, px."""
        width, height = self.size
        if self.format == "gif":
            scale = min(1.0, MAX_GIF_SIDE_PX / max(self.size))
            return max(1, round(scale * width)), max(1, round(scale * height))
        return (width + width % 2, height + height % 2) if self.format == "mp4" else self.size


class SegmentWriter(ABC):
    """Writes one segment. Use it as a context manager: the file is valid only after an exit without exception."""

    def __init__(self, spec: SegmentSpec) -> None:
        self.spec = spec
        self.frames = 0

    def write(self, index: int, frame: Frame, start: int, stop: int) -> None:
        """Append frame `index` of the video, shown over the ticks [start, stop).

        `start` must equal the `stop` of the frame before.
        """
        self._write(index, same_size(frame, self.spec.size), start, stop)
        self.frames += 1

    @abstractmethod
    def _write(self, index: int, frame: Frame, start: int, stop: int) -> None: ...

    @abstractmethod
    def finish(self) -> None: ...

    @abstractmethod
    def close(self) -> None: ...

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self.finish()
        finally:
            self.close()


def segment_writer(path: Path, spec: SegmentSpec) -> SegmentWriter:
    """Create the writer of one segment at `path`. Raises BadParameter for an unknown format or an invalid quality."""
    if spec.format not in FORMATS:
        remedy = f"Use one of: {', '.join(FORMATS)}."
        raise BadParameter("The output format is unknown.", field="output.format", value=spec.format, remedy=remedy)
    if not 0 <= spec.quality <= 51:
        raise BadParameter("The quality is out of range.", field="output.quality", value=spec.quality, remedy="0..51.")
    if spec.format == "png":
        return ImageSegment(path, spec)
    return GifSegment(path, spec) if spec.format == "gif" else VideoSegment(path, spec)


class VideoSegment(SegmentWriter):
    """H.264 or VP9 in MP4; presentation times start at 0."""

    _container = "mp4"

    def __init__(self, path: Path, spec: SegmentSpec) -> None:
        super().__init__(spec)
        self._file = av.open(f"file:{path}", "w", format=self._container, options=dict(MUXER_OPTIONS))
        codec, options = _codec(spec)
        rate = Fraction(spec.fps).limit_denominator(1001)
        stream = self._file.add_stream(codec, rate=max(rate, Fraction(1, 1001)), options=options)
        assert isinstance(stream, VideoStream)
        _describe(stream.codec_context, spec)
        self._stream, self._to_yuv = stream, YuvConverter(customary_matrix(spec.size[1]))
        self._durations: deque[int] = deque()
        self._origin: int | None = None

    def _write(self, index: int, frame: Frame, start: int, stop: int) -> None:
        self._origin = start if self._origin is None else self._origin
        picture = self._picture(frame)
        picture.pts, picture.time_base = start - self._origin, self.spec.time_base
        self._durations.append(stop - start)
        self._encode(picture)

    def _picture(self, frame: Frame) -> av.VideoFrame:
        return self._to_yuv(_even(frame, self.spec.coded_size))

    def _encode(self, picture: av.VideoFrame | None) -> None:
        for packet in self._stream.encode(picture):
            packet.duration = self._durations.popleft()
            self._file.mux(packet)

    def finish(self) -> None:
        if self.frames:
            self._encode(None)

    def close(self) -> None:
        self._file.close()


class GifSegment(VideoSegment):
    """Lossless RGB (PNG) in MOV, at the GIF's size."""

    _container = "mov"

    def _picture(self, frame: Frame) -> av.VideoFrame:
        size = self.spec.coded_size
        scaled = frame if size == self.spec.size else cv2.resize(frame, size, interpolation=cv2.INTER_AREA)
        return av.VideoFrame.from_ndarray(np.ascontiguousarray(scaled, np.uint8), format="rgb24")


def _codec(spec: SegmentSpec) -> tuple[str, dict[str, str]]:
    if spec.format == "gif":
        return "png", {"compression_level": "1"}
    if spec.format == "webm":
        crf = round(spec.quality * 63 / 51)
        lossless = {"lossless": "1"} if spec.quality == 0 else {}
        speed = {
            "deadline": "realtime",
            "cpu-used": "8",
            "tile-columns": "2",
            "lag-in-frames": "0",
            "auto-alt-ref": "0",
            "row-mt": "0",
        }
        return "libvpx-vp9", {"crf": str(crf), "b": "0", "g": str(_KEY_EVERY)} | speed | lossless
    tuning = {"x264-params": _x264_params(), "preset": "veryfast", "bf": "0"}
    profile = {"profile": "high"} if spec.quality else {}
    return "libx264", {"crf": str(spec.quality), "g": str(_KEY_EVERY)} | tuning | profile


def _x264_params() -> str:
    """Settings of x264 that FFmpeg has no option for. The list of CPU features overrides x264's own detection, so it is
    given only to processors that have all of them: those with AVX-512."""
    limited = cv2.checkHardwareSupport(_CPU_AVX_512F)
    return f"sync-lookahead=0:asm={_X264_REPEATABLE_ASM}" if limited else "sync-lookahead=0"


def _describe(context: VideoCodecContext, spec: SegmentSpec) -> None:
    context.width, context.height = spec.coded_size
    context.time_base = spec.time_base
    if spec.format == "gif":
        context.pix_fmt = "rgb24"
        return
    context.pix_fmt = "yuv420p"
    # Slice threads finish a frame within the call that submits it, so its cost does not appear in a method's timings.
    context.thread_type = "SLICE"
    context.thread_count = _THREADS
    hd = customary_matrix(spec.size[1]) == Colorspace.ITU709
    context.color_range = ColorRange.MPEG
    context.colorspace = Colorspace.ITU709 if hd else _BT601_TAG
    context.color_primaries = ColorPrimaries.BT709 if hd else ColorPrimaries.SMPTE170M
    context.color_trc = ColorTrc.BT709 if hd else ColorTrc.SMPTE170M


def _even(frame: Frame, size: tuple[int, int]) -> Frame:
    right, bottom = size[0] - frame.shape[1], size[1] - frame.shape[0]
    if not right and not bottom:
        return np.ascontiguousarray(frame)
    return np.asarray(cv2.copyMakeBorder(frame, 0, bottom, 0, right, cv2.BORDER_REPLICATE), np.uint8)


class ImageSegment(SegmentWriter):
    """Lossless PNG images, named by frame index, in an uncompressed zip. Presentation times are not stored."""

    def __init__(self, path: Path, spec: SegmentSpec) -> None:
        super().__init__(spec)
        self._zip = zipfile.ZipFile(path, "w", zipfile.ZIP_STORED)

    def _write(self, index: int, frame: Frame, start: int, stop: int) -> None:
        self._zip.writestr(zip_entry(f"{index:04d}.png"), encode_png(frame))

    def finish(self) -> None:
        return

    def close(self) -> None:
        self._zip.close()


def zip_entry(name: str) -> zipfile.ZipInfo:
    """An uncompressed zip entry with a fixed date, so that the same frames give the same bytes."""
    return zipfile.ZipInfo(name, _ZIP_EPOCH)
