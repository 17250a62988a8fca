"""The object under a click, or in a box: iterated graph cuts (Rother, Kolmogorov, Blake 2004, "GrabCut"), by OpenCV."""

from __future__ import annotations

from math import ceil
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Mask

Box = tuple[float, float, float, float]
"""Left, top, right, bottom, as fractions of the frame's sides."""


class ObjectParams(NamedTuple):
    """Constants of the search; lengths as shares of the longer side."""

    rounds: int = 3
    click: float = 0.005
    """Side of a box up to which it is a click."""
    sure: float = 0.015
    """Radius around a click that is the object."""
    likely: float = 0.18
    """Radius around a click in which the object is looked for first."""
    least: float = 0.1
    """Share of a box up to which nothing was found: colours in the box and around it are alike."""
    middle: float = 0.25
    """Sides of the ellipse in the middle of such a box that is the object, as shares of the box."""


OBJECT = ObjectParams()


def object_mask(frame: Frame, box: Box) -> Mask:
    """Pixels of the object: bool (h, w). The same frame and box give the same pixels.

    Args:
        frame: uint8 (h, w, 3).
        box: around the object: nothing outside is part of it. Or a click on it, a box of about no size: then the part
            that is connected with it. Corners may be in any order.
    """
    height, width = frame.shape[:2]
    (left, right), (top, bottom) = sorted(box[::2]), sorted(box[1::2])
    clicked = max((right - left) * width, (bottom - top) * height) <= OBJECT.click * max(frame.shape)
    at = (min(int(left * width), width - 1), min(int(top * height), height - 1))
    labels = np.full((height, width), cv2.GC_PR_BGD if clicked else cv2.GC_BGD, np.uint8)
    if clicked:
        for share, label in ((OBJECT.likely, cv2.GC_PR_FGD), (OBJECT.sure, cv2.GC_FGD)):
            cv2.circle(labels, at, max(1, round(share * max(frame.shape))), int(label), -1)
    else:
        labels[int(top * height) : ceil(bottom * height), int(left * width) : ceil(right * width)] = cv2.GC_PR_FGD
    edge = np.ones((height, width), bool)
    edge[1:-1, 1:-1] = False
    labels[edge & (labels == cv2.GC_PR_FGD)] = cv2.GC_BGD  # there is a background always
    found = _cut(frame, labels.copy())
    inside = labels == cv2.GC_PR_FGD
    if not clicked and found.sum() < OBJECT.least * inside.sum():
        middle = (round((left + right) / 2 * width), round((top + bottom) / 2 * height))
        axes = [max(1, round(OBJECT.middle / 2 * span)) for span in ((right - left) * width, (bottom - top) * height)]
        cv2.ellipse(labels, middle, axes, 0, 0, 360, int(cv2.GC_FGD), -1)
        found = _cut(frame, labels)
    if clicked:
        _, parts = cv2.connectedComponents(found.astype(np.uint8), connectivity=4)
        found = found & (parts == parts[at[1], at[0]])
    return found


def _cut(frame: Frame, labels: NDArray[np.uint8]) -> Mask:
    """Pixels that the graph cuts take for the object, from what `labels` says, which change."""
    ground, thing = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(0)
    cv2.grabCut(frame, labels, (0, 0, 1, 1), ground, thing, OBJECT.rounds, cv2.GC_INIT_WITH_MASK)
    return np.isin(labels, (cv2.GC_FGD, cv2.GC_PR_FGD))
