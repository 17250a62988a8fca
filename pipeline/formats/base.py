"""Descriptions of file formats: how a format is recognised, read and written, and what it can hold.

A format is one module of this folder and one row in `pipeline.formats`. `ImageFormat` reads still and animated images.
`OutputFormat` describes a format that films are written in; the writer, the command, the API and the pages take their
lists from it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter
from pipeline.frames import Plane
from pipeline.video.media import Limits

_SQUARE_TOLERANCE = 0.005
Progress = Callable[[float], None]
Segments = Sequence[tuple[Fraction, Path]]
"""(start time in seconds, file) of each segment of a film, in order."""


def square_size(width: int, height: int, aspect: float) -> tuple[int, int]:
    """(width, height) with square pixels, px, from pixels of this aspect (width : height). One side is enlarged, to an
    even number of px; none is reduced, to keep detail."""
    if abs(Fraction(aspect) - 1) <= _SQUARE_TOLERANCE:
        return width, height
    return (2 * round(width * aspect / 2), height) if aspect > 1 else (width, 2 * round(height / aspect / 2))


def square_pixels(picture: AnyArray, aspect: float) -> AnyArray:
    """The picture with square pixels, see `square_size`; an aspect that no camera has is ignored."""
    height, width = picture.shape[:2]
    size = square_size(width, height, aspect) if 0.01 <= aspect <= 100 else (width, height)
    return picture if size == (width, height) else np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC))


def aspect_notes(aspect: float) -> tuple[str, ...]:
    """The warning of a job whose pictures `square_pixels` has scaled; none for square pixels."""
    return (f"Pixels have the aspect {aspect:g}: pictures are scaled to square pixels.",) if aspect != 1 else ()


@dataclass(frozen=True)
class Carries:
    """Capabilities of a format. `depth_bits`: maximum number of bits of a colour channel."""

    alpha: bool = False
    depth_bits: int = 8
    animation: bool = False
    sound: bool = False
    metadata: bool = True
    planes: bool = False
    """Whether it holds named planes besides a picture: depth, normals, motion vectors."""


@dataclass(frozen=True)
class Choice:
    """Which picture of an image with several is read, "" = the usual one; and how its linear light is shown.

    Attributes:
        deep: as uint16 or float32, not clipped to 0..1, instead of uint8, if the file has more than 8 bits.
        colour, colour_view: as in `SourceOptions`; formats with linear light convert it, others leave that to others.
    """

    layer: str = ""
    view: str = ""
    deep: bool = False
    colour: str = ""
    colour_view: str = ""


@dataclass(frozen=True)
class ImageHeader:
    """Facts of an image file, read without decoding its pixels. Sizes are as stored, before rotation, px."""

    media_type: str
    width: int
    height: int
    animated: bool = False
    """Whether the file holds a sequence of pictures with times, which is read as a video."""


@dataclass(frozen=True)
class PlaneImage:
    """Decoded image with named planes: size (width, height) px, float32 (h, w) planes by full channel name
    "part.layer.pass.X", and the choice and facts with which its picture is found."""

    size: tuple[int, int]
    planes: Mapping[str, Plane]
    pixel_aspect: float = 1.0
    views: tuple[str, ...] = ()
    """Names of its views (stereo), the usual one first."""
    to_709: tuple[tuple[float, ...], ...] = ()
    """Matrix from the picture's linear light to that of Rec. 709; () = it is Rec. 709."""
    attributes: Mapping[str, str] = field(default_factory=dict)
    """Texts of the header that belong to planes: names and manifests of Cryptomattes."""


