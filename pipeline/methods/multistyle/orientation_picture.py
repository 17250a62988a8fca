"""The artefact "directions": a picture of the orientation field of each frame."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.methods.multistyle.analysis import StrokeAnalysis
from pipeline.video.stills import encode_png
from pipeline.video.writer import zip_entry

DIRECTIONS = "directions"
SPACING, LENGTH, THICKNESS = 0.025, 0.02, 0.003
"""Distance, length and thickness of the line segments, as fractions of the picture's shorter side."""
DIM = 0.45
"""Lightness of the gray picture under the segments."""


def orientation_picture(analysis: StrokeAnalysis, size: tuple[int, int]) -> Frame:
    """Line segments along the stroke directions over a dimmed gray picture: uint8 (h, w, 3).

    The hue of a segment is twice its angle, so that angles half a turn apart have the same colour.

    Args:
        size: (width, height) of the picture, px.
    """
    width, height = size
    gray = cv2.cvtColor(cv2.resize(analysis.picture, size, interpolation=cv2.INTER_LINEAR), cv2.COLOR_RGB2GRAY)
    out = np.ascontiguousarray(np.repeat((gray * DIM).astype(np.uint8)[..., None], 3, axis=2))
    field = analysis.direction(size)
    side = min(size)
    step, thickness = max(4, round(SPACING * side)), max(1, round(THICKNESS * side))
    for y in range(step // 2, height, step):
        for x in range(step // 2, width, step):
            angle = float(np.arctan2(field[y, x, 1], field[y, x, 0])) / 2
            reach = np.array([np.cos(angle), np.sin(angle)]) * LENGTH * side / 2
            ends = [tuple(int(v) for v in np.rint((np.array([x, y]) + sign * reach) * 16)) for sign in (-1, 1)]
            cv2.line(out, ends[0], ends[1], _colour(angle), thickness, cv2.LINE_AA, shift=4)
    return out


def _colour(angle_rad: float) -> tuple[int, int, int]:
    hsv = np.array([[[round(angle_rad / np.pi * 180) % 180, 200, 255]]], np.uint8)
    red, green, blue = cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0, 0].tolist()
    return red, green, blue


def archive(pictures: Mapping[int, NDArray[np.uint8]]) -> bytes:
    """Zip of PNG files `directions-0000012.png`, by frame number."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as target:
        for number in sorted(pictures):
            target.writestr(zip_entry(f"{DIRECTIONS}-{number:07d}.png"), encode_png(pictures[number]))
    return stream.getvalue()
