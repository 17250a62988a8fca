"""New clusters: what can be tracked and belongs to nothing yet, grouped by its motion.

Seeds are good corners, as the paper's in the first frame. Corners whose velocities differ little for their distance are
one thing: so a turning or growing object is one cluster. Each thing then spreads by random walk over the free pixels.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Labels, Mask, Plane
from pipeline.segmentation.components import components
from pipeline.segmentation.jit import kernel
from pipeline.segmentation.random_walk import Edges, probabilities

MOST_CORNERS = 300
MOST_GROUPS = 24
"""The largest ones: each costs the solution of a linear system."""
REACH_PX = 28.0
"""Corners further apart than this are only of one thing if others lie between."""
THICK_PX = 4.0
"""Of the innermost pixel from the border: thinner parts are the rims of moving things."""
SLACK_PX = 0.4
STRETCH = 0.06
"""Velocities of one thing differ by at most SLACK_PX + STRETCH * distance: what turns by 3 degrees a frame passes."""


def newcomers(
    labels: Labels, motion: list[tuple[Flow, Plane]], edges: Edges, small: Frame, least: float, smallest_px: int,
    first: int,
) -> Labels:  # fmt: skip
    """Labels `first`, `first` + 1, ... of new clusters, int32 (h, w), 0 elsewhere.

    Args:
        labels: what is clustered already.
        motion: flow and reliability to the neighbouring frames, one or two.
        edges: of the random walk.
        small: the frame's colours.
        least: R from which a link is reliable.
        smallest_px: area of the smallest cluster.
    """
    if not motion:
        return np.zeros(labels.shape, np.int32)
    sure = np.all([reliable >= least for _, reliable in motion], axis=0)
    free = _without_specks((labels == 0) & sure, smallest_px)
    if not free.any():
        return np.zeros(labels.shape, np.int32)
    spots = _corners(small, free)
    groups = _groups(spots, np.concatenate([flow for flow, _ in motion], axis=-1), free)
    seeds = np.zeros(labels.shape, np.int32)
    seeds[spots[:, 1], spots[:, 0]] = groups
    count = int(groups.max(initial=0))
    if count == 0:
        return seeds
    chances = probabilities(seeds, _within(edges, free), count, tolerance=1e-2)
    grown = np.where(free & (chances.max(axis=0) >= 0.5), chances.argmax(axis=0) + 1, 0).astype(np.int32)
    return _numbered(grown, smallest_px, first)


def _without_specks(mask: Mask, smallest_px: int) -> Mask:
    """Parts of the mask that are large enough, thin threads cut off."""
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    parts, areas = components(opened.astype(np.int32))
    depth = cv2.distanceTransform(opened, cv2.DIST_L2, 3)
    deepest = np.zeros(len(areas), np.float32)
    np.maximum.at(deepest, parts.ravel(), depth.ravel())
    return np.asarray((opened > 0) & (areas[parts] >= smallest_px) & (deepest[parts] >= THICK_PX))


def _corners(small: Frame, free: Mask) -> NDArray[np.intp]:
    """Good corners in the free part, (n, 2): (x, y); in a part without any, its innermost pixel."""
    gray = cv2.cvtColor(small, cv2.COLOR_RGB2GRAY)
    found = cv2.goodFeaturesToTrack(gray, MOST_CORNERS, 0.01, 5, mask=free.astype(np.uint8))
    spots = np.zeros((0, 2), np.intp) if found is None else found.reshape(-1, 2).astype(np.intp)
    depth = cv2.distanceTransform(free.astype(np.uint8), cv2.DIST_L2, 3)
    count, parts = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    held = np.unique(parts[spots[:, 1], spots[:, 0]])
    more = [np.argmax(np.where(parts == part, depth, -1)) for part in range(1, count) if part not in held]
    inner = np.array([(place % free.shape[1], place // free.shape[1]) for place in more], np.intp).reshape(-1, 2)
    return np.concatenate([spots, inner])


def _groups(spots: NDArray[np.intp], motion: NDArray[np.float32], free: Mask) -> NDArray[np.int32]:
    """Number of the thing that each corner is on, 1.. by size; 0 = one too many."""
    smooth = cv2.blur(np.where(free[..., None], motion, 0), (3, 3)).reshape(*free.shape, -1)
    share = cv2.blur(free.astype(np.float32), (3, 3))
    x, y = spots.T
    velocity = smooth[y, x] / np.maximum(share[y, x], np.float32(0.1))[:, None]
    roots = _joined(spots.astype(np.float32), velocity.astype(np.float32), free)
    names, counts = np.unique(roots, return_counts=True)
    order = names[np.lexsort((names, -counts))][:MOST_GROUPS]
    number = {name: place for place, name in enumerate(order.tolist(), start=1)}
    return np.array([number.get(root, 0) for root in roots.tolist()], np.int32)


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


def _numbered(grown: Labels, smallest_px: int, first: int) -> Labels:
    """Clusters that are large enough, numbered from `first`."""
    areas = np.bincount(grown.ravel())
    large = (areas >= smallest_px) & (np.arange(len(areas)) > 0)
    names = np.where(large, np.cumsum(large) + first - 1, 0)
    return names[grown].astype(np.int32)
