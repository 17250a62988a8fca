"""Conversion of decoded pictures to frames as displayed: colour matrix, range, alpha, square pixels, rotation.

Colour: the stream's own matrix and range. Untagged streams are treated as players treat them: limited range, BT.709
from 720 lines up and BT.601 below. HDR and wide gamuts are converted to sRGB (`wide_colour`).
Pictures of 8 bits are converted by swscale's fast path, which truncates: values are at most 3 of 255 levels below the
exact result. Deeper ones are converted exactly.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from fractions import Fraction
from typing import cast

import av
import cv2
import numpy as np
from av.sidedata.sidedata import SideData
from av.video.reformatter import ColorRange, Colorspace, Interpolation
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.formats.base import square_size
from pipeline.video.aperture import Crop
from pipeline.video.depth import as_uint8
from pipeline.video.media import SourceOptions
from pipeline.video.opacity import as_frame
from pipeline.video.wide_colour import shown, wide_signal

USUAL = SourceOptions()
_LAYOUTS = {
    (False, False): "rgb24", (True, False): "rgba", (False, True): "rgb48le", (True, True): "rgba64le"
}  # fmt: skip
"""(Has opacity, has 16 bits) -> FFmpeg's pixel format."""
_HD_LINES = 720
_LIMITED_WHITE = 65283
"""What swscale makes of white of limited range, for R'G'B' of 16 bits."""
EXACT = 0x40000 | 0x2000
"""SWS_ACCURATE_RND and SWS_FULL_CHR_H_INT of libswscale/swscale.h, which PyAV does not export."""
_MATRICES = {
    1: Colorspace.ITU709,
    4: Colorspace.FCC,
    5: Colorspace.ITU601,
    6: Colorspace.ITU601,
    7: Colorspace.SMPTE240M,
    9: Colorspace.BT2020,
    10: Colorspace.BT2020,
}
"""Matrix coefficients of decoded frames (ISO/IEC 23091-2 code) -> swscale's constant."""


def customary_matrix(height: int) -> Colorspace:
    """The matrix that players assume for untagged video of `height` lines."""
    return Colorspace.ITU709 if height >= _HD_LINES else Colorspace.ITU601


