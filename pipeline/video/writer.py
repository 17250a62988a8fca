"""Encoding of a run of frames as one *segment*: a file that starts with a keyframe and has no references to other
segments, so that segments can be concatenated without re-encoding (see `join`).

The same frames give the same bytes: the encoders run with a fixed number of threads, x264 does not use its AVX-512 code
(see `_X264_REPEATABLE_ASM`), and the file contains no date and no version. There are no B-frames, so that packets are
in display order and segments can be joined without reordering.

Containers, codecs and their options are those of `pipeline.formats`.

Codecs in 4:2:0 such as H.264 require even sides and can crop only by multiples of two. An odd side is therefore
extended by one repeated row or column. VP9 and images keep odd sizes.
"""

from __future__ import annotations

import zipfile
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import av
import cv2
import numpy as np
from av.video.codeccontext import VideoCodecContext
from av.video.format import VideoFormat
from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc
from av.video.stream import VideoStream

from pipeline.arrays import AnyArray
from pipeline.colour.ocio import check_space, from_display
from pipeline.errors import BadParameter
from pipeline.formats import OUTPUTS, output_format
from pipeline.formats.base import Profile
from pipeline.frames import same_size
from pipeline.video.depth import as_float, with_opacity
from pipeline.video.geometry import customary_matrix
from pipeline.video.pixel_formats import converter_of
from pipeline.video.wide_colour import FILM_SIGNALS, Signal, film_signal, film_values

MUXER_OPTIONS = {"fflags": "+bitexact"}
_THREADS = 2
_ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)
_BT601_TAG, _RGB_TAG = 6, 0


@dataclass(frozen=True)
class SegmentSpec:
    """Encoding parameters, the same for all segments of a video."""

    format: str
    """Name of an output format, see `pipeline.formats`."""
    size: tuple[int, int]
    """(width, height) of the input frames, px."""
    time_base: Fraction
    """Duration of a tick, seconds."""
    fps: float
    """Nominal frame rate: a hint for the encoder's rate control and for players."""
    quality: int = 20
    """Constant rate factor, 0 (lossless) to 51; profiles without a quality ignore it."""
    profile_name: str = ""
    """Name of a profile of the format; "": its usual one."""
    alpha: bool = False
    """Whether frames have opacity."""
    colour: str = ""
    """Colour space of the film, a name of the OpenColorIO configuration, "PQ" or "HLG"; "": the profile's."""
    colour_view: str = ""
    """The view that `colour` is seen through, whose inverse is applied; "": no tone map."""

    @property
    def profile(self) -> Profile:
        return output_format(self.format).profile(self.profile_name)

    @property
    def pixel_format(self) -> str:
        """FFmpeg's pixel format of encoded pictures."""
        return self.profile.alpha_format if self.alpha else self.profile.pixel_format

    @property
    def matrix(self) -> Colorspace:
        """Colour matrix of encoded pictures: that which players assume for their height, unless the codec has one."""
        if self.signal is not None:
            return Colorspace.BT2020
        return Colorspace.ITU709 if self.profile.always_709 else customary_matrix(self.size[1])

    @property
    def signal(self) -> Signal | None:
        """The signal of an HDR film; None: it is none."""
        return film_signal(self.colour) if self.profile.has_hdr else None

    @property
    def coded_size(self) -> tuple[int, int]:
        """(width, height) of the encoded video, px."""
        return output_format(self.format).coded_size(self.size, self.profile)


class SegmentWriter(ABC):
    """Writes one segment. Use it as a context manager: the file is valid only after an exit without exception."""

    def __init__(self, spec: SegmentSpec) -> None:
        self.spec = spec
        self.frames = 0

    def write(self, index: int, frame: AnyArray, start: int, stop: int) -> None:
        """Append frame `index` of the video (or its number, for names of images), shown over the ticks [start, stop).

        Args:
            frame: uint8, uint16 or float32 (h, w, 3), or (h, w, 4) with straight opacity if the spec has `alpha`.
            start: must equal the `stop` of the frame before.
        """
        self._write(index, same_size(frame, self.spec.size), start, stop)
        self.frames += 1

    @abstractmethod
    def _write(self, index: int, frame: AnyArray, start: int, stop: int) -> None: ...

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
    """Create the writer of one segment at `path`. Raises BadParameter for an unknown format or profile, an invalid
    quality, or a size or opacity that the profile cannot hold."""
    profile = spec.profile
    if not 0 <= spec.quality <= 51:
        raise BadParameter("The quality is out of range.", field="output.quality", value=spec.quality, remedy="0..51.")
    output_format(spec.format).check(profile, spec.size, spec.fps)
    if spec.alpha and not profile.has_alpha:
        raise BadParameter(f"{profile.title} has no opacity.", field="output.alpha", value=profile.name)
    check_colour(spec.format, profile, spec.colour)
    return ImageSegment(path, spec) if profile.encode else VideoSegment(path, spec)


def check_colour(form: str, profile: Profile, colour: str) -> None:
    """Raise BadParameter if a film of this format and profile cannot have this colour space."""
    signal = film_signal(colour)
    if not colour or (signal and profile.has_hdr):
        return
    if signal and not profile.has_spaces:
        raise BadParameter(
            f"{output_format(form).title}, {profile.title} holds no HDR.", field="output.colour", value=colour,
            remedy=f"Leave it out, or use one of: {_profiles(lambda each: each.has_hdr)}.",
        )  # fmt: skip
    if not profile.has_spaces:
        hdr = f"use {' or '.join(FILM_SIGNALS)}, " if profile.has_hdr else ""
        raise BadParameter(
            f"{output_format(form).title}, {profile.title} is not written in this colour space.", field="output.colour",
            value=colour, remedy=f"Leave it out, {hdr}or use one of: {_profiles(lambda each: each.has_spaces)}.",
        )  # fmt: skip
    check_space(colour, "output.colour")


