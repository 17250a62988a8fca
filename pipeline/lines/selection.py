"""Which curves are drawn: those with enough ink that stands out of the texture around them, or that were drawn before.

The ink of a curve is the sum, over its points, of the response above the threshold: a short line is drawn if it is
strong, such as an eye, and a weak one if it is long. Texture is subtracted, since a draughtsman leaves it out: the
response of the lines around that have no common direction (a structure tensor), as in surround suppression
(grigorescu2003contour). Foliage and fur have much of it; parallel lines and single shapes have none.

Independent choices flicker: a response near the threshold switches a line on and off from frame to frame. A curve
appears only where the response is strong somewhere, and stays while it is weak. A point weaker than the texture counts
nothing, so that the outline of a textured object stays. Departure: this is not part of
zhang2011online.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Plane
from pipeline.kernels.jit import kernel
from pipeline.lines.linking import Curves
from pipeline.lines.pen import Ink
from pipeline.lines.ridges import Points


class SelectionParams(NamedTuple):
    """Constants of the choice of curves."""

    drawn: int = 40
    """Opacity above which a pixel counts as drawn in the previous frame."""
    known_share: float = 1 / 3
    """Factor on the least ink of a curve that was drawn before."""
    texture: np.float32 = np.float32(24)
    """Factor on the texture before it is subtracted."""
    least_length: float = 2 / 3
    """Least length of any curve, in `shortest_px`: a dark window, a leaf or the light in an iris has much response, but
    is a spot, not a line. Where lines are drawn thinner, as in small faces, they may be shorter in proportion."""
    importance_share: np.float32 = np.float32(0.9)
    """Factor of the least ink and of the texture where importance is 1, as on faces: an eye is a short curve, and the
    brow beside it would count as texture."""


SELECTION = SelectionParams()


class PastLines(NamedTuple):
    """The lines of the previous frame, and the motion since.

    Attributes:
        opacity: uint8 (h, w).
        flow: previous to current frame, float32 (h, w, 2), px.
    """

    opacity: Ink
    flow: Flow


def choose_curves(
    points: Points, curves: Curves, past: PastLines | None, thickness: Plane, strong: float, shortest_px: float
) -> Curves:  # fmt: skip
    """The curves that are drawn.

    Args:
        points: of all curves.
        past: None = a shot begins.
        thickness: float32 (h, w), width of the lines, 1 = usual; less in small faces.
        strong: gray levels above the threshold that a curve reaches somewhere, unless it was drawn before on more than
            a quarter of its points.
        shortest_px: smallest length of a curve that is `strong` along all of it; stronger ones may be shorter in
            proportion, and important ones, down to `SELECTION.least_length`.
    """
    shape = thickness.shape
    if past is None:
        past = PastLines(np.zeros(shape, np.uint8), np.zeros((*shape, 2), np.float32))
    side = max(round(shortest_px), 1)
    drawn = np.zeros(len(curves.starts) - 1, np.bool_)
    _choose(points, curves, past, _texture(points, curves, shape, side), side, strong, 2 * strong * shortest_px, drawn)
    drawn &= _lengths(points, curves, thickness) >= SELECTION.least_length * shortest_px
    sizes = np.diff(curves.starts)
    starts = np.concatenate([[0], np.cumsum(sizes[drawn])]).astype(np.int32)
    return Curves(curves.order[np.repeat(drawn, sizes)], starts)


def _lengths(points: Points, curves: Curves, thickness: Plane) -> NDArray[np.float64]:
    """Lengths of the curves, px, longer in proportion where lines are thinner: float64 (curves,)."""
    own = points[curves.order]
    steps = 1 / thickness[np.rint(own["y"]).astype(int), np.rint(own["x"]).astype(int)].astype(np.float64)
    return np.diff(np.concatenate([[0.0], np.cumsum(steps)])[curves.starts])


def _texture(points: Points, curves: Curves, shape: tuple[int, int], side: int) -> Plane:
    """Response above the threshold, without its part of a common direction, by cell of `side` px with its eight
    neighbours: float32 (rows, columns), gray levels per px."""
    tensors = np.zeros((shape[0] // side + 1, shape[1] // side + 1, 3), np.float32)
    _add_tensors(points, curves.order, side, tensors)
    total, even, odd = cv2.split(cv2.blur(tensors, (3, 3), borderType=cv2.BORDER_ISOLATED | cv2.BORDER_CONSTANT))
    return np.asarray((total - cv2.magnitude(even, odd)) / side**2, np.float32)


@kernel
def _add_tensors(points: Points, order: NDArray[np.int32], side: int, out: NDArray[np.float32]) -> None:
    """Add the excess of each point, times 1 and cosine and sine of twice its angle, to its cell."""
    for n in range(order.size):
        point = points[order[n]]
        excess = point["response"] - point["threshold"]
        x, y = point["along_x"], point["along_y"]
        cell = out[int(point["y"]) // side, int(point["x"]) // side]
        cell[0] += excess
        cell[1] += excess * (x * x - y * y)
        cell[2] += excess * (np.float32(2) * x * y)


@kernel
def _choose(
    points: Points, curves: Curves, past: PastLines, texture: Plane, side: int, strong: float, least: float,
    drawn: NDArray[np.bool_],
) -> None:  # fmt: skip
    one = np.float32(1)
    for k in range(drawn.size):
        count, ink, largest, before, common = curves.starts[k + 1] - curves.starts[k], 0.0, 0.0, 0, one
        for n in range(curves.starts[k], curves.starts[k + 1]):
            point = points[curves.order[n]]
            excess = point["response"] - point["threshold"]
            unimportant = one - SELECTION.importance_share * min(point["importance"], one)
            around = texture[int(point["y"]) // side, int(point["x"]) // side]
            ink += max(excess - SELECTION.texture * unimportant * around, np.float32(0))
            largest, common = max(largest, excess), min(common, unimportant)
            before += _was_drawn(point, past)
        known = 4 * before > count
        drawn[k] = (known or largest > strong) and ink >= least * common * (SELECTION.known_share if known else 1.0)


@kernel
def _was_drawn(point: np.void, past: PastLines) -> bool:
    height, width = past.opacity.shape
    x, y = int(np.rint(point["x"])), int(np.rint(point["y"]))
    i = min(max(x - int(np.rint(past.flow[y, x, 0])), 0), width - 1)
    j = min(max(y - int(np.rint(past.flow[y, x, 1])), 0), height - 1)
    return bool(past.opacity[j, i] > SELECTION.drawn)
