"""Segmentation of a frame in three passes, each a single compiled call without the interpreter lock.

With about thirty separate calls, two threads lose a fifth of a small frame's time waiting for the interpreter lock.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.colour.lab8 import Lab8
from pipeline.frames import Labels
from pipeline.kernels.jit import kernel
from pipeline.regions.growing import grow
from pipeline.regions.propagation import (
    PreviousRegions,
    PropagationLimits,
    propagate,
    release_changed,
    smooth_labels,
)
from pipeline.regions.refinement import add_regions, correct, merge_table
from pipeline.regions.regions import AREA, LIMIT, Sums, means_of, measure, merge, relabel
from pipeline.regions.trapped_ball import fill_small


class FillParams(NamedTuple):
    """Constants of the filling of a frame."""

    max_rolls: int = 4
    """Largest number of fills with the same ball radius."""
    min_released_share: float = 0.001
    """Share of the frame that must have been released before the same ball radius is tried again."""
    least_detail_px: int = 2
    side_per_detail_px: int = 240
    """Radius of the smallest ball that finds details before their neighbours grow over them: 1 px per
    `side_per_detail_px` px of the frame's shorter side, at least `least_detail_px`. Smaller balls fit into blurred
    edges."""
    first_growth: float = 0.5
    """Fraction of the growing limit that applies until all details have been found."""
    thinnest_px: float = 1.5
    """Regions that are narrower are merged if their colour is a mixture of those beside them."""
    speck_px: int = 4
    """Regions with fewer pixels are merged at any frame size, unless none is merged for its size."""


FILLING = FillParams()


@kernel
def propagate_regions(
    previous: PreviousRegions, lab: Lab8, limit: NDArray[np.uint8], limits: PropagationLimits
) -> tuple[Labels, NDArray[np.int8], Labels, Sums]:
    """First pass: propagate the previous frame's regions to this frame, smooth and correct them.

    Returns: propagated labels, motion remainders, corrected labels, and the sums of the regions.
    """
    propagated, remainder = propagate(
        previous.labels, previous.flow, previous.remainder, previous.residual, limits.error, 0.9
    )
    smooth = smooth_labels(propagated)
    release_changed(smooth, lab, limit, previous, limits)
    sums = measure(smooth, lab, limit, len(previous.means) - 1)
    return propagated, remainder, correct(smooth, lab, limit, sums, limits.margin, limits.slack), sums


@kernel
def fill_remaining(
    labels: Labels, lab: Lab8, edges: NDArray[np.uint8], limit: NDArray[np.uint8], sums: Sums,
    pixels: NDArray[np.int32], radius_px: int, slack: float,
) -> tuple[Sums, NDArray[np.int32]]:  # fmt: skip
    """Second pass: fill with balls of decreasing radius from `radius_px`, and grow regions after each; `labels` in
    place.

    Departure: regions grow up to `FILLING.first_growth` of the limit until the smallest ball for details has rolled.
        With the
    whole limit, a wall grows over its windows before a ball that fits into a window finds them.

    Returns: sums with the new regions, and the pixels that are still unlabelled.
    """
    smallest_px = max(FILLING.least_detail_px, min(labels.shape[0], labels.shape[1]) // FILLING.side_per_detail_px)
    while radius_px >= 1:
        share = FILLING.first_growth if radius_px >= smallest_px else 1.0
        if share == 1.0:
            pixels = grow(labels, lab, edges, limit, sums, pixels, share)
        known = sums.shape[0]
        sums = _roll(labels, lab, edges, limit, sums, pixels, radius_px, slack)
        if sums.shape[0] > known:
            pixels = grow(labels, lab, edges, limit, sums, pixels, share)
        radius_px //= 2
    return sums, pixels


@kernel
def _roll(
    labels: Labels, lab: Lab8, edges: NDArray[np.uint8], limit: NDArray[np.uint8], sums: Sums,
    pixels: NDArray[np.int32], radius_px: int, slack: float,
) -> Sums:  # fmt: skip
    for _ in range(FILLING.max_rolls):
        first_new = sums.shape[0]
        made = fill_small(labels, edges, pixels, radius_px, first_new)
        if made == 0:
            break
        sums = append_rows(sums, made)
        if add_regions(labels, lab, limit, sums, pixels, first_new, slack) < FILLING.min_released_share * labels.size:
            break
    return sums


@kernel
def append_rows(sums: Sums, more: int) -> Sums:
    """Append rows of zeros for `more` new regions."""
    return np.concatenate((sums, np.zeros((more, sums.shape[1]), np.int64)))


@kernel
def finalize_regions(
    labels: Labels, propagated: Labels, sums: Sums, firsts: tuple[int, int], areas_before: NDArray[np.int32],
    growing_limit: float, smallest: float, differences: tuple[float, float],
) -> tuple[Sums, NDArray[np.int32], NDArray[np.float32]]:  # fmt: skip
    """Third pass: merge small and similar regions, number labels densely (in place), and match the previous frame.

    Args:
        propagated: int32 (h, w), labels propagated from the previous frame, or `NOT_PROPAGATED`.
        firsts: smallest label of a region that is new in this frame, and of one that may be merged because it is alike.
        areas_before: areas of the previous frame's regions by label, px.
        growing_limit: growing limit at importance 0.2, CIELAB units.
        smallest: area below which a region is merged at importance 0, px; a fifth of it at importance 1; 0 = none is.
        differences: difference of mean colours below which a region is merged, and above which a region may be
            smaller, CIELAB units, see `merge_table`.

    Returns: sums of the regions; for each region its label in the previous frame (0 = new), and alpha of equation 4:
        pixels kept / sqrt(area before * area now), 0 for a new region.
    """
    count = sums.shape[0]
    specks = np.empty(count, np.int32)
    fewest = float(FILLING.speck_px) if smallest > 0 else 0.0
    for label in range(count):
        strict = sums[label, LIMIT] / max(sums[label, AREA], 1) / growing_limit  # 1.2 - importance
        specks[label] = max(fewest, smallest * min(max(strict - 0.2, 0.2), 1.0))
    first_new, first_alike = firsts
    thinnest = FILLING.thinnest_px if smallest > 0 else 0.0
    similar, distinct = np.float32(differences[0]), np.float32(differences[1])
    table = merge_table(labels, means_of(sums), sums[:, AREA].copy(), specks, thinnest, first_alike, similar, distinct)
    sums, names, old = merge(sums, table)
    arrived = relabel(labels, names[table], propagated, names, sums.shape[0] - 1)
    alpha = np.zeros(old.size, np.float32)
    for label in range(old.size):
        if old[label] >= first_new:
            old[label] = 0
        elif old[label] > 0:
            product = max(float(areas_before[old[label]]) * float(sums[label, AREA]), 1.0)
            alpha[label] = min(arrived[label] / np.sqrt(product), 1.0)
    return sums, old, alpha
