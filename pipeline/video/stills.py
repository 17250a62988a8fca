"""Decoding of still images to RGB, after a check of their headers, and encoding to PNG and JPEG.

Applies EXIF orientation, composites alpha over white, and converts 16 bits to 8; ignores ICC profiles. An EXR image
yields its beauty pass, converted from linear light to sRGB.
"""

from __future__ import annotations

import io

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.frames import Frame
from pipeline.video.exr import EXR_MAGIC, pixels, read_exr
from pipeline.video.headers import IMAGE_TYPES, ImageHeader, image_header, sniff
from pipeline.video.media import Limits, check_size, unreadable


def check_image(data: bytes, limits: Limits, name: str = "image") -> ImageHeader:
    """Check that an encoded image is complete and within the limits; returns its header.

    Raises: UnreadableMedia, MediaTooLarge.
    """
    media_type = sniff(io.BytesIO(data))
    if media_type not in IMAGE_TYPES:
        unreadable("This is not an image.", name)
    header = image_header(io.BytesIO(data), media_type)
    check_size(header.width, header.height, limits, f"The image {name}" if name != "image" else "The image")
    _check_end(data, media_type, name)
    return header


def _check_end(data: bytes, media_type: str, name: str) -> None:
    """Reject a truncated image by its missing end marker: libjpeg and libpng fill missing parts with gray silently."""
    ends = {"image/jpeg": b"\xff\xd9", "image/png": b"IEND"}
    end = ends.get(media_type)
    if end and data.rfind(end, max(0, len(data) - (1 << 16))) < 0:
        unreadable("The image is cut off.", name, "Upload it again, whole.")


def decode_rgb(data: bytes, limits: Limits, name: str = "image") -> Frame:
    """Decode an image to a frame. Raises UnreadableMedia, MediaTooLarge."""
    check_image(data, limits, name)
    if data.startswith(EXR_MAGIC):
        straight = _exr(data, limits, name)
        return over_white(straight) if straight.shape[2] == 4 else straight
    stored = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if stored is not None and stored.ndim == 3 and stored.shape[2] == 4:
        return over_white(_to_8_bit(cv2.cvtColor(stored, cv2.COLOR_BGRA2RGBA)))
    as_stored = stored is not None and stored.ndim == 3 and stored.dtype == np.uint8 and not _may_be_rotated(data)
    image = stored if as_stored else cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        unreadable("The image cannot be decoded.", name, "Export it again as PNG or JPEG.")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def _may_be_rotated(data: bytes) -> bool:
    """Whether an image may have an EXIF orientation, which OpenCV applies to all but unchanged images."""
    return sniff(io.BytesIO(data)) != "image/png" or b"eXIf" in data


def decode_raw(data: bytes, limits: Limits, name: str = "image") -> AnyArray:
    """Decode an image as stored, without EXIF rotation: (h, w), (h, w, 3) RGB or (h, w, 4) RGBA; uint8 or uint16."""
    check_image(data, limits, name)
    if data.startswith(EXR_MAGIC):
        return _exr(data, limits, name)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        unreadable("The image cannot be decoded.", name, "Export it again as PNG or JPEG.")
    if image.ndim == 2:
        return image
    code = cv2.COLOR_BGRA2RGBA if image.shape[2] == 4 else cv2.COLOR_BGR2RGB
    return np.asarray(cv2.cvtColor(image, code))


def _exr(data: bytes, limits: Limits, name: str) -> NDArray[np.uint8]:
    found = pixels(read_exr(data, limits, name))
    if found is None:
        unreadable("The EXR holds no picture.", name, "Render the Combined pass, or channels R, G and B, into it.")
    return found


def _to_8_bit(image: AnyArray) -> NDArray[np.uint8]:
    if image.dtype == np.uint8:
        return np.asarray(image, np.uint8)
    if image.dtype == np.uint16:
        return np.asarray(image >> 8, np.uint8)
    return np.asarray(np.clip(image, 0, 1) * 255 + 0.5, np.uint8)


def over_white(rgba: NDArray[np.uint8]) -> Frame:
    """Composite RGBA with straight alpha, uint8 (h, w, 4), over white; rounds to nearest."""
    alpha = rgba[..., 3:].astype(np.uint16)
    if alpha.min(initial=255) == 255:
        return np.ascontiguousarray(rgba[..., :3])
    mixed = rgba[..., :3].astype(np.uint16) * alpha + 255 * (255 - alpha) + 127
    return np.asarray(mixed // 255, np.uint8)


def encode_png(frame: Frame, level: int = 1) -> bytes:
    """Encode a frame as PNG. `level`: zlib level 0..9; 1 is fast, and its files are only a few percent larger."""
    return cv2.imencode(".png", cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_PNG_COMPRESSION, level])[
        1
    ].tobytes()


def encode_gray_png(plane: NDArray[np.uint8], level: int = 1) -> bytes:
    """Encode one channel, uint8 (h, w), as a gray PNG."""
    return cv2.imencode(".png", plane, [cv2.IMWRITE_PNG_COMPRESSION, level])[1].tobytes()


def encode_jpeg(frame: Frame, quality: int = 85) -> bytes:
    """Encode a frame as JPEG; `quality` 1..100."""
    return cv2.imencode(".jpg", cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality])[
        1
    ].tobytes()
