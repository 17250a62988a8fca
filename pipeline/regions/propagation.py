"""Label propagation from frame to frame (zhang2011online, section 4.2)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.colour.lab8 import Lab8
from pipeline.frames import Flow, Labels
from pipeline.kernels.jit import kernel
from pipeline.kernels.nonzero import nonzero_positions
from pipeline.perception.backward_maps import is_still
from pipeline.perception.motion import FAR, RESIDUAL_STEPS
from pipeline.regions.regions import Means, colour_difference

CLOSED = np.int32(-1)
"""Mark of target pixels that stay unlabelled."""
BATCH = 512
"""Pixels that are processed together, so that the inner loops vectorise."""
SPAN = 64
"""Number of pixels of a row that are handled together; their labels are kept if none of them moves."""
CHANGED_SLACK = np.float32(0.5)
"""Factor on the growing limit for a pixel that has changed."""
REMAINDER_UNIT = 64
"""Steps per pixel of a stored remainder (int8, so at most 2 px)."""


class PreviousRegions(NamedTuple):
    """Regions of the previous frame, and the motion since; see `propagate`.

    Attributes:
        labels: int32 (h, w), 1..regions.
        means: float32 (regions + 1, 3), mean colours, 8-bit CIELAB.
        flow: float32 (h, w, 2), previous to current frame, px.
        remainder: int8 (h, w, 2), fractions of the motion that rounding left over.
        residual: uint8 (h, w), CIELAB difference of each pixel to its past, quarter units.
    """

    labels: Labels
    means: Means
    flow: Flow
    remainder: NDArray[np.int8]
    residual: NDArray[np.uint8]


class PropagationLimits(NamedTuple):
    """Limits of `propagate`, `release_changed` and `refinement.correct`.

    Attributes:
        error: T_f, largest difference of a pixel to its past, CIELAB units.
        margin: a boundary pixel changes region if the other one fits better by more than this, CIELAB units.
        slack: a pixel leaves its region beyond this multiple of the growing limit.
        changed: residual from which `release_changed` examines a pixel, CIELAB units.
    """

    error: float
    margin: float
    slack: float
    changed: float


@kernel
def propagate(
    labels: Labels,
    flow: Flow,
    remainder: NDArray[np.int8],
    residual: NDArray[np.uint8],
    error_limit: float,
    decay: float = 0.9,
) -> tuple[Labels, NDArray[np.int8]]:
    """Move every label along the rounded flow. Targets with a large error or with two different labels stay unlabelled.

    Args:
        labels: int32 (h, w) of the previous frame, > 0.
        flow: float32 (h, w, 2), px, previous to current frame.
        remainder: int8 (h, w, 2), accumulated rounding error of the motion of each label, 1/64 px.
        residual: uint8 (h, w), CIELAB difference of each target pixel to its source, quarter units.
        error_limit: T_f, CIELAB units: a target with a larger error stays unlabelled (paper: 5 to 20).
        decay: factor on the remainder per frame, 0..1; 0 = plain rounding, as in the paper.

    Returns:
        Labels of the current frame, int32 (h, w), 0 = unlabelled; and the remainders, moved with the labels.

    Departure: with rounding alone, labels do not follow a pan of 0.4 px per frame. The rounding error is therefore
    accumulated with the label. It decays, so that noise of the flow does not add up to a step.
    """
    moved = np.zeros_like(remainder)
    limit = int(min(error_limit * RESIDUAL_STEPS, FAR - 1.0))
    out = np.empty_like(labels)
    for y in range(labels.shape[0]):
        for x in range(labels.shape[1]):
            out[y, x] = CLOSED if residual[y, x] > limit else 0
    _propagate(labels, flow, remainder, np.float32(decay), out, moved)
    return np.maximum(out, np.int32(0)), moved


@kernel
def _propagate(
    labels: Labels, flow: Flow, remainder: NDArray[np.int8], decay: np.float32, out: Labels, moved: NDArray[np.int8]
) -> None:
    """Scatter the labels. `out`: 0 where a label may be written, else `CLOSED`.

    This loop has random memory access, so it uses flat unsigned indices and stores both remainders at once.
    """
    height, width = labels.shape
    there = out.reshape(out.size)
    pairs = moved.reshape(moved.size).view(np.int16)
    targets, fractions = np.empty(SPAN, np.int32), np.empty(SPAN, np.int32)
    for y in range(height):
        moves, left_over = flow[y].reshape(2 * width), remainder[y].reshape(2 * width)
        for start in range(0, width, SPAN):
            stop = min(start + SPAN, width)
            part, count = slice(2 * start, 2 * stop), stop - start
            if is_still(moves[part]):
                _keep_labels(labels[y, start:stop], there[y * width + start : y * width + stop])
                continue
            _find_targets(moves[part], left_over[part], decay, (start, y), labels.shape, targets, fractions)
            for k in range(count):
                if targets[k] < 0:
                    continue
                target, label = np.uint64(targets[k]), labels[y, start + k]
                if there[target] == 0:
                    there[target] = label
                    pairs[target] = np.int16(fractions[k])
                elif there[target] != label:
                    there[target] = CLOSED  # two different labels: the target stays unlabelled


@kernel
def _keep_labels(labels: NDArray[np.int32], out: NDArray[np.int32]) -> None:
    """Write labels that do not move, as the loop of `_propagate` does; their remainders are 0. This vectorises."""
    for k in range(labels.size):
        own, there = labels[k], out[k]
        out[k] = own if there == 0 or there == own else CLOSED


@kernel
def _find_targets(
    moves: NDArray[np.float32], remainder: NDArray[np.int8], decay: np.float32, corner: tuple[int, int],
    shape: tuple[int, int], targets: NDArray[np.int32], fractions: NDArray[np.int32],
) -> None:  # fmt: skip
    """Write the targets of a few pixels of a row, whose first one is at `corner` (x, y), as flat indices, -1 = outside
    the frame of that shape; and both rounding errors, 1/64 px, as two bytes. This loop vectorises."""
    (left, y), (height, width) = corner, shape
    step = decay * np.float32(1 / REMAINDER_UNIT)
    for k in range(moves.size // 2):
        across, down = moves[2 * k], moves[2 * k + 1]
        still = (across == 0.0) & (down == 0.0)
        across += np.float32(remainder[2 * k]) * step
        down += np.float32(remainder[2 * k + 1]) * step
        whole_x, whole_y = _rounded(across), _rounded(down)
        rest_x = np.int32((across - np.float32(whole_x)) * np.float32(REMAINDER_UNIT)) & np.int32(255)
        rest_y = np.int32((down - np.float32(whole_y)) * np.float32(REMAINDER_UNIT)) & np.int32(255)
        x = np.int32(left + k) + (np.int32(0) if still else whole_x)
        row = np.int32(y) + (np.int32(0) if still else whole_y)
        inside = (x >= 0) & (x < width) & (row >= 0) & (row < height)
        targets[k] = row * np.int32(width) + x if inside else np.int32(-1)
        fractions[k] = np.int32(0) if still else rest_x | (rest_y << np.int32(8))


@kernel
def _rounded(value: np.float32) -> np.int32:
    """The nearest integer, halves upwards."""
    nearest = value + np.float32(0.5)
    whole = np.int32(nearest)
    return whole - np.int32(np.float32(whole) > nearest)  # towards minus infinity


@kernel
def smooth_labels(labels: Labels) -> Labels:
    """Morphological filter: int32 (h, w).

    Where at least 5 of the 8 neighbours have the same label, and the pixel has another one, an unlabelled pixel takes
    that label and a labelled pixel becomes unlabelled. Pixels of the frame's border are unchanged.
    """
    out = labels.copy()
    _morphological(labels, out)
    return out


@kernel
def _morphological(labels: Labels, out: Labels) -> None:
    height, width = labels.shape
    apart = np.zeros(width, np.uint8)
    places = np.empty(BATCH + width, np.int32)
    few = 0
    for y in range(1, height - 1):
        over, row, under = labels[y - 1], labels[y], labels[y + 1]
        for x in range(width - 2):  # a whole row at a time: this vectorises
            own = row[x + 1]
            above = np.int32(over[x] == own) + np.int32(over[x + 1] == own) + np.int32(over[x + 2] == own)
            below = np.int32(under[x] == own) + np.int32(under[x + 1] == own) + np.int32(under[x + 2] == own)
            alike = above + below + np.int32(row[x] == own) + np.int32(row[x + 2] == own)
            apart[x] = np.uint8(alike <= 3)  # otherwise no other label can have 5 of 8
        few = nonzero_positions(apart, places, y * width + 1, few)
        if few >= BATCH or y == height - 2:
            _filter_places(labels, places[:few], out)
            few = 0


@kernel
def _filter_places(labels: Labels, places: NDArray[np.int32], out: Labels) -> None:
    """Apply the filter at these places. A label with 5 of 8 neighbours is among any 4 of them, which are the
    candidates."""
    width = labels.shape[1]
    there, made = labels.reshape(labels.size), out.reshape(out.size)
    around = np.empty((8, places.size), np.int32)
    for n in range(8):
        m = n + (n > 3)
        step = (m // 3 - 1) * width + m % 3 - 1
        for k in range(places.size):
            around[n, k] = there[np.uint64(places[k] + step)]  # Numba would test a signed index for its sign
    a, b, c, d, e, f, g, h = around[0], around[1], around[2], around[3], around[4], around[5], around[6], around[7]
    leader = np.full(places.size, np.int32(-1))
    for candidate in range(4):
        proposed = around[candidate]
        for k in range(places.size):
            own = proposed[k]
            above = np.int32(a[k] == own) + np.int32(b[k] == own) + np.int32(c[k] == own) + np.int32(d[k] == own)
            below = np.int32(e[k] == own) + np.int32(f[k] == own) + np.int32(g[k] == own) + np.int32(h[k] == own)
            leader[k] = own if above + below >= 5 else leader[k]
    for k in range(places.size):
        own = there[places[k]]
        if leader[k] >= 0 and leader[k] != own:
            made[places[k]] = leader[k] if own == 0 else 0


@kernel
def release_changed(
    labels: Labels, lab: Lab8, limit: NDArray[np.uint8], previous: PreviousRegions, limits: PropagationLimits
) -> None:
    """Release, in place, the pixels that have changed and do not fit the region as it was in the previous frame.

    Where a fast object uncovers a ground of a similar colour, flow and residual do not show that its label is wrong,
    and the object's region would take the colour of the ground. A pixel whose residual is at least `limits.changed` is
    released (label 0) if it differs from the previous mean of its region by more than `CHANGED_SLACK` times the growing
    limit.

    Args:
        labels: int32 (h, w), propagated labels, 0 = unlabelled.
        limit: uint8 (h, w), growing limit, CIELAB units.
    """
    there, colours, most = labels.reshape(labels.size), lab.reshape(labels.size, 3), limit.reshape(limit.size)
    changed = np.float32(limits.changed * RESIDUAL_STEPS)
    height, width = labels.shape
    flags, places = np.empty(width, np.uint8), np.empty(width, np.int32)
    for y in range(height):
        residual = previous.residual[y]
        for x in range(width):  # this vectorises
            flags[x] = np.uint8(residual[x] >= changed)
        for at in places[: nonzero_positions(flags, places, y * width)]:
            if there[at] == 0:
                continue
            error = colour_difference(colours, at, previous.means, there[at])
            if error > CHANGED_SLACK * most[at]:
                there[at] = 0
