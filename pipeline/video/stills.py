"""Encoding of still images to PNG and JPEG, and compositing over white."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.frames import Frame
from pipeline.video.depth import as_uint8, white_of


def over_white(rgba: AnyArray) -> AnyArray:
    """Composite RGBA with straight alpha, uint8, uint16 or float32 (h, w, 4), over white; rounds to nearest."""
    if rgba.dtype != np.uint8:
        return _deep_over_white(rgba)
    alpha = rgba[..., 3:].astype(np.uint16)
    if alpha.min(initial=255) == 255:
        return np.ascontiguousarray(rgba[..., :3])
    mixed = rgba[..., :3].astype(np.uint16) * alpha + 255 * (255 - alpha) + 127
    return np.asarray(mixed // 255, np.uint8)


def _deep_over_white(rgba: AnyArray) -> AnyArray:
    white = np.float32(white_of(rgba))
    mixed = white + rgba[..., 3:].astype(np.float32) / white * (rgba[..., :3].astype(np.float32) - white)
    return mixed if rgba.dtype == np.float32 else np.asarray(np.rint(mixed), rgba.dtype)


def as_shown(picture: AnyArray) -> Frame:
    """A picture of any type, (h, w, 3) or (h, w, 4) with straight opacity, as a frame: 8 bit, over white."""
    eight = as_uint8(picture)
    return over_white(eight) if eight.shape[2] == 4 else eight


def encode_png(frame: NDArray[np.uint8] | NDArray[np.uint16], level: int = 1) -> bytes:
    """Encode a picture, uint8 or uint16 (h, w, 3) or (h, w, 4) with straight opacity, as PNG. `level`: zlib level 0..9;
    1 is fast, and its files are only a few percent larger."""
    code = cv2.COLOR_RGBA2BGRA if frame.shape[2] == 4 else cv2.COLOR_RGB2BGR
    return cv2.imencode(".png", cv2.cvtColor(frame, code), [cv2.IMWRITE_PNG_COMPRESSION, level])[1].tobytes()


def encode_gray_png(plane: NDArray[np.uint8], level: int = 1) -> bytes:
    """Encode one channel, uint8 (h, w), as a gray PNG."""
    return cv2.imencode(".png", plane, [cv2.IMWRITE_PNG_COMPRESSION, level])[1].tobytes()


def encode_jpeg(frame: Frame, quality: int = 85) -> bytes:
    """Encode a frame as JPEG; `quality` 1..100."""
    return cv2.imencode(".jpg", cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality])[
        1
    ].tobytes()
