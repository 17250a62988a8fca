"""Conversion of HDR and wide-gamut pictures to sRGB: BT.2020 and P3 primaries, PQ and HLG.

Diffuse white (203 cd/m2 in PQ, 75 % of the signal in HLG, by ITU-R BT.2408) becomes white; brighter light is clipped.
Colours outside the gamut of BT.709 are clipped. SDR keeps its transfer function: only its primaries are converted.

Sources: SMPTE ST 2084; ITU-R BT.2100-2 (table 5: HLG, system gamma 1.2 for a peak of 1000 cd/m2); BT.2087 (matrix).
"""

from __future__ import annotations

from functools import lru_cache

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray

PQ, HLG = 16, 18
"""Transfer characteristics (ISO/IEC 23091-2)."""
_WHITE_CD_M2, _PEAK_CD_M2 = 203.0, 1000.0
_PRIMARIES = {
    9: ("BT.2020", ((1.6605, -0.5876, -0.0728), (-0.1246, 1.1329, -0.0083), (-0.0182, -0.1006, 1.1187))),
    12: ("P3", ((1.2249, -0.2247, 0.0), (-0.0420, 1.0419, 0.0), (-0.0197, -0.0786, 1.0979))),
}
"""Code of primaries (ISO/IEC 23091-2) -> name, and matrix from their linear light to that of BT.709."""
_SAME = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_STEPS = 1 << 12
"""Entries of the table that encodes linear light, over its square root."""

Signal = tuple[int, int]
"""Primaries and transfer characteristics of a picture, ISO/IEC 23091-2."""


def wide_signal(picture: av.VideoFrame) -> Signal | None:
    """The signal of a picture that must be converted; None: sRGB, BT.709 and what is shown like them."""
    primaries, transfer = int(picture.color_primaries), int(picture.color_trc)
    return (primaries, transfer) if primaries in _PRIMARIES or transfer in (PQ, HLG) else None


def described(signal: Signal) -> str:
    """One sentence for the user."""
    name = _PRIMARIES.get(signal[0], ("BT.709", _SAME))[0]
    transfer = {PQ: " PQ", HLG: " HLG"}.get(signal[1], "")
    clipped = f" Light above {_WHITE_CD_M2:g} cd/m2 is white." if transfer else ""
    return f"Colours were converted from {name}{transfer} to sRGB.{clipped}"


def to_srgb(pixels: NDArray[np.uint16], signal: Signal) -> NDArray[np.uint8]:
    """Convert R'G'B', uint16 (h, w, 3), or (h, w, 4) with straight opacity, of full range."""
    matrix = np.array(_PRIMARIES.get(signal[0], ("", _SAME))[1], np.float32)
    light = _linear(signal[1])[pixels[..., :3]]
    if signal[1] == HLG:  # the display's gamma acts on luminance
        luminance = light @ np.array((0.2627, 0.6780, 0.0593), np.float32)
        gain = np.maximum(luminance, np.float32(1e-6)) ** np.float32(0.2) * np.float32(_PEAK_CD_M2 / _WHITE_CD_M2)
        light = np.asarray(light * gain[..., None], np.float32)
    shown = np.clip(cv2.transform(light, matrix), 0, 1)
    at = np.rint(np.sqrt(shown) * (_STEPS - 1)).astype(np.uint16)
    colours = _encoded(signal[1] in (PQ, HLG))[at]
    return colours if pixels.shape[2] == 3 else np.dstack([colours, _rounded(pixels[..., 3])])


def _rounded(values: AnyArray) -> NDArray[np.uint8]:
    return ((values.astype(np.uint32) * 255 + 32895) >> 16).astype(np.uint8)


@lru_cache(3)
def _linear(transfer: int) -> NDArray[np.float32]:
    """Linear light of each uint16 value: diffuse white is 1 (PQ), the peak is 1 (HLG, light of the scene), or white is
    1 (others: BT.709)."""
    signal = np.arange(65536) / 65535
    if transfer == PQ:
        m1, m2, c1, c2, c3 = 2610 / 16384, 2523 / 32, 3424 / 4096, 2413 / 128, 2392 / 128
        power = signal ** (1 / m2)
        return (10000 / _WHITE_CD_M2 * (np.maximum(power - c1, 0) / (c2 - c3 * power)) ** (1 / m1)).astype(np.float32)
    if transfer == HLG:
        a, b, c = 0.17883277, 0.28466892, 0.55991073
        return np.where(signal <= 0.5, signal**2 / 3, (np.exp((signal - c) / a) + b) / 12).astype(np.float32)
    return np.where(signal < 0.081243, signal / 4.5, ((signal + 0.099297) / 1.099297) ** (1 / 0.45)).astype(np.float32)


@lru_cache(2)
def _encoded(display_light: bool) -> NDArray[np.uint8]:
    """The uint8 value of linear light, by its square root: sRGB for light of a display, else BT.709."""
    light = np.linspace(0, 1, _STEPS) ** 2
    if display_light:
        values = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    else:
        values = np.where(light < 0.018054, 4.5 * light, 1.099297 * light**0.45 - 0.099297)
    return np.asarray(np.rint(values * 255), np.uint8)
