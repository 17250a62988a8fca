"""Images read by Pillow: header, orientation, colour profile, palette, transparency, depth, and animations.

Pictures are as displayed: turned by their EXIF orientation, converted to sRGB by their ICC profile, palettes expanded.
Pillow refuses images that are cut off; it runs within the guarded decoder process.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms, ImageOps

from pipeline.arrays import AnyArray
from pipeline.errors import ImpastoError, UnreadableMedia
from pipeline.formats.base import AnimatedFrames, Choice, ImageFormat, ImageHeader, aspect_notes, square_pixels
from pipeline.video.depth import as_uint8
from pipeline.video.media import Limits, check_size, unreadable

Image.MAX_IMAGE_PIXELS = None  # `check_size` refuses by the header, with the limits of the caller
_UNSET_MS, _SHORTEST_MS = 100, 20
"""Browsers show a picture with a duration under 20 ms for 100 ms."""
_SAME_LEVELS = 1
"""A profile that changes no colour by more than this many levels is sRGB: then the stored values are kept."""
_ORIENTATION = 0x0112
_BLACK = ImageCms.Flags.BLACKPOINTCOMPENSATION
"""The darkest colour of a profile becomes black, as in browsers."""


@contextmanager
def faults(message: str, name: str) -> Iterator[None]:
    """Refuse the file for any error of a decoder, since plugins raise errors of many classes for damaged files."""
    try:
        yield
    except (ImpastoError, MemoryError):
        raise
    except Exception as error:
        unreadable(
            f"{message}: it is cut off or damaged.",
            f"{name}: {error}"[:200],
            "Export the image again; the file is incomplete.",
        )


class PillowFormat(ImageFormat):
    """
    Attributes:
        plugin: Pillow's name of the format.
        magic: first bytes of the file.
    """

    plugin: str
    magic: tuple[bytes, ...] = ()

    def sniff(self, head: bytes) -> bool:
        return head.startswith(self.magic)

    def header(self, stream: BinaryIO) -> ImageHeader:
        with self._open(stream, "image") as image, faults("The image's header cannot be read", "image"):
            animated = self.carries.animation and bool(getattr(image, "is_animated", False))
            return ImageHeader(self.media_type, *image.size, animated)

    def notes(self, data: bytes, choice: Choice = Choice()) -> tuple[str, ...]:
        with self._open(io.BytesIO(data), "image") as image, faults("The image cannot be read", "image"):
            return tuple(self._notes(image, len(data) - self.end_of(data)))

    def _notes(self, image: Image.Image, extra: int) -> Iterator[str]:
        pages = 1 if self.carries.animation else getattr(image, "n_frames", 1)
        if pages > 1:
            yield f"The file contains {pages} pictures: the first is read."
        if extra > 0:
            yield f"{extra} bytes follow the picture in the file, as in a motion photo: only the picture is read."
        yield from aspect_notes(_aspect(image))
        profile = image.info.get("icc_profile")
        if profile:
            yield from _profile_notes(profile, image.mode)

    def end_of(self, data: bytes) -> int:
        """Length of the picture's data in the file."""
        return len(data)

    def read(self, data: bytes, limits: Limits, name: str, choice: Choice = Choice()) -> AnyArray:
        with self._open(io.BytesIO(data), name) as image:
            check_size(*image.size, limits, f"The image {name}" if name != "image" else "The image")
            with faults("The image cannot be decoded", name):
                image.load()
                return square_pixels(as_displayed(image), _aspect(image))

    def animation(self, path: Path, limits: Limits) -> AnimatedFrames:
        return PillowFrames(self, path, limits)

    def _open(self, stream: BinaryIO | Path, name: str) -> Image.Image:
        with faults("The image's header cannot be read", name):
            return Image.open(stream, formats=[self.plugin])


class PillowFrames(AnimatedFrames):
    """An animated image file. Times come from a first pass over all pictures."""

    def __init__(self, form: PillowFormat, path: Path, limits: Limits) -> None:
        self._form, self._path, self._limits = form, path, limits
        self._image = form._open(path, path.name)
        check_size(*self._image.size, limits)
        with faults("The pictures of the image cannot be counted", path.name):
            count = getattr(self._image, "n_frames", 1)
        self._first = int(bool(self._image.info.get("default_image")))  # an APNG's picture for other programs
        starts, at = list[int](), 0
        for number in range(min(count - self._first, limits.frames + 1)):
            starts.append(at)
            if not self._shows(number):
                self.incomplete = frozenset({number})
            at += _duration_ms(self._image)
            if self.incomplete:
                break
        self.starts, self.end = starts, at

    def _shows(self, number: int) -> bool:
        """Whether the picture can be decoded; it is then the current one. Raises UnreadableMedia for the first one."""
        try:
            with faults("The image cannot be decoded", "image"):
                self._image.seek(number + self._first)
                self._image.load()
        except UnreadableMedia:
            if number == 0:
                raise
            return False
        return True

    def frames(self, start: int) -> Iterator[AnyArray]:
        self.close()
        self._image = self._form._open(self._path, self._path.name)  # Pillow loses a palette when it goes back
        shown: AnyArray | None = None
        for number in range(len(self.starts)):
            if (
                number not in self.incomplete
                and self._shows(number)
                and (number >= start or number + 1 in self.incomplete)
            ):
                with faults("The image cannot be decoded", "image"):
                    shown = eight_bit(as_displayed(self._image))
            if number >= start and shown is not None:
                yield shown

    def close(self) -> None:
        self._image.close()