class ImageFormat(ABC):
    """A format of images. Methods raise UnreadableMedia and MediaTooLarge; sizes are checked before pixels are decoded.

    Attributes:
        name: short name, for example "png".
        suffixes: file name extensions with the dot, lower case; the first one is used for new files.
    """

    name: str
    title: str
    media_type: str
    suffixes: tuple[str, ...]
    carries = Carries()
    premultiplied = False
    """Whether stored colours are multiplied by the opacity; `read` divides them."""

    @abstractmethod
    def sniff(self, head: bytes) -> bool:
        """Whether a file with these first bytes (up to 4096) has this format."""

    @abstractmethod
    def header(self, stream: BinaryIO) -> ImageHeader: ...

    def notes(self, data: bytes, choice: Choice = Choice()) -> tuple[str, ...]:
        """Sentences about what reading leaves out, corrects or assumes, for the warnings of a job."""
        return ()

    @abstractmethod
    def read(self, data: bytes, limits: Limits, name: str, choice: Choice = Choice()) -> AnyArray:
        """The (first) picture as displayed: (h, w), (h, w, 3) RGB or (h, w, 4) RGBA with straight alpha, sRGB; uint8,
        or uint16 or float32 for formats that hold more.

        Args:
            name: the file's name in error messages.
        """

    def animation(self, path: Path, limits: Limits) -> AnimatedFrames:
        """The pictures of an animated file. Only formats with `carries.animation` have it."""
        raise NotImplementedError

    def planes(self, data: bytes | Path, limits: Limits, name: str) -> PlaneImage:
        """All named planes. Only formats with `carries.planes` have it."""
        raise NotImplementedError

    def written(self, planes: Mapping[str, Plane]) -> bytes:
        """An image of planes of float32, or uint32 for whole numbers. Only formats with `carries.planes` have it."""
        raise NotImplementedError

    def united(self, files: Sequence[bytes]) -> bytes:
        """An image of the planes of several files of `written`. Only formats with `carries.planes` have it."""
        raise NotImplementedError

    def with_planes(self, picture: bytes, planes: bytes) -> bytes:
        """A picture, with its attributes, and the planes of a file of `written`, in one image. Only formats with
        `carries.planes` have it."""
        raise NotImplementedError

    def channels(self, stream: BinaryIO, name: str = "image") -> PlaneImage:
        """The names of all planes, without their values. Only formats with `carries.planes` have it."""
        raise NotImplementedError


class AnimatedFrames(ABC):
    """The pictures of an animated image, read in order."""

    starts: Sequence[int]
    """Presentation times, ticks of 1 ms, ascending."""
    end: int
    """End of the last picture, ticks."""
    incomplete: frozenset[int] = frozenset()
    """Indices of pictures whose data are cut off: the picture before is shown."""

    @abstractmethod
    def frames(self, start: int) -> Iterator[AnyArray]:
        """The pictures from `start` on, uint8 (h, w, 3) or (h, w, 4) with straight alpha."""

    @abstractmethod
    def close(self) -> None: ...


Quality = Callable[[int], dict[str, str]]
"""Options of an encoder for a quality, 0 to 51."""


@dataclass(frozen=True)
class Encoding:
    """Name of an output format, and the quality of those that are encoded when segments are joined, 0 to 51."""

    format: str
    quality: int = 20


@dataclass(frozen=True, kw_only=True)
class Profile:
    """One encoding of an output format: codec, chroma, depth.

    Attributes:
        name: its name in requests, for example "4444".
        title, help: shown in forms.
        depth_bits: bits of a colour channel; 16 and 32 with `is_float`: half and single floating point.
        is_float: whether the colours are scene-linear floating point with premultiplied opacity.
        has_quality: whether the request's quality has an effect.
        codec: FFmpeg's encoder.
        tag: four-character code of the codec in QuickTime files, if the codec has several.
        codec_options: options of the encoder.
        pixel_format: FFmpeg's pixel format of encoded pictures.
        alpha_format: that of pictures with opacity; "" = the codec has none.
        even: whether sides must be even.
        always_709: whether the matrix is BT.709 in small pictures too.
        min_size: least (width, height), px.
        segment_container, alpha_container: muxer of segments, if not the film's; of those with opacity, if another.
        low_bytes_per_pixel: least size of a film, bytes per pixel and frame, for checks of free space.
        bytes_per_pixel: usual size while the job runs, for estimates.
        encode: encodes one picture as an image, for films of numbered images: (h, w, 3) or (h, w, 4) with straight
            opacity, uint8, uint16, or float32 with white at 1; and its colour space, "": sRGB.
    """

    name: str
    title: str
    help: str = ""
    depth_bits: int = 8
    is_float: bool = False
    has_quality: bool = True
    codec: str = ""
    tag: str = ""
    codec_options: Quality = lambda quality: {}
    pixel_format: str = "yuv420p"
    alpha_format: str = ""
    even: bool = False
    always_709: bool = False
    min_size: tuple[int, int] = (0, 0)
    segment_container: str = ""
    alpha_container: str = ""
    low_bytes_per_pixel: float = 0.005
    bytes_per_pixel: float = 0.05
    encode: Callable[[AnyArray, str], bytes] | None = None

    @property
    def has_alpha(self) -> bool:
        return self.encode is not None or bool(self.alpha_format)

    @property
    def is_deep(self) -> bool:
        """Whether it holds more than 8 bits of a channel."""
        return self.depth_bits > 8

    @property
    def has_spaces(self) -> bool:
        """Whether its pictures can have any colour space: images of more than 8 bits, whose readers are told it."""
        return self.encode is not None and self.is_deep

    @property
    def has_hdr(self) -> bool:
        """Whether its films can have the signals of ITU-R BT.2100, PQ and HLG."""
        return self.encode is None and self.is_deep and not self.always_709


