"""Motion grouping: unlabelled pixels are divided into groups that move alike.

Seeds are corners, as in the first frame of zhang2011patches, section 4. Corners are joined if their velocities differ
little relative to their distance, so a rotating or growing object forms one group. A random walk then assigns the
remaining free pixels to the groups.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Labels, Mask
from pipeline.kernels.jit import kernel
from pipeline.regions.components import components
from pipeline.regions.random_walk import Edges, probabilities


class GroupParams(NamedTuple):
    """Constants of the grouping of regions by motion."""

    max_corners: int = 300
    max_groups: int = 12
    """Largest number of groups in a connected area; each needs the solution of a linear system."""
    border_px: int = 4
    """Width of the band on either side of a border in which motions are compared, px."""
    max_corner_distance_px: float = 28.0
    """Largest distance of two directly joined corners, px."""
    min_half_width_px: float = 4.0
    """Smallest half-width of a group, px: thinner areas are rims of moving objects."""
    velocity_tolerance_px: float = 0.4
    velocity_gradient: float = 0.06
    """Joined corners differ in velocity by at most VELOCITY_TOLERANCE_PX + VELOCITY_GRADIENT * distance, which admits a
    rotation of 3 degrees per frame."""


GROUPS = GroupParams()


def motion_groups(
    free: Mask, labels: Labels, motion: list[Flow], edges: Edges, small: Frame, smallest_px: int, first: int,
    half_width_px: float = GROUPS.min_half_width_px,
) -> Labels:  # fmt: skip
    """Group free pixels by motion: labels `first`, `first` + 1, ... of new groups, int32 (h, w), 0 elsewhere.

    A group that moves like an adjacent label at their common border gets that label.

    Args:
        free: bool (h, w), trackable pixels without a label.
        labels: int32 (h, w), existing labels, 0 = unlabelled.
        motion: one or two flow fields to the neighbouring frames, float32 (h, w, 2), px; empty = no groups.
        edges: edge weights of the random walk.
        small: uint8 (h, w, 3), the frame, in which corners are detected.
        smallest_px: smallest area of a new group, px.
        first: first unused label.
        half_width_px: smallest half-width of a new group, px.
    """
    if not motion:
        return np.zeros(labels.shape, np.int32)
    free = _without_specks(free, smallest_px, half_width_px)
    if not free.any():
        return np.zeros(labels.shape, np.int32)
    velocity = _smooth(np.concatenate(motion, axis=-1), free)
    groups = _groups(free, _corners(small, free), velocity, edges)
    return _labelled(groups, labels, velocity, smallest_px, first)


def _smooth(motion: NDArray[np.float32], free: Mask) -> NDArray[np.float32]:
    """Average the motion over the free pixels of a 3 x 3 window; other pixels are unchanged."""
    coverage = cv2.blur(free.astype(np.float32), (3, 3))
    mean = cv2.blur(np.where(free[..., None], motion, 0), (3, 3)) / np.maximum(coverage, np.float32(0.1))[..., None]
    return np.where(free[..., None], mean, motion).astype(np.float32)


def _groups(free: Mask, corners: NDArray[np.intp], velocity: NDArray[np.float32], edges: Edges) -> Labels:
    """Divide the free pixels into groups 1, 2, ...: int32 (h, w), 0 elsewhere.

    Each connected area is one group, or is divided by a random walk among the groups of corners inside it.
    """
    roots = _joined_corners(corners.astype(np.float32), velocity[corners[:, 1], corners[:, 0]], free)
    count, areas = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    out, used = np.zeros(free.shape, np.int32), 0
    area_of_corner = areas[corners[:, 1], corners[:, 0]]
    for area in range(1, count):
        inside = area_of_corner == area
        names, sizes = np.unique(roots[inside], return_counts=True)
        names = names[np.lexsort((names, -sizes))][: GROUPS.max_groups]
        mask = areas == area
        if len(names) <= 1:
            out[mask] = used + 1
        else:
            seeds = np.zeros(free.shape, np.int32)
            for number, name in enumerate(names.tolist(), start=1):
                x, y = corners[inside & (roots == name)].T
                seeds[y, x] = number
            out[mask] = used + _random_walk(seeds, mask, edges, len(names))[mask]
        used += max(len(names), 1)
    return out


def _random_walk(seeds: Labels, mask: Mask, edges: Edges, count: int) -> Labels:
    """Label of the most likely seed 1..count for each pixel of the mask's bounding box: int32 (h, w)."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    inner = mask[top:bottom, left:right]
    cut = edges[0][top:bottom, left : right - 1], edges[1][top : bottom - 1, left:right]
    chances = probabilities(seeds[top:bottom, left:right], _edges_within(cut, inner), count, tolerance=1e-2)
    out = np.zeros(mask.shape, np.int32)
    out[top:bottom, left:right] = chances.argmax(axis=0) + 1
    return out


