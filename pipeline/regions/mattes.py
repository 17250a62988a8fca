"""Alpha mattes of label maps at the full size of a frame.

Label maps are computed at a reduced size. A guided filter with the frame as guide moves their borders to the colour
edges of the frame. Its coefficients are computed at the reduced size and applied to the full-size frame, so a matte
has full-size detail at little cost.

Source: he2013guided, equations 14 to 16; he2015fast (coefficients at reduced size).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Labels, Mask, Plane
from pipeline.kernels.jit import kernel

RADIUS = 4
"""Radius of the filter's window, px of the label map: its borders are at most this far from the colour edge."""
EPSILON = 120.0
"""Variance of colour, squared gray levels, below which a place has no edge that a border could move to."""
BAND = 6
"""Distance from a label's border, px of the label map, beyond which its matte is exactly 0 or 1."""
MARGIN = BAND + 2 * RADIUS + 2
"""A matte is computed this far around its label, px of the label map: both windows of the filter reach that far."""

Box = tuple[slice, slice]
"""Rows and columns."""
AxisSamples = tuple[NDArray[np.int32], NDArray[np.float32]]
"""Positions on an axis, for linear interpolation: the pixel before each position, and the distance from it, 0..1 px."""


@dataclass(frozen=True)
class LabelMattes:
    """Mattes of the labels of one frame.

    Attributes:
        labels: int32 (h', w'), at a reduced size.
        frame: uint8 (h, w, 3), at full size.
    """

    labels: Labels
    frame: Frame

    @cached_property
    def _guide(self) -> NDArray[np.float32]:
        """The frame at the size of the labels: float32 (h', w', 3)."""
        height, width = self.labels.shape
        if self.frame.shape[:2] == (height, width):
            return self.frame.astype(np.float32)
        return np.asarray(cv2.resize(self.frame, (width, height), interpolation=cv2.INTER_AREA)).astype(np.float32)

    @cached_property
    def _mean(self) -> NDArray[np.float32]:
        return _box_mean(self._guide)

    @cached_property
    def _inverse(self) -> NDArray[np.float32]:
        """Inverse of the local covariance of colours plus EPSILON: float32 (h', w', 6), see `_invert`."""
        products = np.empty((6, *self.labels.shape), np.float32)
        _products(self._guide, products)
        for plane in products:
            plane[:] = _box_mean(plane)
        out = np.empty((*self.labels.shape, 6), np.float32)
        _invert(products, self._mean, out)
        return out

    @cached_property
    def _extents(self) -> dict[int, tuple[int, int, int, int]]:
        """First row, first column, last row and last column of each label, px of the label map; ascending labels."""
        bounds = np.tile(np.array([*self.labels.shape, -1, -1], np.int32), (int(self.labels.max(initial=0)) + 1, 1))
        _bound(self.labels, bounds)
        return {label: (a, b, c, d) for label, (a, b, c, d) in enumerate(bounds.tolist()) if c >= 0}

    def box(self, label: int) -> Box:
        """Rows and columns of the full-size frame outside which the label's matte is 0."""
        if label not in self._extents:
            return slice(0, 0), slice(0, 0)
        first, last = self._extents[label][:2], self._extents[label][2:]
        sides = []
        for axis in range(2):
            most = self.frame.shape[axis]
            ratio = most / self.labels.shape[axis]
            low, high = (first[axis] - BAND) * ratio, (last[axis] + 1 + BAND) * ratio
            sides.append(slice(max(int(low), 0), min(int(np.ceil(high)), most)))
        return sides[0], sides[1]

    def alpha(self, label: int, box: Box) -> Plane:
        """Matte of a label in a box of the frame: float32 (h, w), 0..1.

        Two adjacent labels sum to 1, since the filter is linear and the contrast curve is symmetric.
        """
        rows, columns = (
            slice(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(self.box(label), box, strict=True)
        )
        out = np.zeros((box[0].stop - box[0].start, box[1].stop - box[1].start), np.float32)
        if rows.start < rows.stop and columns.start < columns.stop:
            own = self._evaluated(label, rows, columns)
            top, left = rows.start - box[0].start, columns.start - box[1].start
            out[top : top + own.shape[0], left : left + own.shape[1]] = own
        return out

    def _evaluated(self, label: int, rows: slice, columns: slice) -> Plane:
        """Matte of a label in rows and columns of the frame where it may be above 0."""
        coefficients, near, (top, left) = self._model(label)
        out = np.ones((rows.stop - rows.start, columns.stop - columns.start), np.float32)
        if near.any():
            at = (
                _axis_samples(rows, self.frame.shape[0], self.labels.shape[0], top),
                _axis_samples(columns, self.frame.shape[1], self.labels.shape[1], left),
            )
            _apply(coefficients, near, at, np.ascontiguousarray(self.frame[rows, columns]), out)
        return out

    def _model(self, label: int) -> tuple[NDArray[np.float32], Mask, tuple[int, int]]:
        """Linear model of a label's matte by colour, in the part of the label map where the matte is not 0.

        Returns:
            float32 (h, w, 4), factors of red, green and blue, and the constant; bool (h, w), pixels near a border of
            the label, outside which only the constant counts; and the first row and column of the part.
        """
        top, left, bottom, right = self._extents[label]
        rows = slice(max(top - MARGIN, 0), bottom + 1 + MARGIN)
        columns = slice(max(left - MARGIN, 0), right + 1 + MARGIN)
        corner = rows.start, columns.start
        mask = (self.labels[rows, columns] == label).astype(np.float32)
        near = _near_border(mask)
        masked, model = np.empty((*mask.shape, 3), np.float32), np.empty((*mask.shape, 4), np.float32)
        _multiply(self._guide, mask, corner, masked)
        _fit(self._inverse, self._mean, corner, _box_mean(mask), _box_mean(masked), model)
        coefficients = _box_mean(model)
        _clear(coefficients, near, mask)
        return coefficients, near, corner

    @cached_property
    def _mattes(self) -> tuple[dict[int, tuple[Box, Plane]], Plane]:
        """Matte of each label in its box of the frame, and their sum, at least 0.001."""
        alphas: dict[int, tuple[Box, Plane]] = {}
        total = np.zeros(self.frame.shape[:2], np.float32)
        for label in self._extents:
            box = self.box(label)
            alphas[label] = box, self._evaluated(label, *box)
            total[box] += alphas[label][1]
        return alphas, np.maximum(total, np.float32(1e-3), out=total)

    def normalized(self, label: int, box: Box | None = None) -> Plane:
        """Matte of a label in a box of the frame, float32 (h, w), 0..1, scaled so that the mattes of all labels sum to
        1 at every pixel.

        0 everywhere if the frame does not have the label.

        Args:
            box: None = the whole frame.
        """
        rows, columns = box or (slice(0, self.frame.shape[0]), slice(0, self.frame.shape[1]))
        alphas, total = self._mattes
        out = np.zeros((rows.stop - rows.start, columns.stop - columns.start), np.float32)
        if label in alphas:
            (own_rows, own_columns), alpha = alphas[label]
            _divide(alpha, (own_rows.start, own_columns.start), total, (rows.start, columns.start), out)
        return out

    def full(self) -> Labels:
        """Label map at the frame's size, int32: the label with the largest matte at each pixel, without specks."""
        best = np.zeros(self.frame.shape[:2], np.float32)
        out = np.zeros(best.shape, np.int32)
        for label in self._extents:
            box = self.box(label)
            alpha = self._evaluated(label, *box)
            better = alpha > best[box]
            best[box][better] = alpha[better]
            out[box][better] = label
        return np.asarray(cv2.medianBlur(out.astype(np.uint16), 5), np.int32)


def _box_mean(plane: NDArray[np.float32]) -> NDArray[np.float32]:
    side = 2 * RADIUS + 1
    return np.asarray(cv2.boxFilter(plane, -1, (side, side), borderType=cv2.BORDER_REFLECT_101), np.float32)


def _near_border(mask: Plane) -> NDArray[np.bool_]:
    """Pixels within BAND of a border of the mask."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * BAND + 1, 2 * BAND + 1))
    own = mask.astype(np.uint8)
    return np.asarray(cv2.dilate(own, disc) != cv2.erode(own, disc), np.bool_)


@kernel
def _bound(labels: Labels, bounds: NDArray[np.int32]) -> None:
    for y in range(labels.shape[0]):
        for x in range(labels.shape[1]):
            own = bounds[labels[y, x]]
            own[0], own[1] = min(own[0], y), min(own[1], x)
            own[2], own[3] = max(own[2], y), max(own[3], x)


@kernel
def _products(guide: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    """Products of two colours each: red with red, green and blue; green with green and blue; blue with blue."""
    for y in range(guide.shape[0]):
        for x in range(guide.shape[1]):
            red, green, blue = guide[y, x, 0], guide[y, x, 1], guide[y, x, 2]
            out[0, y, x], out[1, y, x], out[2, y, x] = red * red, red * green, red * blue
            out[3, y, x], out[4, y, x], out[5, y, x] = green * green, green * blue, blue * blue


@kernel
def _invert(products: NDArray[np.float32], mean: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    """Inverse of the symmetric covariance plus EPSILON, by cofactors: the six elements of its upper triangle, by row.

    Args:
        products: local means of the products of colours, see `_products`.
        mean: local means of the colours.
    """
    epsilon = np.float32(EPSILON)
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            red, green, blue = mean[y, x, 0], mean[y, x, 1], mean[y, x, 2]
            rr, gg = products[0, y, x] - red * red + epsilon, products[3, y, x] - green * green + epsilon
            bb = products[5, y, x] - blue * blue + epsilon
            rg, rb = products[1, y, x] - red * green, products[2, y, x] - red * blue
            gb = products[4, y, x] - green * blue
            a, b, c = gg * bb - gb * gb, rb * gb - rg * bb, rg * gb - rb * gg
            scale = np.float32(1.0) / (rr * a + rg * b + rb * c)
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = a * scale, b * scale, c * scale
            out[y, x, 3] = (rr * bb - rb * rb) * scale
            out[y, x, 4] = (rg * rb - rr * gb) * scale
            out[y, x, 5] = (rr * gg - rg * rg) * scale


@kernel
def _multiply(guide: NDArray[np.float32], mask: Plane, corner: tuple[int, int], out: NDArray[np.float32]) -> None:
    """Colours of the guide's part at `corner` (row and column) times mask."""
    top, left = corner
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            for c in range(3):
                out[y, x, c] = guide[top + y, left + x, c] * mask[y, x]


@kernel
def _fit(
    inverse: NDArray[np.float32], guide: NDArray[np.float32], corner: tuple[int, int], mask: Plane,
    masked: NDArray[np.float32], out: NDArray[np.float32],
) -> None:  # fmt: skip
    """Factors of the colours and the constant, from the local means of the guide, the mask and their product."""
    top, left = corner
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            mean, own = mask[y, x], inverse[top + y, left + x]
            red, green, blue = guide[top + y, left + x, 0], guide[top + y, left + x, 1], guide[top + y, left + x, 2]
            with_red, with_green = masked[y, x, 0] - red * mean, masked[y, x, 1] - green * mean
            with_blue = masked[y, x, 2] - blue * mean
            by_red = own[0] * with_red + own[1] * with_green + own[2] * with_blue
            by_green = own[1] * with_red + own[3] * with_green + own[4] * with_blue
            by_blue = own[2] * with_red + own[4] * with_green + own[5] * with_blue
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = by_red, by_green, by_blue
            out[y, x, 3] = mean - (by_red * red + by_green * green + by_blue * blue)


@kernel
def _clear(coefficients: NDArray[np.float32], near: Mask, mask: Plane) -> None:
    """Replace the model by the mask where no border is near, in place."""
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if not near[y, x]:
                coefficients[y, x, 0] = coefficients[y, x, 1] = coefficients[y, x, 2] = 0
                coefficients[y, x, 3] = mask[y, x]


@kernel
def _divide(alpha: Plane, at: tuple[int, int], total: Plane, corner: tuple[int, int], out: Plane) -> None:
    """`alpha` over `total` in the part of the frame at `corner` (row and column) that `out` covers.

    Args:
        at: row and column of the frame at which `alpha` begins.
    """
    down, across = at[0] - corner[0], at[1] - corner[1]
    for y in range(max(-down, 0), min(alpha.shape[0], out.shape[0] - down)):
        for x in range(max(-across, 0), min(alpha.shape[1], out.shape[1] - across)):
            out[y + down, x + across] = alpha[y, x] / total[y + at[0], x + at[1]]


def _axis_samples(span: slice, length: int, small: int, start: int) -> AxisSamples:
    """Positions, on an axis reduced from `length` to `small` px, of the full-size pixels in `span`, from `start` on."""
    at = (np.arange(span.start, span.stop, dtype=np.float32) + np.float32(0.5)) * np.float32(small / length)
    at = np.clip(at - np.float32(0.5), 0, small - 1)
    first = np.minimum(at.astype(np.int32), max(small - 2, 0)).astype(np.int32)
    return first - np.int32(start), (at - first).astype(np.float32)


@kernel
def _apply(
    coefficients: NDArray[np.float32], near: Mask, samples: tuple[AxisSamples, AxisSamples], frame: Frame, out: Plane
) -> None:
    """Evaluate the linear model, interpolated bilinearly, and increase its contrast: a^3 / (a^3 + (1 - a)^3).

    Where none of the four pixels of the model is `near` a border, the matte is the constant of the model.

    Args:
        samples: rows and columns of the model at each row and column of `frame`.
    """
    one, zero = np.float32(1.0), np.float32(0.0)
    (rows, row_distances), (columns, column_distances) = samples
    height, width = near.shape
    for y in range(out.shape[0]):
        top, down = rows[y], row_distances[y]
        bottom = min(top + 1, height - 1)
        for x in range(out.shape[1]):
            left, across = columns[x], column_distances[x]
            right = min(left + 1, width - 1)
            if not (near[top, left] or near[top, right] or near[bottom, left] or near[bottom, right]):
                out[y, x] = coefficients[top, left, 3]
                continue
            value = zero
            for k in range(4):
                above, below = coefficients[top, left, k], coefficients[bottom, left, k]
                above += across * (coefficients[top, right, k] - above)
                below += across * (coefficients[bottom, right, k] - below)
                factor = above + down * (below - above)
                value += factor * np.float32(frame[y, x, k]) if k < 3 else factor
            value = min(max(value, zero), one)
            complement = one - value
            cube, other = value * value * value, complement * complement * complement
            out[y, x] = cube / (cube + other)
