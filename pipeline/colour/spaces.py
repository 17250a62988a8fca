"""Exact conversions between sRGB, HSV and CIELAB for a few colours, such as one per region.

Colours are rows of an array (..., 3). sRGB and HSV's S and V are in 0..1, H is in degrees 0..360; CIELAB has L* in
0..100 and a*, b* in about -128..127, for the white D65 and the 2 degree observer (IEC 61966-2-1, CIE 15).
OpenCV's 8 bit Lab scales L* by 255/100 and adds 128 to a* and b*; its 8 bit H is halved.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.arrays import AnyArray
from pipeline.kernels.jit import kernel

Colours = NDArray[np.float64]

_RGB_TO_XYZ = np.array([[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]])
_WHITE = _RGB_TO_XYZ.sum(axis=1)
RGB_TO_RELATIVE = _RGB_TO_XYZ / _WHITE[:, None]
_RELATIVE_TO_RGB = np.linalg.inv(RGB_TO_RELATIVE)
DELTA = 6 / 29


def srgb_to_linear(rgb: ArrayLike) -> Colours:
    """Linear light of encoded sRGB values, both 0..1."""
    encoded = np.asarray(rgb, np.float64)
    return np.asarray(np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4))


def srgb_to_lab(rgb: ArrayLike) -> Colours:
    """Convert sRGB colours in 0..1, shape (..., 3), to CIELAB.

    Products are added up in a fixed order: a matrix product depends on the processor in its last bit.
    """
    red, green, blue = (srgb_to_linear(rgb)[..., channel, None] * RGB_TO_RELATIVE[:, channel] for channel in range(3))
    relative = red + green + blue
    f = np.where(relative > DELTA**3, np.cbrt(relative), relative / (3 * DELTA**2) + 4 / 29)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def lab_to_srgb(lab: ArrayLike) -> Colours:
    """Convert CIELAB colours, shape (..., 3), to sRGB in 0..1; colours outside the sRGB gamut are clipped."""
    values = np.asarray(lab, np.float64)
    out = np.empty(values.shape)
    _lab_to_srgb(np.ascontiguousarray(values).reshape(-1, 3), _RELATIVE_TO_RGB, out.reshape(-1, 3))
    return out


@kernel
def _lab_to_srgb(lab: Colours, relative_to_rgb: Colours, out: Colours) -> None:
    relative = np.empty(3)
    for k in range(lab.shape[0]):
        f_y = (lab[k, 0] + 16) / 116
        for c, f in enumerate((f_y + lab[k, 1] / 500, f_y, f_y - lab[k, 2] / 200)):
            relative[c] = f * f * f if f > DELTA else 3 * DELTA * DELTA * (f - 4 / 29)
        for c in range(3):
            linear = 0.0
            for d in range(3):
                linear += relative_to_rgb[c, d] * relative[d]
            linear = min(max(linear, 0.0), 1.0)
            out[k, c] = 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055


def srgb_to_hsv(rgb: ArrayLike) -> Colours:
    """Convert sRGB colours in 0..1, shape (..., 3), to H in degrees 0..360, S and V in 0..1. A gray has H = S = 0."""
    return _through_cv2(rgb, cv2.COLOR_RGB2HSV)


def hsv_to_srgb(hsv: ArrayLike) -> Colours:
    """Convert H in degrees, S and V in 0..1, shape (..., 3), to sRGB in 0..1."""
    return _through_cv2(hsv, cv2.COLOR_HSV2RGB)


def to_8bit(rgb: ArrayLike) -> NDArray[np.uint8]:
    """Round sRGB in 0..1 to uint8 0..255."""
    return np.rint(np.clip(np.asarray(rgb, np.float64), 0, 1) * 255).astype(np.uint8)


def _through_cv2(colours: ArrayLike, code: int) -> Colours:
    rows: AnyArray = np.asarray(colours, np.float32)
    if rows.size == 0:
        return rows.astype(np.float64)
    return cv2.cvtColor(rows.reshape(1, -1, 3), code).reshape(rows.shape).astype(np.float64)
