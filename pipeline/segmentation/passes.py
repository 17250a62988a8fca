"""A frame's three passes, each one compiled call: no part of them waits for Python's interpreter lock.

Called one by one, their thirty kernels cost two threads that share the interpreter a fifth of a small frame's time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Labels
from pipeline.jit import kernel
from pipeline.segmentation.growing import grow
from pipeline.segmentation.propagation import propagate, smooth_labels
from pipeline.segmentation.refinement import adopt, correct, merge_table
from pipeline.segmentation.regions import AREA, LIMIT, Lab8, Sums, means_of, measure, merge, rename
from pipeline.segmentation.trapped_ball import fill_small

CORE_ROLLS = 4
WORTH_A_ROLL = 0.001
"""Share of the frame that must have come free for the same ball to roll again."""
SPECK_PX = 4
"""A region below this is a speck at any frame size."""


@kernel
def carry_over(
    labels: Labels, lab: Lab8, limit: NDArray[np.uint8], flow: Flow, remainder: NDArray[np.int8],
    residual: NDArray[np.uint8], count: int, error_limit: float, margin: float, slack: float,
) -> tuple[Labels, NDArray[np.int8], Labels, Sums]:  # fmt: skip
    """First pass: the previous frame's `count` regions in this one, see `propagate`, `smooth_labels` and `correct`.

    Returns: labels as they arrived, what rounding left over, labels after correction, and the sums of the regions.
    """
    carried, left_over = propagate(labels, flow, remainder, residual, error_limit, 0.9)
    smooth = smooth_labels(carried)
    sums = measure(smooth, lab, limit, count)
    return carried, left_over, correct(smooth, lab, limit, sums, margin, slack), sums


@kernel
def fill_up(
    labels: Labels, lab: Lab8, edges: NDArray[np.uint8], limit: NDArray[np.uint8], sums: Sums,
    pixels: NDArray[np.int32], radius_px: int, slack: float,
) -> tuple[Sums, NDArray[np.int32]]:  # fmt: skip
    """Second pass: balls of `radius_px` and less, and growing after each that found something; `labels` in place.

    Returns: the sums with new regions, and the pixels still unlabelled.
    """
    while radius_px >= 1:
        known = sums.shape[0]
        sums = _roll(labels, lab, edges, limit, sums, pixels, radius_px, slack)
        if sums.shape[0] > known:
            pixels = grow(labels, lab, edges, limit, sums, pixels, False)
        radius_px //= 2
    return sums, pixels


@kernel
def _roll(
    labels: Labels, lab: Lab8, edges: NDArray[np.uint8], limit: NDArray[np.uint8], sums: Sums,
    pixels: NDArray[np.int32], radius_px: int, slack: float,
) -> Sums:  # fmt: skip
    for _ in range(CORE_ROLLS):
        born_from = sums.shape[0]
        made = fill_small(labels, edges, pixels, radius_px, born_from)
        if made == 0:
            break
        sums = with_room(sums, made)
        if adopt(labels, lab, limit, sums, pixels, born_from, slack) < WORTH_A_ROLL * labels.size:
            break
    return sums


@kernel
def with_room(sums: Sums, more: int) -> Sums:
    """The sums with rows for `more` new regions."""
    return np.concatenate((sums, np.zeros((more, sums.shape[1]), np.int64)))


@kernel
def name_regions(
    labels: Labels, carried: Labels, sums: Sums, born_from: int, areas_before: NDArray[np.int32],
    growing_limit: float, smallest: float, similar: float,
) -> tuple[Sums, NDArray[np.int32], NDArray[np.float32]]:  # fmt: skip
    """Third pass: merge specks and look-alikes, make labels dense (in place), and relate them to the frame before.

    Args:
        carried: labels as they arrived, or `NOTHING_CARRIED`.
        born_from: labels from here on are new in this frame.
        areas_before: px of the previous frame's regions by label.
        growing_limit: of importance 0.2, CIELAB units.
        smallest: px below which a region is a speck at importance 0; a fifth of it at importance 1.
        similar: CIELAB units.

    Returns: the sums of the regions, and for each its label in the previous frame (0 = new) and eq. 4's alpha:
        pixels carried over / sqrt(area before * area now), 0 = new.
    """
    count = sums.shape[0]
    specks = np.empty(count, np.int32)
    for label in range(count):
        strict = sums[label, LIMIT] / max(sums[label, AREA], 1) / growing_limit  # 1.2 - importance
        specks[label] = max(float(SPECK_PX), smallest * min(max(strict - 0.2, 0.2), 1.0))
    table = merge_table(labels, means_of(sums), sums[:, AREA].copy(), specks, born_from, np.float32(similar))
    sums, names, old = merge(sums, table)
    arrived = rename(labels, names[table], carried, names, sums.shape[0] - 1)
    alpha = np.zeros(old.size, np.float32)
    for label in range(old.size):
        if old[label] >= born_from:
            old[label] = 0
        elif old[label] > 0:
            both = max(float(areas_before[old[label]]) * float(sums[label, AREA]), 1.0)
            alpha[label] = min(arrived[label] / np.sqrt(both), 1.0)
    return sums, old, alpha
