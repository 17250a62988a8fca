"""Conversion of frames to the pixel formats of encoders."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import av
import cv2
import numpy as np
from av.video.format import VideoFormat
from av.video.reformatter import ColorRange, Colorspace, Interpolation
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.video.depth import as_uint8, as_uint16, with_opacity
from pipeline.video.geometry import EXACT

_LAYOUTS = {(1, 3): "rgb24", (1, 4): "rgba", (2, 3): "rgb48le", (2, 4): "rgba64le"}
"""(bytes of a channel, channels) -> FFmpeg's pixel format."""


def converter_of(pixel_format: str, matrix: Colorspace) -> Callable[[AnyArray], av.VideoFrame]:
    """The conversion of frames, (h, w, 3 or 4), to pictures of this pixel format and colour matrix."""
    return YuvConverter(matrix) if pixel_format == "yuv420p" else PictureConverter(matrix, pixel_format)


class PictureConverter:
    """Converts frames, uint8, uint16 or float32 (h, w, 3 or 4), to any pixel format, without truncation.

    YUV has limited range, RGB and opacity have full range. A picture without opacity becomes opaque.
    """

    def __init__(self, matrix: Colorspace, pixel_format: str) -> None:
        layout = VideoFormat(pixel_format)
        self._matrix, self._pixel_format = matrix, pixel_format
        self._deep = layout.components[0].bits > 8
        self._has_alpha = any(component.is_alpha for component in layout.components)
        self._range = ColorRange.JPEG if layout.is_rgb else ColorRange.MPEG

    def __call__(self, frame: AnyArray) -> av.VideoFrame:
        pixels: NDArray[Any] = as_uint16(frame) if self._deep else as_uint8(frame)
        if self._deep and self._range == ColorRange.MPEG:  # swscale takes 255 / 256 of 16 bits for white
            pixels = np.dstack([pixels[..., :3] - (pixels[..., :3] >> 8), pixels[..., 3:]])
        if self._has_alpha and pixels.shape[2] == 3:
            pixels = with_opacity(pixels, np.full(pixels.shape[:2], 255, np.uint8))
        layout = _LAYOUTS[pixels.itemsize, pixels.shape[2]]
        picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format=layout)
        if layout == self._pixel_format:
            return picture
        return picture.reformat(
            format=self._pixel_format, dst_colorspace=self._matrix, src_color_range=ColorRange.JPEG,
            dst_color_range=self._range, interpolation=Interpolation.BILINEAR | EXACT, threads=1,
        )  # fmt: skip


class YuvConverter:
    """Converts frames, uint8 (h, w, 3), to YUV of limited range, as encoders take it. Not thread-safe.

    FFmpeg converts RGB with an alpha channel in two thirds of the time that it takes without one, to the same bytes.
    The picture with the alpha channel is kept from frame to frame, and FFmpeg's tables with it.
    """

    def __init__(self, matrix: Colorspace, pixel_format: str = "yuv420p") -> None:
        self._matrix, self._pixel_format = matrix, pixel_format
        self._opaque = av.VideoFrame(2, 2, "rgba")

    def __call__(self, frame: AnyArray) -> av.VideoFrame:
        height, width = frame.shape[:2]
        if (self._opaque.width, self._opaque.height) != (width, height):
            self._opaque = av.VideoFrame(width, height, "rgba")
        rows = np.frombuffer(memoryview(self._opaque.planes[0]), np.uint8).reshape(height, -1)
        cv2.cvtColor(as_uint8(frame), cv2.COLOR_RGB2RGBA, dst=rows[:, : 4 * width].reshape(height, width, 4))
        return self._opaque.reformat(
            format=self._pixel_format,
            dst_colorspace=self._matrix,
            src_color_range=ColorRange.JPEG,
            dst_color_range=ColorRange.MPEG,
            interpolation=Interpolation.BILINEAR,
            threads=1,
        )
