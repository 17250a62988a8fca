"""The formats of images and films: one module a format, one row here.

`IMAGES` are read; `OUTPUTS` are written, the first one by default. See `pipeline.formats.base` for what a format is.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, BinaryIO

from pydantic import AfterValidator, WithJsonSchema

from pipeline.errors import BadParameter
from pipeline.formats.base import ImageFormat, OutputFormat
from pipeline.formats.bmp import BMP
from pipeline.formats.dpx import DPX
from pipeline.formats.exr import EXR, EXR_FRAMES
from pipeline.formats.gif import GIF, GIF_FILM
from pipeline.formats.iso_images import AVIF, AVIF_FILM, HEIF
from pipeline.formats.jpeg import JPEG
from pipeline.formats.mkv import MKV
from pipeline.formats.mov import MOV
from pipeline.formats.mp4 import MP4
from pipeline.formats.mxf import MXF
from pipeline.formats.png import PNG, PNG_FRAMES
from pipeline.formats.rare import RARE
from pipeline.formats.tiff import TIFF, TIFF_FRAMES
from pipeline.formats.webm import WEBM
from pipeline.formats.webp import WEBP, WEBP_FILM

IMAGES: tuple[ImageFormat, ...] = (PNG, JPEG, WEBP, AVIF, HEIF, GIF, BMP, TIFF, EXR, DPX, *RARE)
OUTPUTS: Mapping[str, OutputFormat] = {
    form.name: form
    for form in (MP4, WEBM, MOV, MKV, MXF, PNG_FRAMES, TIFF_FRAMES, EXR_FRAMES, GIF_FILM, WEBP_FILM, AVIF_FILM)
}
IMAGE_SUFFIXES = frozenset(suffix for form in IMAGES for suffix in form.suffixes)
IMAGE_NAMES = ", ".join(form.title for form in IMAGES if form not in RARE)
"""For messages."""


def image_format(head: bytes) -> ImageFormat | None:
    """The image format of a file with these first bytes; None: it is no image."""
    return next((form for form in IMAGES if form.sniff(head)), None)


def image_format_of(stream: BinaryIO) -> ImageFormat | None:
    """The image format of a file, which is then at its start."""
    head = stream.read(4096)
    stream.seek(0)
    return image_format(head)


def output_format(name: str) -> OutputFormat:
    """The output format of this name. Raises BadParameter."""
    if name not in OUTPUTS:
        raise BadParameter("The output format is unknown.", field="output.format", value=name,
                           remedy=f"Use one of: {', '.join(OUTPUTS)}.")  # fmt: skip
    return OUTPUTS[name]


def planes_format() -> ImageFormat:
    """The format in which images with planes are written."""
    return next(form for form in IMAGES if form.carries.planes)


IN_FILM = "film"
PASS_FORMATS = (planes_format().name, PNG.name, IN_FILM)
"""Formats of the passes that methods make (`pipeline.passes.made`), the usual one first; `IN_FILM`: planes of
the film's own images."""


def has_planes(name: str) -> bool:
    """Whether a file of this name holds named planes besides a picture, by its extension."""
    return name.lower().endswith(tuple(suffix for form in IMAGES if form.carries.planes for suffix in form.suffixes))


def _checked(name: str) -> str:
    if name not in OUTPUTS:
        raise ValueError(f"use one of: {', '.join(OUTPUTS)}")
    return name


OutputName = Annotated[str, AfterValidator(_checked), WithJsonSchema({"type": "string", "enum": list(OUTPUTS)})]
"""Name of an output format, as a field of a pydantic model."""


def output_of_suffix(suffix: str) -> tuple[OutputFormat, bool] | None:
    """The output format of a file name extension (lower case, with the dot), and whether the file is one of its frames;
    None: there is none."""
    for form in OUTPUTS.values():
        if suffix in form.suffixes:
            return form, False
        if suffix in form.frame_suffixes:
            return form, True
    return None
