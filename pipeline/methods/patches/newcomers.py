"""New clusters: unlabelled trackable pixels are grouped by motion.

Seeds are corners, as in the first frame of zhang2011patches. Corners are joined if their velocities differ little
relative to their distance, so a rotating or growing object forms one cluster. A random walk then assigns the remaining
free pixels to the groups.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Labels, Mask
from pipeline.jit import kernel
from pipeline.segmentation.components import components
from pipeline.segmentation.random_walk import Edges, probabilities

MOST_CORNERS = 300
MOST_GROUPS = 12
"""Largest number of groups in a connected area; each needs the solution of a linear system."""
NEAR_PX = 4
"""Width of the band on either side of a border in which motions are compared, working px."""
REACH_PX = 28.0
"""Largest distance of two directly joined corners, working px."""
THICK_PX = 4.0
"""Smallest half-width of a new cluster, working px: thinner areas are rims of moving objects."""
SLACK_PX = 0.4
STRETCH = 0.06
"""Joined corners differ in velocity by at most SLACK_PX + STRETCH * distance: 3 degrees of rotation per frame pass."""


def newcomers(
    free: Mask, labels: Labels, motion: list[Flow], edges: Edges, small: Frame, smallest_px: int, first: int
) -> Labels:  # fmt: skip
    """Labels `first`, `first` + 1, ... of new clusters, int32 (h, w), 0 elsewhere.

    Args:
        free: bool (h, w), trackable pixels without a label.
        labels: int32 (h, w), existing labels, 0 = unclustered.
        motion: one or two flow fields to the neighbouring frames, float32 (h, w, 2), working px.
        edges: edge weights of the random walk.
        small: uint8 (h, w, 3), the frame at the working size.
        smallest_px: smallest area of a new cluster, working px.
        first: first unused label.
    """
    if not motion:
        return np.zeros(labels.shape, np.int32)
    free = _without_specks(free, smallest_px)
    if not free.any():
        return np.zeros(labels.shape, np.int32)
    velocity = _smooth(np.concatenate(motion, axis=-1), free)
    grown = _grown(free, _corners(small, free), velocity, edges)
    return _named(grown, labels, velocity, smallest_px, first)


def _smooth(motion: NDArray[np.float32], free: Mask) -> NDArray[np.float32]:
    """Average the motion over the free pixels of a 3 x 3 window; other pixels are unchanged."""
    share = cv2.blur(free.astype(np.float32), (3, 3))
    mean = cv2.blur(np.where(free[..., None], motion, 0), (3, 3)) / np.maximum(share, np.float32(0.1))[..., None]
    return np.where(free[..., None], mean, motion).astype(np.float32)


def _grown(free: Mask, spots: NDArray[np.intp], velocity: NDArray[np.float32], edges: Edges) -> Labels:
    """Divide the free pixels into groups 1, 2, ...: int32 (h, w), 0 elsewhere.

    Each connected area is one group, or is divided by a random walk among the groups of corners inside it.
    """
    roots = _joined(spots.astype(np.float32), velocity[spots[:, 1], spots[:, 0]], free)
    count, parts = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    out, named = np.zeros(free.shape, np.int32), 0
    home = parts[spots[:, 1], spots[:, 0]]
    for part in range(1, count):
        mine = home == part
        names, sizes = np.unique(roots[mine], return_counts=True)
        names = names[np.lexsort((names, -sizes))][:MOST_GROUPS]
        mask = parts == part
        if len(names) <= 1:
            out[mask] = named + 1
        else:
            seeds = np.zeros(free.shape, np.int32)
            for number, name in enumerate(names.tolist(), start=1):
                x, y = spots[mine & (roots == name)].T
                seeds[y, x] = number
            out[mask] = named + _walked(seeds, mask, edges, len(names))[mask]
        named += max(len(names), 1)
    return out


def _walked(seeds: Labels, mask: Mask, edges: Edges, count: int) -> Labels:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    inner = mask[top:bottom, left:right]
    cut = edges[0][top:bottom, left : right - 1], edges[1][top : bottom - 1, left:right]
    chances = probabilities(seeds[top:bottom, left:right], _within(cut, inner), count, tolerance=1e-2)
    out = np.zeros(mask.shape, np.int32)
    out[top:bottom, left:right] = chances.argmax(axis=0) + 1
    return out


def _named(grown: Labels, labels: Labels, velocity: NDArray[np.float32], smallest_px: int, first: int) -> Labels:
    """Label each group: the label of a neighbour with the same motion, else a new one from `first` on; 0 if small."""
    out = np.zeros(labels.shape, np.int32)
    for thing in range(1, int(grown.max(initial=0)) + 1):
        mask = grown == thing
        if not mask.any():
            continue
        friend = _companion(mask, labels, velocity)
        if friend > 0:
            out[mask] = friend
        elif mask.sum() >= smallest_px:
            out[mask] = first
            first += 1
    return out


def _companion(mask: Mask, labels: Labels, velocity: NDArray[np.float32]) -> int:
    """Label with the longest common border among those that move alike at the border; 0 = none."""
    around = cv2.dilate(mask.astype(np.uint8), np.ones((2 * NEAR_PX + 1, 2 * NEAR_PX + 1), np.uint8)) > 0
    touched, sizes = np.unique(labels[around & ~mask & (labels > 0)], return_counts=True)
    best, most = 0, int(NEAR_PX * NEAR_PX)
    for label, size in zip(touched.tolist(), sizes.tolist(), strict=True):
        if size <= most:
            continue
        theirs = around & (labels == label)
        border = cv2.dilate(theirs.astype(np.uint8), np.ones((2 * NEAR_PX + 1, 2 * NEAR_PX + 1), np.uint8)) > 0
        mine = border & mask
        apart = np.abs(np.median(velocity[mine], axis=0) - np.median(velocity[theirs], axis=0)).max()
        if apart <= SLACK_PX:
            best, most = label, size
    return best


def _without_specks(mask: Mask, smallest_px: int) -> Mask:
    """Remove thin threads and areas that are too small or too thin."""
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    parts, areas = components(opened.astype(np.int32))
    depth = cv2.distanceTransform(opened, cv2.DIST_L2, 3)
    deepest = np.zeros(len(areas), np.float32)
    np.maximum.at(deepest, parts.ravel(), depth.ravel())
    return np.asarray((opened > 0) & (areas[parts] >= smallest_px) & (deepest[parts] >= THICK_PX))


def _corners(small: Frame, free: Mask) -> NDArray[np.intp]:
    """Corners in the free area, (n, 2) as (x, y), px; a connected area without corners gets its innermost pixel."""
    gray = cv2.cvtColor(small, cv2.COLOR_RGB2GRAY)
    found = cv2.goodFeaturesToTrack(gray, MOST_CORNERS, 0.01, 5, mask=free.astype(np.uint8))
    spots = np.zeros((0, 2), np.intp) if found is None else found.reshape(-1, 2).astype(np.intp)
    depth = cv2.distanceTransform(free.astype(np.uint8), cv2.DIST_L2, 3)
    count, parts = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    held = np.unique(parts[spots[:, 1], spots[:, 0]])
    more = [np.argmax(np.where(parts == part, depth, -1)) for part in range(1, count) if part not in held]
    inner = np.array([(place % free.shape[1], place // free.shape[1]) for place in more], np.intp).reshape(-1, 2)
    return np.concatenate([spots, inner])


@kernel
def _joined(spots: NDArray[np.float32], velocity: NDArray[np.float32], free: Mask) -> NDArray[np.int32]:
    n = len(spots)
    parent = np.arange(n).astype(np.int32)
    for i in range(n):
        for j in range(i):
            dx, dy = spots[i, 0] - spots[j, 0], spots[i, 1] - spots[j, 1]
            apart = np.sqrt(dx * dx + dy * dy)
            if apart > REACH_PX:
                continue
            difference = np.float32(0.0)
            for c in range(velocity.shape[1]):
                difference = max(difference, abs(velocity[i, c] - velocity[j, c]))
            if difference > SLACK_PX + STRETCH * apart:
                continue
            steps = int(apart) + 1
            clear = True
            for s in range(steps):
                px, py = int(spots[j, 0] + dx * s / steps + 0.5), int(spots[j, 1] + dy * s / steps + 0.5)
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


def _within(edges: Edges, free: Mask) -> Edges:
    """Edges between free pixels only."""
    right, down = edges
    return np.where(free[:, 1:] & free[:, :-1], right, 0), np.where(free[1:] & free[:-1], down, 0)
