"""Trapped-ball filling: zhang2011online, section 4.4, after zhang2009trapped."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels

SMALLEST_RADIUS_PX = 1
_ERODED_UP_TO_PX = 4


def radii(unlabelled_px: int) -> list[int]:
    """Ball radii from max(2, sqrt(N0) / 30) down to 1, halved each time, px."""
    radius = max(2, round(unlabelled_px**0.5 / 30))
    found = []
    while radius >= SMALLEST_RADIUS_PX:
        found.append(radius)
        radius //= 2
    return found


def fill(labels: Labels, blocked: NDArray[np.uint8], radius_px: int, first_label: int) -> int:
    """Let a ball of `radius_px` roll over unlabelled, unblocked pixels; each area it can reach becomes a region.

    Args:
        labels: int32 (h, w), 0 = unlabelled; changed in place.
        blocked: uint8 (h, w), non-zero on edges.
        radius_px: ball radius, px, >= 1.
        first_label: label of the first new region; the next ones count up.

    Returns:
        How many regions were made.

    A ball at a centre covers the disc around it; centres are the pixels whose disc holds no obstacle, so a gap
    in an edge narrower than the ball lets nothing through. The frame's border is no obstacle.
    """
    free = ((labels == 0) & (blocked == 0)).view(np.uint8)
    box = cv2.boundingRect(free)
    if not box[2]:
        return 0
    where = (slice(box[1], box[1] + box[3]), slice(box[0], box[0] + box[2]))
    return _fill(labels[where], np.ascontiguousarray(free[where]), radius_px, first_label)


def _fill(labels: Labels, free: NDArray[np.uint8], radius_px: int, first_label: int) -> int:
    side = 2 * radius_px + 1
    disc = np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)
    centres = _centres(free, disc, radius_px)
    count, cores = cv2.connectedComponents(centres, connectivity=4, ltype=cv2.CV_32S)
    if count == 1:
        return 0
    # The union of the discs, each pixel to its nearest core: a grey dilation paints the highest core number,
    # which is the only one wherever cores are more than a disc apart.
    if radius_px <= _ERODED_UP_TO_PX and count < 2**16:
        covered = cv2.dilate(cores.astype(np.uint16), disc)
        np.copyto(covered, cores, where=centres > 0, casting="unsafe")
        core_of = np.where(free > 0, covered, 0).astype(np.int32)
    else:
        core_of = _nearest_core(centres, np.asarray(cores, np.int32), free, radius_px)
    reached = core_of > 0
    labels[reached] = core_of[reached] + np.int32(first_label - 1)
    return count - 1


def _centres(free: NDArray[np.uint8], disc: NDArray[np.uint8], radius_px: int) -> NDArray[np.uint8]:
    """Where the ball's centre may be: an erosion, by taps while the ball is small and by distance when it is large."""
    if radius_px <= _ERODED_UP_TO_PX:
        return np.asarray(cv2.erode(free, disc, borderType=cv2.BORDER_CONSTANT, borderValue=255), np.uint8)
    distance = cv2.distanceTransform(free, cv2.DIST_L2, 5)
    return np.asarray(distance > radius_px, np.uint8)


def _nearest_core(
    centres: NDArray[np.uint8], cores: Labels, free: NDArray[np.uint8], radius_px: int
) -> Labels:  # fmt: skip
    distance, nearest = cv2.distanceTransformWithLabels(
        (centres == 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    core_of = np.zeros(int(nearest.max()) + 1, np.int32)
    at_core = centres > 0
    core_of[nearest[at_core]] = cores[at_core]
    return np.where((free > 0) & (distance <= radius_px), core_of[nearest], 0).astype(np.int32)