@dataclass(frozen=True, kw_only=True)
class SoundCodecs:
    """Sound of a container.

    Attributes:
        copied: codecs whose packets are copied.
        encoder: FFmpeg's encoder of all others.
        sample_format: of the encoder; "" = its usual one.
    """

    copied: frozenset[str]
    encoder: str
    sample_format: str = ""


@dataclass(frozen=True, kw_only=True)
class OutputFormat:
    """A format that films are written in.

    Attributes:
        name: its name in requests, for example "mp4".
        title, help: shown in forms.
        suffixes: extensions of the file, the first one for new files.
        profiles: its encodings, the usual one first.
        frame_suffixes: extensions of the files if the film is a folder or zip of numbered images; () = one file.
        lossy: whether a film in this format is too coarse to be converted to another one.
        shown_as: how a browser shows the film: "video", "image", or "sheet" (a contact sheet instead).
        container: FFmpeg's name of the muxer of the film; "" = a zip of images.
        mux_options: options of the film's muxer.
        sound: None: the film has no sound.
        subtitles: codecs of subtitles that are copied.
        timecode: whether the film has a timecode.
        rates: frame rates that it knows, frames per second, if all frames must have one duration; () = any times.
        max_side_px: longest side; larger frames are scaled down.
        join: makes the film from its segments, if that is more than to copy packets; arguments: segments, out,
            progress, quality.
    """

    name: str
    title: str
    help: str
    media_type: str
    suffixes: tuple[str, ...]
    profiles: tuple[Profile, ...]
    frame_suffixes: tuple[str, ...] = ()
    lossy: bool = False
    shown_as: str = "video"
    container: str = ""
    mux_options: Mapping[str, str] | None = None
    sound: SoundCodecs | None = None
    subtitles: frozenset[str] = frozenset()
    timecode: bool = False
    rates: tuple[Fraction, ...] = ()
    max_side_px: int = 0
    join: Callable[[Segments, Path, Progress, int], None] | None = None

    def profile(self, name: str = "") -> Profile:
        """The profile of this name; "": the usual one. Raises BadParameter."""
        found = next((profile for profile in self.profiles if name in ("", profile.name)), None)
        if found is None:
            raise BadParameter(f"{self.title} has no profile of this name.", field="output.profile", value=name,
                               remedy=f"Use one of: {', '.join(p.name for p in self.profiles)}.")  # fmt: skip
        return found

    def check(self, profile: Profile, size: tuple[int, int], fps: float) -> None:
        """Raise BadParameter if the profile cannot hold frames of this (width, height) px, or this rate per second."""
        least, held = profile.min_size, f"{size[0]}x{size[1]} px, {fps:g} frames/s"
        if size[0] < least[0] or size[1] < least[1]:
            others = ", ".join(other.name for other in self.profiles if other.min_size < least)
            raise BadParameter(
                f"{profile.title} needs at least {least[0]}x{least[1]} px.", field="output.profile", value=held,
                remedy=f"Use another profile: {others}." if others else "Use another format.",
            )  # fmt: skip
        if self.rates and not any(abs(float(rate) - fps) < rate / 2000 for rate in self.rates):
            known = ", ".join(f"{float(rate):.6g}" for rate in self.rates)
            raise BadParameter(
                f"{self.title} has no such frame rate.", field="output.format", value=held,
                remedy=f"Use a video of {known} frames/s, or another format.",
            )  # fmt: skip

    def coded_size(self, size: tuple[int, int], profile: Profile) -> tuple[int, int]:
        """(width, height) of the encoded film, px, for frames of this size."""
        width, height = size
        if self.max_side_px:
            scale = min(1.0, self.max_side_px / max(size))
            width, height = max(1, round(scale * width)), max(1, round(scale * height))
        return (width + width % 2, height + height % 2) if profile.even else (width, height)
