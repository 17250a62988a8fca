"""Decoding of still images of all formats, after a check of their headers."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter
from pipeline.formats import IMAGE_NAMES, IMAGES, image_format
from pipeline.formats.base import Choice, ImageFormat, PlaneImage
from pipeline.formats.pillow import eight_bit
from pipeline.frames import Frame
from pipeline.video.media import Limits, SourceOptions, check_size, unreadable
from pipeline.video.opacity import as_frame
from pipeline.video.wide_colour import shown


def decode_rgb(data: bytes, limits: Limits, name: str = "image", choice: Choice = Choice()) -> Frame:
    """Decode an image to a frame, alpha over white. Raises UnreadableMedia, MediaTooLarge, BadParameter."""
    return as_frame(eight_bit(decode_raw(data, limits, name, choice)), SourceOptions())


def decode_shown(
    data: bytes, limits: Limits, name: str, choice: Choice, options: SourceOptions
) -> tuple[AnyArray, bool]:
    """Decode an image to a frame as `options` say, and whether it has opacity: uint8; with `options.deep`, also uint16
    or float32. Raises as `decode_rgb`."""
    form = format_of(data, name)
    if options.premultiplied and form.premultiplied:
        options = replace(options, premultiplied=False)  # the reader has divided
    choice = replace(choice, deep=options.deep, colour=options.colour, colour_view=options.colour_view)
    picture = decode_raw(data, limits, name, choice)
    if options.colour and not form.carries.planes:
        picture = shown(np.dstack([picture] * 3) if picture.ndim == 2 else picture, None, options)
    picture = picture if options.deep else eight_bit(picture)
    return as_frame(picture, options), picture.ndim == 3 and picture.shape[2] == 4


def decode_raw(data: bytes, limits: Limits, name: str = "image", choice: Choice = Choice()) -> AnyArray:
    """Decode an image as displayed: (h, w), (h, w, 3) RGB or (h, w, 4) RGBA; uint8 or uint16; of formats that hold more
    bits, also float32 0..1. Raises UnreadableMedia, MediaTooLarge, BadParameter."""
    form = format_of(data, name)
    if (choice.layer or choice.view) and not form.carries.planes:
        raise BadParameter(f"A {form.title} image has one picture.", field="layer, view", value=name,
                           remedy="Leave the choice of a layer and a view out.")  # fmt: skip
    header = form.header(io.BytesIO(data))
    check_size(header.width, header.height, limits, f"The image {name}" if name != "image" else "The image")
    return form.read(data, limits, name, choice)


def format_of(data: bytes, name: str = "image") -> ImageFormat:
    """The format of an encoded image. Raises UnreadableMedia."""
    form = image_format(data[:4096])
    if form is None:
        unreadable("This is not an image.", name, f"Save it as one of: {IMAGE_NAMES}.")
    return form


def decode_planes(data: bytes, limits: Limits, name: str = "image") -> PlaneImage:
    """All named planes of an image. Raises UnreadableMedia, also for formats without such planes; MediaTooLarge."""
    form = format_of(data, name)
    if not form.carries.planes:
        with_planes = " or ".join(other.title for other in IMAGES if other.carries.planes)
        unreadable(f"A {form.title} image has no render passes.", name, f"Save it as {with_planes}.")
    return form.planes(data, limits, name)