def _profiles(chosen: Callable[[Profile], bool]) -> str:
    """Formats and names of these profiles."""
    found = (f"{form.name} {profile.name}" for form in OUTPUTS.values() for profile in form.profiles if chosen(profile))
    return ", ".join(found)


class VideoSegment(SegmentWriter):
    """Encoded pictures in a container; presentation times start at 0."""

    def __init__(self, path: Path, spec: SegmentSpec) -> None:
        super().__init__(spec)
        profile = spec.profile
        container = profile.segment_container or output_format(spec.format).container
        if spec.alpha and profile.alpha_container:
            container = profile.alpha_container
        self._file = av.open(f"file:{path}", "w", format=container, options=dict(MUXER_OPTIONS))
        rate = Fraction(spec.fps).limit_denominator(1001)
        stream = self._file.add_stream(
            profile.codec, rate=max(rate, Fraction(1, 1001)), options=profile.codec_options(spec.quality)
        )
        assert isinstance(stream, VideoStream)
        _describe(stream.codec_context, spec)
        self._stream, self._convert = stream, converter_of(spec.pixel_format, spec.matrix)
        self._durations: deque[int] = deque()
        self._origin: int | None = None

    def _write(self, index: int, frame: AnyArray, start: int, stop: int) -> None:
        self._origin = start if self._origin is None else self._origin
        picture = self._picture(frame)
        picture.pts, picture.time_base = start - self._origin, self.spec.time_base
        context = self._stream.codec_context  # ProRes takes its colour tags from the pictures
        picture.color_primaries, picture.color_trc = context.color_primaries, context.color_trc
        self._durations.append(stop - start)
        self._encode(picture)

    def _picture(self, frame: AnyArray) -> av.VideoFrame:
        size = self.spec.coded_size
        if size[0] < self.spec.size[0] or size[1] < self.spec.size[1]:
            frame = np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA))
        if (signal := self.spec.signal) is not None:
            frame = film_values(frame, signal, self.spec.colour_view)
        return self._convert(_even(frame, size))

    def _encode(self, picture: av.VideoFrame | None) -> None:
        for packet in self._stream.encode(picture):
            packet.duration = round(self._durations.popleft() * self.spec.time_base / packet.time_base)
            self._file.mux(packet)

    def finish(self) -> None:
        if self.frames:
            self._encode(None)

    def close(self) -> None:
        self._file.close()


def _describe(context: VideoCodecContext, spec: SegmentSpec) -> None:
    context.width, context.height = spec.coded_size
    context.time_base = spec.time_base
    context.pix_fmt = spec.pixel_format
    if spec.profile.tag:
        context.codec_tag = spec.profile.tag
    if context.pix_fmt in ("rgb24", "rgba"):  # lossless pictures between this step and the next
        return
    # Slice threads finish a frame within the call that submits it, so its cost does not appear in a method's timings.
    context.thread_type = "SLICE"
    context.thread_count = _THREADS
    if VideoFormat(spec.pixel_format).is_rgb:
        context.color_range, context.colorspace = ColorRange.JPEG, _RGB_TAG
        context.color_primaries, context.color_trc = spec.signal or (ColorPrimaries.BT709, ColorTrc.IEC61966_2_1)
        return
    if spec.signal is not None:
        context.color_range, context.colorspace = ColorRange.MPEG, Colorspace.BT2020
        context.color_primaries, context.color_trc = spec.signal
        return
    hd = spec.matrix == Colorspace.ITU709
    context.color_range = ColorRange.MPEG
    context.colorspace = Colorspace.ITU709 if hd else _BT601_TAG
    context.color_primaries = ColorPrimaries.BT709 if hd else ColorPrimaries.SMPTE170M
    context.color_trc = ColorTrc.BT709 if hd else ColorTrc.SMPTE170M


def _even(frame: AnyArray, size: tuple[int, int]) -> AnyArray:
    right, bottom = size[0] - frame.shape[1], size[1] - frame.shape[0]
    if not right and not bottom:
        return np.ascontiguousarray(frame)
    return np.asarray(cv2.copyMakeBorder(frame, 0, bottom, 0, right, cv2.BORDER_REPLICATE))


class ImageSegment(SegmentWriter):
    """Images, named by frame number, in an uncompressed zip. Presentation times are not stored."""

    def __init__(self, path: Path, spec: SegmentSpec) -> None:
        super().__init__(spec)
        self._zip = zipfile.ZipFile(path, "w", zipfile.ZIP_STORED)
        assert spec.profile.encode is not None
        self._encode, self._suffix = spec.profile.encode, output_format(spec.format).frame_suffixes[0]

    def _write(self, index: int, frame: AnyArray, start: int, stop: int) -> None:
        name = f"{index:0{4 if index >= 0 else 5}d}{self._suffix}"
        self._zip.writestr(zip_entry(name), self._encode(self._in_space(frame), self.spec.colour))

    def _in_space(self, frame: AnyArray) -> AnyArray:
        if not self.spec.colour:
            return frame
        colours = from_display(as_float(frame)[..., :3], self.spec.colour, self.spec.colour_view)
        return colours if frame.shape[2] == 3 else with_opacity(colours, frame[..., 3])

    def finish(self) -> None:
        return

    def close(self) -> None:
        self._zip.close()


def zip_entry(name: str) -> zipfile.ZipInfo:
    """An uncompressed zip entry with a fixed date, so that the same frames give the same bytes."""
    return zipfile.ZipInfo(name, _ZIP_EPOCH)