def _labelled(groups: Labels, labels: Labels, velocity: NDArray[np.float32], smallest_px: int, first: int) -> Labels:
    """Label each group: the label of a neighbour with the same motion, else a new one from `first` on; 0 if small."""
    out = np.zeros(labels.shape, np.int32)
    for group in range(1, int(groups.max(initial=0)) + 1):
        mask = groups == group
        if not mask.any():
            continue
        neighbour = _neighbour_with_same_motion(mask, labels, velocity)
        if neighbour > 0:
            out[mask] = neighbour
        elif mask.sum() >= smallest_px:
            out[mask] = first
            first += 1
    return out


def _neighbour_with_same_motion(mask: Mask, labels: Labels, velocity: NDArray[np.float32]) -> int:
    """Label with the longest common border among those that move alike at the border; 0 = none."""
    band = np.ones((2 * GROUPS.border_px + 1, 2 * GROUPS.border_px + 1), np.uint8)
    around = cv2.dilate(mask.astype(np.uint8), band) > 0
    touched, sizes = np.unique(labels[around & ~mask & (labels > 0)], return_counts=True)
    best, most = 0, int(GROUPS.border_px * GROUPS.border_px)
    for label, size in zip(touched.tolist(), sizes.tolist(), strict=True):
        if size <= most:
            continue
        theirs = around & (labels == label)
        border = cv2.dilate(theirs.astype(np.uint8), band) > 0
        mine = border & mask
        difference = np.abs(np.median(velocity[mine], axis=0) - np.median(velocity[theirs], axis=0)).max()
        if difference <= GROUPS.velocity_tolerance_px:
            best, most = label, size
    return best


def _without_specks(mask: Mask, smallest_px: int, half_width_px: float) -> Mask:
    """Remove thin threads and areas that are too small or too thin."""
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    parts, areas = components(opened.astype(np.int32))
    depth = cv2.distanceTransform(opened, cv2.DIST_L2, 3)
    half_width = np.zeros(len(areas), np.float32)
    np.maximum.at(half_width, parts.ravel(), depth.ravel())
    return np.asarray((opened > 0) & (areas[parts] >= smallest_px) & (half_width[parts] >= half_width_px))


def _corners(small: Frame, free: Mask) -> NDArray[np.intp]:
    """Corners in the free area, (n, 2) as (x, y), px; a connected area without corners gets its innermost pixel."""
    gray = cv2.cvtColor(small, cv2.COLOR_RGB2GRAY)
    found = cv2.goodFeaturesToTrack(gray, GROUPS.max_corners, 0.01, 5, mask=free.astype(np.uint8))
    corners = np.zeros((0, 2), np.intp) if found is None else found.reshape(-1, 2).astype(np.intp)
    depth = cv2.distanceTransform(free.astype(np.uint8), cv2.DIST_L2, 3)
    count, areas = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    covered = np.unique(areas[corners[:, 1], corners[:, 0]])
    more = [np.argmax(np.where(areas == area, depth, -1)) for area in range(1, count) if area not in covered]
    inner = np.array([(place % free.shape[1], place // free.shape[1]) for place in more], np.intp).reshape(-1, 2)
    return np.concatenate([corners, inner])


@kernel
def _joined_corners(corners: NDArray[np.float32], velocity: NDArray[np.float32], free: Mask) -> NDArray[np.int32]:
    """Union-find root of each corner, int32 (n,). Corners are joined if the straight line between them is free."""
    n = len(corners)
    parent = np.arange(n).astype(np.int32)
    for i in range(n):
        for j in range(i):
            dx, dy = corners[i, 0] - corners[j, 0], corners[i, 1] - corners[j, 1]
            distance = np.sqrt(dx * dx + dy * dy)
            if distance > GROUPS.max_corner_distance_px:
                continue
            difference = np.float32(0.0)
            for c in range(velocity.shape[1]):
                difference = max(difference, abs(velocity[i, c] - velocity[j, c]))
            if difference > GROUPS.velocity_tolerance_px + GROUPS.velocity_gradient * distance:
                continue
            steps = int(distance) + 1
            clear = True
            for s in range(steps):
                px, py = int(corners[j, 0] + dx * s / steps + 0.5), int(corners[j, 1] + dy * s / steps + 0.5)
                clear = clear and free[py, px]
            if not clear:
                continue
            a, b = i, j
            while parent[a] != a:
                a = parent[a]
            while parent[b] != b:
                b = parent[b]
            parent[max(a, b)] = min(a, b)
    for i in range(n):
        a = i
        while parent[a] != a:
            a = parent[a]
        parent[i] = a
    return parent


def _edges_within(edges: Edges, free: Mask) -> Edges:
    """Edges between free pixels only."""
    right, down = edges
    return np.where(free[:, 1:] & free[:, :-1], right, 0), np.where(free[1:] & free[:-1], down, 0)