def _duration_ms(image: Image.Image) -> int:
    found = round(float(image.info.get("duration") or 0))
    return found if found >= _SHORTEST_MS else _UNSET_MS


def as_displayed(image: Image.Image) -> AnyArray:
    """The loaded picture, turned and in sRGB: uint8 (h, w), (h, w, 3) or (h, w, 4) with straight alpha; uint16 (h, w)
    or float32 (h, w) for gray pictures of more than 8 bits."""
    profile = image.info.get("icc_profile")
    if image.getexif().get(_ORIENTATION, 1) != 1:
        image = ImageOps.exif_transpose(image)
    if image.mode == "F":
        return np.asarray(image, np.float32)
    if image.mode.startswith("I"):
        return np.asarray(np.clip(np.asarray(image), 0, 65535), np.uint16)
    transparent = image.has_transparency_data
    if image.mode == "1" and not transparent:
        return np.asarray(image.convert("L"))
    if transparent or image.mode not in ("L", "RGB"):
        image = _in_colour(image, profile, transparent)
    elif profile and image.mode == "RGB":
        image = _to_srgb(image, profile)
    return np.array(image)


def _in_colour(image: Image.Image, profile: bytes | None, transparent: bool) -> Image.Image:
    if not transparent:
        return _to_srgb(image, profile).convert("RGB") if profile else image.convert("RGB")
    straight = image.convert("RGBA")
    if not profile:
        return straight
    colours = _to_srgb(straight.convert("RGB"), profile)
    colours.putalpha(straight.getchannel("A"))
    return colours


def _to_srgb(image: Image.Image, profile: bytes) -> Image.Image:
    """The picture converted from its profile, if that fits its mode and is not sRGB."""
    if image.mode == "P":
        image = image.convert("RGB")
    transform = None if _is_srgb(profile, image.mode) else _transform(profile, image.mode)
    if transform is None:
        return image
    converted = ImageCms.applyTransform(image, transform)
    assert converted is not None
    return converted


def _profile_notes(data: bytes, mode: str) -> Iterator[str]:
    profile = _profile(data)
    if profile is None:
        yield "The colour profile cannot be read and is ignored."
    elif not _is_srgb(data, mode):
        yield f"Colours are converted from {ImageCms.getProfileDescription(profile).strip()!r} to sRGB."


def _aspect(image: Image.Image) -> float:
    """Width : height of a pixel, for files that give it (PNG)."""
    across, down = image.info.get("aspect", (1, 1))
    return float(down / across) if across and down else 1.0


def eight_bit(image: AnyArray) -> NDArray[np.uint8]:
    """Convert uint16, and floating point of 0..1, to uint8, rounded to nearest."""
    return as_uint8(image if image.dtype in (np.uint8, np.uint16) else image.astype(np.float32))


def _profile(data: bytes) -> ImageCms.ImageCmsProfile | None:
    try:
        return ImageCms.ImageCmsProfile(io.BytesIO(data))
    except (ImageCms.PyCMSError, OSError, ValueError):
        return None


@lru_cache(1)
def _srgb() -> Any:
    return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB"))


@lru_cache(8)
def _transform(profile: bytes, mode: str) -> ImageCms.ImageCmsTransform | None:
    found = _profile(profile)
    if found is None:
        return None
    try:
        return ImageCms.buildTransform(found, _srgb(), mode, "RGB", ImageCms.Intent.RELATIVE_COLORIMETRIC, _BLACK)
    except (ImageCms.PyCMSError, ValueError):  # a profile of another colour space than the picture
        return None


@lru_cache(8)
def _is_srgb(profile: bytes, mode: str) -> bool:
    """Whether a profile leaves a lattice of colours as they are."""
    if mode not in ("RGB", "RGBA", "P"):
        return False
    transform = _transform(profile, "RGB")
    if transform is None:
        return False
    steps = np.arange(0, 256, 17, dtype=np.uint8)
    lattice = np.stack(np.meshgrid(steps, steps, steps), -1).reshape(64, 64, 3)
    shown = ImageCms.applyTransform(Image.fromarray(lattice), transform)
    return bool(np.abs(np.asarray(shown, np.int16) - lattice).max() <= _SAME_LEVELS)
