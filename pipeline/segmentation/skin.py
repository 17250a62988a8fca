"""Hands and arms: pieces of skin beside a face, found by the colour of that face.

Departure: the papers use faces only, and OpenCV has no detector of hands. A hand has the colour of its owner's face in
the same light, so that no table of skin colours is needed, and it is within the reach of the owner's arms.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Plane
from pipeline.segmentation.faces import Faces

LEAST_FACE_PX = 12.0
"""Width of a face in the searched picture below which its hands are too small to be found."""
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
_WIDER, _SOFT = 0.12, 0.12
"""Radius of the mask's dilation, which covers the blurred outlines of moving fingers, and standard deviation of the
mask's blur; both as fractions of the box's side."""


def skin_beside_faces(picture: Frame, faces: Faces, size: tuple[int, int]) -> Plane:
    """Soft mask of hands and arms, times the strengths of their faces: float32 (h, w), 0..1.

    Args:
        picture: uint8 RGB (h, w, 3), the frame or a smaller version of it.
        size: (width, height) of the frame in whose pixels the faces are given.
    """
    height, width = picture.shape[:2]
    out = np.zeros((height, width), np.float32)
    boxes = faces["box"] * np.array([width / size[0], height / size[1]] * 2)
    chosen = (boxes[:, 2] >= LEAST_FACE_PX) & (faces["detections"] >= LEAST_DETECTIONS)
    if not chosen.any():
        return out
    lab = cv2.cvtColor(picture.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    for face, box in zip(faces[chosen], boxes[chosen], strict=True):
        found = _skin_of(np.asarray(lab, np.float32), box)
        if found is not None:
            np.maximum(out, np.float32(face["strength"]) * found, out=out)
    return out


def _skin_of(lab: NDArray[np.float32], box: NDArray[np.float64]) -> Plane | None:
    """Skin of one person; None if the face has not the colour of skin, or hardly any pixels."""
    cx, cy, w, h = box
    half, top, bottom = _CHEEKS
    rows = slice(max(0, round(cy + top * h)), max(0, round(cy + bottom * h) + 1))
    columns = slice(max(0, round(cx - half * w)), max(0, round(cx + half * w) + 1))
    cheeks = lab[rows, columns].reshape(-1, 3)
    if len(cheeks) < 4:
        return None
    colour = np.median(cheeks, axis=0)
    if np.hypot(colour[1], colour[2]) < LEAST_CHROMA or colour[1] < _LEAST_RED or colour[2] < _LEAST_YELLOW:
        return None
    spread = _CHROMA_SPREAD * float(np.median(np.abs(cheeks[:, 1:] - colour[1:])))
    spread = min(max(spread, _LEAST_SPREAD), _MOST_SPREAD)
    away = ((lab[..., 1:] - colour[1:]) ** 2).sum(axis=2) / np.float32(2 * spread * spread)
    likelihood = np.exp(-away) * _within_reach(lab.shape[:2], box)
    likelihood[(lab[..., 0] < _DARKEST * colour[0]) | (lab[..., 0] > _LIGHTEST * colour[0])] = 0
    kept = _pieces(likelihood > _LEAST_LIKELIHOOD, box)
    wide = 2 * round(_WIDER * w) + 1
    kept = np.asarray(cv2.dilate(kept, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (wide, wide))), np.float32)
    return np.asarray(cv2.GaussianBlur(kept, (0, 0), max(_SOFT * w, 0.5)), np.float32)


def _within_reach(shape: tuple[int, int], box: NDArray[np.float64]) -> Plane:
    """1 where the arms reach, falling to 0 at one and a half times that distance."""
    cx, cy, w, h = box
    across = ((np.arange(shape[1]) + 0.5 - cx) / (_REACH * w)) ** 2
    down = ((np.arange(shape[0]) + 0.5 - cy - _BELOW * h) / (_REACH * h)) ** 2
    distance = np.sqrt(across[None, :] + down[:, None])
    return np.asarray(np.clip(3 - 2 * distance, 0, 1), np.float32)


def _pieces(skin: NDArray[np.bool_], box: NDArray[np.float64]) -> Plane:
    """1 in the connected pieces of skin that have the area of hands and arms, and are not the face; float32."""
    cx, cy, w, h = box
    _, labels, stats, _ = cv2.connectedComponentsWithStats(skin.astype(np.uint8), connectivity=8)
    area = stats[:, cv2.CC_STAT_AREA] / (w * h)
    hands = (area >= _LEAST_AREA) & (area <= _MOST_AREA)
    hands[0] = False
    y, x = (min(max(round(at), 0), side - 1) for at, side in zip((cy, cx), skin.shape, strict=True))
    hands[labels[y, x]] = False
    return np.asarray(hands[labels], np.float32)
