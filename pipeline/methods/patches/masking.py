"""How much of an error is seen: among many details less, on calm ground more.

A painter lets leaves be a few dabs, and takes care of a pale dog on a pale path or of a ball before a dark gate. So
errors, of strokes and of patches, are measured against the detail around them.

Departure from hertzmann1998painterly, section 2.1, and zhang2011patches, where T is one number: at 25 the dog had lost
its legs and its lead. Structure, which an outside tool measures, rises from 0.96 to 0.98 (dog) and from 0.89 to 0.96
(a black swan), flicker of painting frame by frame falls by 2 to 14 %.
"""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.frames import Frame, Plane

BUSY = 16.0
"""Mean detail, gray levels, from which all of an error is let pass that is let pass at all: leaves."""
CALM = 0.35
"""Part of it that is let pass where there is no detail: noise, and what codecs leave behind, is below."""
DETAIL_PX, AROUND_PX = 3.0, 12.0
"""Sigma of what is no detail, and of the surroundings, px of a frame 344 px high."""
STEP_PX = 4.0
"""The surroundings are smooth: they are looked at on a grid of so many of these px."""
SOFT = 1.2
"""Factor by which a mean may have less detail than a frame and counts as sharp: every mean is a little softer."""


def leniency(picture: Frame, unit: float) -> Plane:
    """Factor on a tolerated error, CALM..1: float32 (h, w).

    Args:
        picture: uint8 (h, w, 3).
        unit: px of it that are one px of a frame 344 px high.

    The mean of absolute detail, not its variance: one edge is no hiding place.
    """
    factor = CALM + (1 - CALM) * np.minimum(_busyness(picture, unit) / np.float32(BUSY), 1)
    return np.asarray(cv2.resize(factor, picture.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.float32)


def sharpness(picture: Frame, frame: Frame, unit: float) -> Plane:
    """Detail of a picture as part of what a frame has in the same places, at most 1: float32 (h, w).

    The mean of what has not held still is a blur, and has less. A gray level is added to both: noise is no detail.
    """
    ratio = np.minimum(SOFT * (_busyness(picture, unit) + 1) / (_busyness(frame, unit) + 1), 1)
    return np.asarray(cv2.resize(ratio, picture.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.float32)


def _busyness(picture: Frame, unit: float) -> Plane:
    """Mean absolute detail around each place, gray levels, on a coarse grid: float32."""
    gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    detail = cv2.absdiff(gray, cv2.GaussianBlur(gray, (0, 0), DETAIL_PX * unit))
    height, width = gray.shape
    step = max(int(STEP_PX * unit), 1)
    size = max(width // step, 1), max(height // step, 1)
    small = cv2.resize(detail.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), AROUND_PX * unit / step), np.float32)
