"""Measures the distance between the colours of a painting and those of the reference image."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.frames import Frame

_PALETTE_PX, _SAMPLED_PX = 128, 24
"""Longest side, px, to which the picture and a painted frame are reduced by picking pixels."""


class PictureColours:
    """Colours of a picture: at most 128 x 128 of its pixels.

    Args:
        picture: uint8 (height, width, 3).
    """

    def __init__(self, picture: Frame) -> None:
        self._colours = np.unique(_picked(picture, _PALETTE_PX), axis=0).astype(np.float32)
        self._squares = np.square(self._colours).sum(axis=1)

    def distance(self, frame: Frame) -> float:
        """Mean distance of the frame's colours (at most 24 x 24 pixels) to the nearest of the palette, RGB, 0..442."""
        colours = _picked(frame, _SAMPLED_PX).astype(np.float32)
        squares = np.square(colours).sum(axis=1)[:, None] - 2 * colours @ self._colours.T + self._squares
        return float(np.sqrt(squares.min(axis=1).clip(min=0)).mean())


def _picked(frame: Frame, side_px: int) -> Frame:
    """Colours of evenly spaced pixels, uint8 (pixels, 3)."""
    height, width = frame.shape[:2]
    scale = min(1.0, side_px / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_NEAREST), np.uint8).reshape(-1, 3)