@dataclass(frozen=True)
class Geometry:
    """Transform from stored pictures to frames: crop, scale to `scaled` (width, height) px, transpose, then flip."""

    scaled: tuple[int, int]
    transpose: bool = False
    flip_x: bool = False
    flip_y: bool = False
    crop: Crop | None = None
    """Pixels that are not shown; None: all are."""

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of frames, px."""
        return self.scaled[::-1] if self.transpose else self.scaled

    def shown_of(self, stored: tuple[int, int]) -> tuple[int, int]:
        """The part of a stored picture of this size that is shown, (width, height) px."""
        left, top, right, bottom = self.crop or (0, 0, 0, 0)
        return stored[0] - left - right, stored[1] - top - bottom

    @property
    def rotation_deg(self) -> int:
        """Clockwise rotation for display; for mirrored pictures, the rotation before mirroring left to right."""
        if self.transpose:
            return 270 if self.flip_y and not self.flip_x else 90
        return 180 if self.flip_y else 0


def geometry_of(picture: av.VideoFrame, aspect: Fraction | None, crop: Crop | None = None) -> Geometry:
    """The geometry of a stream, from its first picture and its sample aspect ratio (None or 0 = square pixels)."""
    a, b, c, d = _display_matrix(picture)
    left, top, right, bottom = crop or (0, 0, 0, 0)
    scaled = square_size(picture.width - left - right, picture.height - top - bottom, float(aspect or 1))
    if abs(a) + abs(d) >= abs(b) + abs(c):
        return Geometry(scaled, False, a < 0, d < 0, crop)
    return Geometry(scaled, True, c < 0, b < 0, crop)


def _display_matrix(picture: av.VideoFrame) -> tuple[int, int, int, int]:
    """Display matrix (a, b, c, d): x' = a x + c y, y' = b x + d y, 16.16 fixed point; identity if the file has none."""
    try:
        data = picture.side_data.get("DISPLAYMATRIX")
    except ValueError:  # side data of a kind that PyAV does not know, for example the view of MV-HEVC
        data = None
    if data is None:
        return 1, 0, 0, 1
    a, b, _u, c, d = struct.unpack_from("=5i", bytes(cast(SideData, data)))
    return a, b, c, d


def to_frame(picture: av.VideoFrame, geometry: Geometry, options: SourceOptions = USUAL) -> AnyArray:
    """Convert a decoded picture to a frame of `geometry.size`; pictures of other sizes are scaled to it. The frame is
    uint8; with `options.deep`, also uint16, or float32 if its colours are converted."""
    whole = (picture.width, picture.height)
    width, height = whole if geometry.crop else geometry.scaled
    same = whole == (width, height)
    wide = wide_signal(picture)
    managed = wide is not None or bool(options.colour)
    more = picture.format.components[0].bits > 8  # the fast path truncates deeper pictures
    sixteen = managed or (more and options.deep)
    made = picture.reformat(
        width=width,
        height=height,
        format=_LAYOUTS[has_alpha(picture), sixteen],
        src_colorspace=_MATRICES.get(int(picture.colorspace), customary_matrix(picture.height)),
        src_color_range=_range_of(picture),
        dst_color_range=ColorRange.JPEG,
        # Not bilinear to 16 bits: swscale then takes twice the colour differences of 4:2:0 (FFmpeg 8.1).
        interpolation=(Interpolation.BILINEAR if same and not sixteen else Interpolation.BICUBIC)
        | (EXACT if managed or more else 0),
        threads=1,
    )
    pixels = np.asarray(made.to_ndarray()) if made is picture or sixteen else _pixels(made)
    if sixteen and not picture.format.is_rgb:
        pixels = _to_full_scale(pixels, picture)
    if managed:
        pixels = shown(pixels, wide, options)
    pixels = pixels if options.deep else as_uint8(pixels)
    frame = pixels if pixels.shape[2] == 3 and options.opacity != "matte" else as_frame(pixels, options)
    return _oriented(_cropped(frame, geometry) if geometry.crop else frame, geometry)


def _to_full_scale(pixels: AnyArray, picture: av.VideoFrame) -> AnyArray:
    """R'G'B' of 16 bits from YUV with white at 65535. swscale shifts values of n bits to 16, so that white is 255 / 256
    of it (limited range), or the largest value of n bits, shifted (full range, and opacity)."""
    bits = picture.format.components[0].bits
    shifted = ((1 << bits) - 1) << (16 - bits)
    white = shifted if _range_of(picture) == ColorRange.JPEG else _LIMITED_WHITE
    scale = np.array([65535 / white] * 3 + [65535 / shifted] * (pixels.shape[2] - 3), np.float32)
    return np.asarray(np.minimum(pixels * scale + np.float32(0.5), 65535), np.uint16)


def _cropped(pixels: AnyArray, geometry: Geometry) -> AnyArray:
    """The shown part of a picture, scaled to square pixels."""
    left, top, right, bottom = geometry.crop or (0, 0, 0, 0)
    inside = pixels[top : pixels.shape[0] - bottom, left : pixels.shape[1] - right]
    if (inside.shape[1], inside.shape[0]) == geometry.scaled:
        return inside
    return np.asarray(cv2.resize(inside, geometry.scaled, interpolation=cv2.INTER_CUBIC))


def _pixels(picture: av.VideoFrame) -> NDArray[np.uint8]:
    """The pixels of an RGB or RGBA picture that no decoder refers to, uint8 (h, w, 3 or 4); without a copy, if its rows
    follow one another in memory."""
    plane, channels = picture.planes[0], 4 if has_alpha(picture) else 3
    if plane.line_size != channels * picture.width:
        return np.asarray(picture.to_ndarray(), np.uint8)
    return np.frombuffer(memoryview(plane), np.uint8).reshape(picture.height, picture.width, channels)


def has_alpha(picture: av.VideoFrame) -> bool:
    layout = picture.format
    return layout.name == "pal8" or any(component.is_alpha for component in layout.components)


def _range_of(picture: av.VideoFrame) -> ColorRange:
    full = picture.color_range == ColorRange.JPEG or picture.format.name.startswith("yuvj") or picture.format.is_rgb
    return ColorRange.JPEG if full else ColorRange.MPEG


def _oriented(pixels: AnyArray, geometry: Geometry) -> AnyArray:
    if geometry.transpose:
        pixels = np.asarray(cv2.transpose(pixels))
    if geometry.flip_x:
        pixels = pixels[:, ::-1]
    if geometry.flip_y:
        pixels = pixels[::-1]
    return np.ascontiguousarray(pixels)
