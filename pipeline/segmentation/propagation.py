"""Labels from frame to frame: zhang2011online, section 4.2."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Labels
from pipeline.segmentation.jit import kernel
from pipeline.segmentation.motion import FAR, RESIDUAL_STEPS

REMAINDER_UNIT = 64
"""Steps a pixel in a carried remainder (int8, so at most 2 px)."""


@kernel
def propagate(
    labels: Labels,
    flow: Flow,
    remainder: NDArray[np.int8],
    residual: NDArray[np.uint8],
    error_limit: float,
    shared_decay: float = 0.9,
) -> tuple[Labels, NDArray[np.int8]]:
    """Carry every label along the rounded flow; 0 where the paper keeps a target unlabelled.

    Args:
        labels: int32 (h, w) of the previous frame, > 0.
        flow: float32 (h, w, 2), px, previous to current frame.
        remainder: int8 (h, w, 2), what rounding left over so far, 1/64 px.
        residual: uint8 (h, w), CIELAB difference of each target pixel to its source, in quarter units.
        error_limit: T_f, CIELAB units: a target with a larger error stays unlabelled (paper: 5 to 20).
        shared_decay: factor a frame on the remainder, 0..1; 0 = the paper's plain rounding.

    Returns:
        Labels of the current frame, 0 = nothing arrived, or two labels met; and the remainder carried with them.

    Departure: rounding alone never moves a pan of 0.4 px a frame; the fraction left over is carried with the label,
    and decays so that flow noise does not add up to a step.
    """
    out = np.zeros_like(labels)
    carried = np.zeros_like(remainder)
    limit = int(min(error_limit * RESIDUAL_STEPS, FAR - 1.0))
    _propagate(labels, flow, remainder, residual, limit, np.float32(shared_decay), out, carried)
    return np.maximum(out, np.int32(0)), carried


@kernel
def _propagate(
    labels: Labels, flow: Flow, remainder: NDArray[np.int8], residual: NDArray[np.uint8],
    limit: int, decay: np.float32, out: Labels, carried: NDArray[np.int8],
) -> None:  # fmt: skip
    """Flat, unsigned indices and one store for both remainders: this is the loop that touches memory at random."""
    height, width = np.uint64(labels.shape[0]), np.uint64(labels.shape[1])
    there, known = out.reshape(out.size), residual.reshape(residual.size)
    pairs = carried.reshape(carried.size).view(np.int16)
    steps = np.empty(2 * labels.shape[1], np.int32)
    for y in range(labels.shape[0]):
        moves = flow[y].reshape(steps.size)
        _whole_steps(moves, remainder[y].reshape(steps.size), decay, steps)
        for x in range(labels.shape[1]):
            across, down = steps[2 * x], steps[2 * x + 1]
            if moves[2 * x] == 0.0 and moves[2 * x + 1] == 0.0:
                across, down = np.int32(0), np.int32(0)
            tx, ty = np.uint64(np.int64(x) + (across >> 8)), np.uint64(np.int64(y) + (down >> 8))
            if tx >= width or ty >= height:  # negative ones are huge
                continue
            target = ty * width + tx
            if known[target] > limit:
                continue
            if there[target] == 0:
                there[target] = labels[y, x]
                pairs[target] = np.int16((across & 255) | ((down & 255) << 8))
            elif there[target] != labels[y, x]:
                there[target] = -1  # two labels met: no third one may settle here


@kernel
def _whole_steps(
    moves: NDArray[np.float32], remainder: NDArray[np.int8], decay: np.float32, steps: NDArray[np.int32]
) -> None:  # fmt: skip
    """Rounded motion in px << 8, and in the low byte what rounding leaves over, 1/64 px. This loop vectorises."""
    for k in range(steps.size):
        move = moves[k] + np.float32(remainder[k]) * decay * np.float32(1 / REMAINDER_UNIT)
        nearest = move + np.float32(0.5)
        whole = np.int32(nearest)
        whole -= np.int32(np.float32(whole) > nearest)  # towards minus infinity
        steps[k] = (whole << 8) | (np.int32((move - np.float32(whole)) * np.float32(REMAINDER_UNIT)) & 255)


@kernel
def smooth_labels(labels: Labels) -> Labels:
    """The morphological filter: where 5 or more of the 8 neighbours agree on a label other than the pixel's own,

    an unlabelled pixel (0) takes it, and a labelled one becomes 0. The outermost pixels, which have fewer
    neighbours, stay as they are.
    """
    out = labels.copy()
    _morphological(labels, out)
    return out


@kernel
def _morphological(labels: Labels, out: Labels) -> None:
    height, width = labels.shape
    alike = np.empty(width, np.int32)
    for y in range(1, height - 1):
        own_row = labels[y, 1 : width - 1]
        alike[:] = 0
        for n in range(9):  # whole rows at a time: this vectorises
            row = labels[y - 1 + n // 3, n % 3 : n % 3 + width - 2]
            for x in range(width - 2):
                alike[x + 1] += np.int32(row[x] == own_row[x])
        for x in range(1, width - 1):
            if alike[x] > 4:  # itself and 4 neighbours: no other label can have 5
                continue
            own = labels[y, x]
            # Boyer and Moore's vote finds the only label that can have 5 of 8.
            leader, lead = own, 0
            for j in range(y - 1, y + 2):
                for i in range(x - 1, x + 2):
                    if j == y and i == x:
                        continue
                    if lead == 0:
                        leader, lead = labels[j, i], 1
                    elif labels[j, i] == leader:
                        lead += 1
                    else:
                        lead -= 1
            if leader == own:
                continue
            votes = 0
            for j in range(y - 1, y + 2):
                for i in range(x - 1, x + 2):
                    votes += labels[j, i] == leader
            if votes >= 5:
                out[y, x] = leader if own == 0 else 0
