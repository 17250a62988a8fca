"""Connected components of a label map, and removal of small components."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels, Mask
from pipeline.kernels.jit import kernel


def components(labels: Labels) -> tuple[Labels, NDArray[np.int32]]:
    """4-connected components of equal label, label 0 included.

    Returns: component of each pixel, int32 (h, w), from 0 in the order of first pixels; areas, int32 (n,), px.
    """
    out = np.empty(labels.shape, np.int32)
    areas = np.zeros(labels.size, np.int32)
    count = _components(labels, out, areas)
    return out, areas[:count].copy()


@kernel
def _components(labels: Labels, out: Labels, areas: NDArray[np.int32]) -> int:
    height, width = labels.shape
    out[:] = -1
    stack = np.empty(height * width, np.int32)
    count = 0
    for start in range(height * width):
        if out[start // width, start % width] >= 0:
            continue
        own = labels[start // width, start % width]
        out[start // width, start % width] = count
        stack[0], top = start, 1
        while top > 0:
            top -= 1
            y, x = stack[top] // width, stack[top] % width
            areas[count] += 1
            for step in range(4):
                ny, nx = y + (step == 0) - (step == 1), x + (step == 2) - (step == 3)
                if 0 <= ny < height and 0 <= nx < width and out[ny, nx] < 0 and labels[ny, nx] == own:
                    out[ny, nx] = count
                    stack[top] = ny * width + nx
                    top += 1
        count += 1
    return count


def absorb_specks(labels: Labels, smallest_px: int, smallest_hole_px: int) -> Labels:
    """Give the pixels of small components the label of the nearest pixel outside of them.

    If all components are small, the labels are returned unchanged.

    Args:
        smallest_px: area below which a labelled component is small, px.
        smallest_hole_px: area below which an unlabelled component (label 0) is small, px.
    """
    parts, areas = components(labels)
    hole = labels == 0
    small: Mask = np.where(hole, areas[parts] < smallest_hole_px, areas[parts] < smallest_px)
    if not small.any() or small.all():
        return labels
    _, nearest = cv2.distanceTransformWithLabels(small.astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL)
    keys = np.zeros(int(nearest.max()) + 1, np.int32)
    keys[nearest[~small]] = labels[~small]
    return np.where(small, keys[nearest], labels).astype(np.int32)
