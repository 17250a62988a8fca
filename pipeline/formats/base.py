"""Descriptions of file formats: how a format is recognised, read and written, and what it can hold.

A format is one module of this folder and one row in `pipeline.formats`. `ImageFormat` reads still and animated images.
`OutputFormat` describes a format that films are written in; the writer, the command, the API and the pages take their
lists from it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np

from pipeline.arrays import AnyArray
from pipeline.frames import Frame, Plane
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
    """What `square_pixels` does, for the warnings of a job."""
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
    """Which picture of an image with several is read; "" = the usual one."""

    layer: str = ""
    view: str = ""


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

    def animation(self, path: Path, limits: Limits) -> Animation:
        """The pictures of an animated file. Only formats with `carries.animation` have it."""
        raise NotImplementedError

    def planes(self, data: bytes | Path, limits: Limits, name: str) -> PlaneImage:
        """All named planes. Only formats with `carries.planes` have it."""
        raise NotImplementedError


class Animation(ABC):
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


@dataclass(frozen=True, kw_only=True)
class OutputFormat:
    """A format that films are written in.

    Attributes:
        name: its name in requests, for example "mp4".
        title, help: shown in forms.
        suffixes: extensions of the file, the first one for new files.
        folder_suffix: extension of the files if the film is a folder or zip of numbered images; "" = one file.
        has_quality: whether the request's quality has an effect.
        lossy: whether a film in this format is too coarse to be converted to another one.
        shown_as: how a browser shows the film: "video", "image", or "sheet" (a contact sheet instead).
        low_bytes_per_pixel: least size of a film, bytes per pixel and frame, for checks of free space.
        bytes_per_pixel: usual size while the job runs, for estimates.
        container: FFmpeg's name of the muxer of segments and of the film; "" = a zip of images.
        segment_container: muxer of segments, if another one.
        codec: FFmpeg's encoder of segments.
        codec_options: options of the encoder for a quality, 0 to 51.
        pixel_format: FFmpeg's pixel format of encoded pictures.
        mux_options: options of the film's muxer.
        even: whether sides must be even.
        max_side_px: longest side; larger frames are scaled down.
        encode: encodes one frame as an image, for films of numbered images.
        join: makes the film from its segments, if that is more than to copy packets: (segments, out, progress).
    """

    name: str
    title: str
    help: str
    media_type: str
    suffixes: tuple[str, ...]
    carries: Carries = Carries()
    folder_suffix: str = ""
    has_quality: bool = True
    lossy: bool = False
    shown_as: str = "video"
    low_bytes_per_pixel: float = 0.005
    bytes_per_pixel: float = 0.05
    container: str = ""
    segment_container: str = ""
    codec: str = ""
    codec_options: Callable[[int], dict[str, str]] = lambda quality: {}
    pixel_format: str = "yuv420p"
    mux_options: Mapping[str, str] | None = None
    even: bool = False
    max_side_px: int = 0
    encode: Callable[[Frame], bytes] | None = None
    join: Callable[[Segments, Path, Progress], None] | None = None

    def coded_size(self, size: tuple[int, int]) -> tuple[int, int]:
        """(width, height) of the encoded film, px, for frames of this size."""
        width, height = size
        if self.max_side_px:
            scale = min(1.0, self.max_side_px / max(size))
            width, height = max(1, round(scale * width)), max(1, round(scale * height))
        return (width + width % 2, height + height % 2) if self.even else (width, height)
