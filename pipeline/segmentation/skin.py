"""Hands and arms: pieces of skin beside a face, found by the colour of that face.

Departure: the papers use faces only, and OpenCV has no detector of hands. A hand has the colour of its owner's face in
the same light, so that no table of skin colours is needed, and it is within the reach of the owner's arms.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.colour.lab8 import rgb_to_lab8
from pipeline.frames import Frame, Plane
from pipeline.segmentation.faces import Faces
from pipeline.segmentation.shrink import shrink, size_within

SIDE_PX = 256
"""Longer side of the picture in which hands are searched, px."""
MIDDLE = np.float32(128)
"""Level of a = 0 and b = 0 in 8-bit CIELAB."""

LEAST_FACE_PX = 12.0
"""Width of a face in the searched picture below which its hands are too small to be found."""
FINEST_FACE_PX = 64.0
"""Width of a face in the searched picture from which on half of the resolution shows hands as well."""
LEAST_CHROMA = 7.0
"""Least chroma of a face (CIELAB) for this search. Below it, as in black-and-white films, many things have its
colour."""
LEAST_DETECTIONS = 2
"""Detections of a face before its hands are searched. A false face is rarely detected twice."""
_LEAST_RED, _LEAST_YELLOW = 2.0, 2.0
"""Least a and b (CIELAB) of a face: what looks like one in leaves or grass is greener."""
_CHEEKS = (0.3, 0.0, 0.28)
"""The part of a detected box that is surely skin, as fractions of the box's side: its half width, and the distances of
its top and bottom below the centre."""
_CHROMA_SPREAD, _LEAST_SPREAD, _MOST_SPREAD = 1.5, 4.5, 7.0
"""Standard deviation of skin in a and b (CIELAB): this many times the median deviation in the cheeks, within limits."""
_DARKEST, _LIGHTEST = 0.45, 1.3
"""Lightness of skin elsewhere, relative to the face's."""
_REACH, _BELOW = 4.5, 2.0
"""The ellipse within which hands are searched, as fractions of the box's sides: its semi-axes, and how far its centre
is below the face's."""
_LEAST_AREA, _MOST_AREA = 0.08, 3.0
"""Least and largest area of a hand or arm, in areas of the box: a hand that is half hidden, two bare arms. Walls of the
same colour are larger."""
_LEAST_LIKELIHOOD = 0.35
"""Likelihood, 0..1, from which on a pixel counts as skin."""
_FARTHEST = 1.1 * math.log(1 / _LEAST_LIKELIHOOD)
"""Distance from the face's colour, in the exponent of the likelihood, beyond which no pixel has that likelihood."""
_WIDER, _SOFT = 0.12, 0.12
"""Radius of the mask's dilation, which covers the blurred outlines of moving fingers, and standard deviation of the
mask's blur; both as fractions of the box's side."""


def skin_beside_faces(picture: Frame, faces: Faces, size: tuple[int, int]) -> Plane | None:
    """Soft mask of hands and arms, times the strengths of their faces; None without any.

    Returns: float32, 0..1, at most `SIDE_PX` on the longer side, or half of that if all these faces are large.

    Args:
        picture: uint8 RGB (h, w, 3), the frame or a smaller version of it.
        size: (width, height) of the frame in whose pixels the faces are given.
    """
    searched = size_within(size, SIDE_PX)
    widths = faces["box"][:, 2] * (searched[0] / size[0])
    chosen = (widths >= LEAST_FACE_PX) & (faces["detections"] >= LEAST_DETECTIONS)
    if not chosen.any():
        return None
    if widths[chosen].min() >= FINEST_FACE_PX:
        searched = searched[0] // 2, searched[1] // 2
    boxes = faces["box"] * np.tile(np.divide(searched, size), 2)
    lab = rgb_to_lab8(shrink(picture, searched)).astype(np.float32)
    masks = [
        np.float32(face["strength"]) * found
        for face, box in zip(faces[chosen], boxes[chosen], strict=True)
        if (found := _skin_of(lab, box)) is not None
    ]
    return np.maximum.reduce(masks) if masks else None


def _skin_of(lab: NDArray[np.float32], box: NDArray[np.float64]) -> Plane | None:
    """Hands and arms of one person; None without any, or if the face has not the colour of skin or hardly any pixels.

    Args:
        lab: float32 (3, h, w), 8-bit CIELAB levels.
    """
    cx, cy, w, h = box
    half, top, bottom = _CHEEKS
    rows = slice(max(0, round(cy + top * h)), max(0, round(cy + bottom * h) + 1))
    columns = slice(max(0, round(cx - half * w)), max(0, round(cx + half * w) + 1))
    cheeks = lab[:, rows, columns].reshape(3, -1)
    if cheeks.shape[1] < 4:
        return None
    colour = _medians(cheeks)
    red, yellow = colour[1] - MIDDLE, colour[2] - MIDDLE
    if np.hypot(red, yellow) < LEAST_CHROMA or red < _LEAST_RED or yellow < _LEAST_YELLOW:
        return None
    spread = _CHROMA_SPREAD * float(_medians(np.abs(cheeks[1:] - colour[1:, None]).reshape(1, -1))[0])
    spread = min(max(spread, _LEAST_SPREAD), _MOST_SPREAD)
    light, a, b = lab
    away = ((a - colour[1]) ** 2 + (b - colour[2]) ** 2) / np.float32(2 * spread * spread)
    skin = (away <= _FARTHEST) & (light >= _DARKEST * colour[0]) & (light <= _LIGHTEST * colour[0])
    y, x = np.nonzero(skin)
    skin[y, x] = np.exp(-away[y, x]) * _within_reach(x, y, box) > _LEAST_LIKELIHOOD
    kept = _pieces(skin, box)
    if kept is None:
        return None
    wide = 2 * round(_WIDER * w) + 1
    kept = np.asarray(cv2.dilate(kept, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (wide, wide))), np.uint8)
    return np.asarray(cv2.GaussianBlur(kept.astype(np.float32), (0, 0), max(_SOFT * w, 0.5)), np.float32)


def _medians(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Median of each row, float32; the upper median for an even number of values."""
    middle = rows.shape[1] // 2
    return np.asarray(np.partition(rows, middle, axis=1)[:, middle], np.float32)


def _within_reach(x: NDArray[np.intp], y: NDArray[np.intp], box: NDArray[np.float64]) -> NDArray[np.float32]:
    """1 at pixels to which the arms reach, falling to 0 at one and a half times that distance: float32 (n,)."""
    cx, cy, w, h = box
    across = ((x + 0.5 - cx) / (_REACH * w)) ** 2
    down = ((y + 0.5 - cy - _BELOW * h) / (_REACH * h)) ** 2
    distance = np.sqrt(across + down)
    return np.asarray(np.clip(3 - 2 * distance, 0, 1), np.float32)


def _pieces(skin: NDArray[np.bool_], box: NDArray[np.float64]) -> NDArray[np.uint8] | None:
    """1 in the connected pieces of skin that have the area of hands or arms and are not the face; None without any."""
    cx, cy, w, h = box
    _, labels, stats, _ = cv2.connectedComponentsWithStats(skin.astype(np.uint8), connectivity=8)
    area = stats[:, cv2.CC_STAT_AREA] / (w * h)
    hands = (area >= _LEAST_AREA) & (area <= _MOST_AREA)
    hands[0] = False
    y, x = (min(max(round(at), 0), side - 1) for at, side in zip((cy, cx), skin.shape, strict=True))
    hands[labels[y, x]] = False
    return hands[labels].astype(np.uint8) if hands.any() else None
