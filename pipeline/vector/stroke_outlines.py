"""The strokes of a pen as closed outlines."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.vector.outlines import Outlines

FAINTEST = 0.02
"""Least opacity of a stroke that has an outline."""


class StrokeOutlines(NamedTuple):
    """Outlines of strokes.

    Attributes:
        arcs: one closed arc around each stroke, of degree 1.
        opacities: float64 (strokes,), 0..1, mean opacity of each.
    """

    arcs: Outlines
    opacities: NDArray[np.float64]


def stroke_outlines(
    places: NDArray[np.float32], half_widths: NDArray[np.float32], opacities: NDArray[np.float32],
    starts: NDArray[np.int32],
) -> StrokeOutlines:  # fmt: skip
    """The outlines of strokes; those fainter than `FAINTEST` are left out.

    Args:
        places: float32 (m, 2), x and y of the points of all strokes, px.
        half_widths, opacities: float32 (m,), px and 0..1.
        starts: int32 (strokes + 1,): stroke i has the points starts[i]..starts[i + 1] - 1, two at least.
    """
    arcs, means = [np.empty((0, 2))], []
    for begin, end in pairwise(starts.tolist()):
        mean = float(opacities[begin:end].mean())
        if mean >= FAINTEST:
            arcs.append(_outline(places[begin:end], half_widths[begin:end]))
            means.append(mean)
    ends = np.cumsum([len(arc) for arc in arcs])
    none = np.zeros(len(means), np.int32)
    return StrokeOutlines(Outlines(np.concatenate(arcs), ends, none, none, none > 0), np.array(means))


def _outline(places: NDArray[np.float32], half_widths: NDArray[np.float32]) -> NDArray[np.float64]:
    """The left side of a stroke, its right side backwards, and the first point again: float64 (2 n + 3, 2).

    The strokes' round ends are points: a line that tapers is pointed there, and one that does not lies on another.
    """
    points = places.astype(np.float64)
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.hypot(*along.T), 1e-6)[:, None]
    across = half_widths[:, None] * np.column_stack([-along[:, 1], along[:, 0]])
    first, last = points[:1] - half_widths[0] * along[:1], points[-1:] + half_widths[-1] * along[-1:]
    return np.concatenate([first, points + across, last, (points - across)[::-1], first])
