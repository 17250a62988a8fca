"""Alpha mattes of label maps at the frame's full size.

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
from pipeline.jit import kernel

RADIUS = 4
"""Radius of the filter's window, px of the label map: its borders are at most this far from the colour edge."""
EPSILON = 120.0
"""Variance of colour, squared gray levels, below which a place has no edge that a border could move to."""
BAND = 6
"""Distance from a label's border, px of the label map, beyond which its matte is exactly 0 or 1."""

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

    @property
    def _size(self) -> tuple[int, int]:
        """(width, height) of the frame, px."""
        return self.frame.shape[1], self.frame.shape[0]

    @cached_property
    def _guide(self) -> NDArray[np.float32]:
        """The frame at the size of the labels: float32 (h', w', 3)."""
        size = self.labels.shape[1], self.labels.shape[0]
        small = self.frame if size == self._size else cv2.resize(self.frame, size, interpolation=cv2.INTER_AREA)
        return np.asarray(small).astype(np.float32)

    @cached_property
    def _mean(self) -> NDArray[np.float32]:
        return _box_mean(self._guide)

    @cached_property
    def _inverse(self) -> NDArray[np.float32]:
        """Inverse of the local covariance of colours plus EPSILON: float32 (h', w', 3, 3)."""
        guide, mean = self._guide, self._mean
        covariance = np.empty((*guide.shape[:2], 3, 3), np.float32)
        for i in range(3):
            for j in range(i, 3):
                covariance[..., i, j] = _box_mean(guide[..., i] * guide[..., j]) - mean[..., i] * mean[..., j]
                covariance[..., j, i] = covariance[..., i, j]
            covariance[..., i, i] += np.float32(EPSILON)
        out = np.empty_like(covariance)
        _invert(covariance, out)
        return out

    def box(self, label: int) -> Box:
        """Rows and columns of the full-size frame outside which the label's matte is 0."""
        rows, columns = (np.flatnonzero((self.labels == label).any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            return slice(0, 0), slice(0, 0)
        (width, height), (label_height, label_width) = self._size, self.labels.shape
        sides = []
        for found, ratio, most in ((rows, height / label_height, height), (columns, width / label_width, width)):
            low, high = (int(found[0]) - BAND) * ratio, (int(found[-1]) + 1 + BAND) * ratio
            sides.append(slice(max(int(low), 0), min(int(np.ceil(high)), most)))
        return sides[0], sides[1]

    def alpha(self, label: int, box: Box) -> Plane:
        """Matte of a label in a box of the frame: float32 (h, w), 0..1.

        Two adjacent labels sum to 1, since the filter is linear and the contrast curve is symmetric.
        """
        mask = (self.labels == label).astype(np.float32)
        near = _near_border(mask)
        shape = box[0].stop - box[0].start, box[1].stop - box[1].start
        if not near.any():
            return np.full(shape, mask.flat[0], np.float32)
        coefficients = self._coefficients(mask)
        coefficients[~near] = 0
        coefficients[..., 3][~near] = mask[~near]
        out = np.empty(shape, np.float32)
        rows = _axis_samples(box[0], self._size[1], mask.shape[0])
        columns = _axis_samples(box[1], self._size[0], mask.shape[1])
        _apply(coefficients, near, (rows, columns), np.ascontiguousarray(self.frame[box]), out)
        return out

    def _coefficients(self, mask: Plane) -> NDArray[np.float32]:
        """Linear model of the matte by colour: float32 (h', w', 4), factors of red, green, blue, and the constant."""
        masked = np.empty_like(self._guide)
        _multiply(self._guide, mask, masked)
        model = np.empty((*mask.shape, 4), np.float32)
        _fit(self._inverse, self._mean, _box_mean(mask), _box_mean(masked), model)
        return _box_mean(model)

    @cached_property
    def _planes(self) -> tuple[dict[int, Plane], Plane]:
        """Matte of each label at full size, and their sum, at least 0.001."""
        alphas: dict[int, Plane] = {}
        total = np.zeros(self.frame.shape[:2], np.float32)
        for label in np.unique(self.labels).tolist():
            box, plane = self.box(label), np.zeros(total.shape, np.float32)
            plane[box] = self.alpha(label, box)
            alphas[label] = plane
            total[box] += plane[box]
        return alphas, np.maximum(total, np.float32(1e-3))

    def normalized(self, label: int, box: Box = (slice(None), slice(None))) -> Plane:
        """Matte of a label in a box of the frame, float32 (h, w), 0..1, scaled so that the mattes of all labels sum to
        1 at every pixel.

        0 everywhere if the frame does not have the label.
        """
        alphas, total = self._planes
        found = alphas.get(label)
        if found is None:
            return np.zeros_like(total[box])
        return np.asarray(found[box] / total[box], np.float32)

    def full(self) -> Labels:
        """Label map at the frame's size, int32: the label with the largest matte at each pixel, without specks."""
        best = np.zeros(self.frame.shape[:2], np.float32)
        out = np.zeros(best.shape, np.int32)
        for label in np.unique(self.labels).tolist():
            box = self.box(label)
            alpha = self.alpha(label, box)
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
def _invert(matrices: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    """Inverse of symmetric 3 x 3 matrices, by cofactors."""
    for y in range(matrices.shape[0]):
        for x in range(matrices.shape[1]):
            m = matrices[y, x]
            a = m[1, 1] * m[2, 2] - m[1, 2] * m[1, 2]
            b = m[0, 2] * m[1, 2] - m[0, 1] * m[2, 2]
            c = m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]
            scale = np.float32(1.0) / (m[0, 0] * a + m[0, 1] * b + m[0, 2] * c)
            inverse = out[y, x]
            inverse[0, 0] = a * scale
            inverse[0, 1] = inverse[1, 0] = b * scale
            inverse[0, 2] = inverse[2, 0] = c * scale
            inverse[1, 1] = (m[0, 0] * m[2, 2] - m[0, 2] * m[0, 2]) * scale
            inverse[1, 2] = inverse[2, 1] = (m[0, 1] * m[0, 2] - m[0, 0] * m[1, 2]) * scale
            inverse[2, 2] = (m[0, 0] * m[1, 1] - m[0, 1] * m[0, 1]) * scale


@kernel
def _multiply(guide: NDArray[np.float32], mask: Plane, out: NDArray[np.float32]) -> None:
    """Colours times mask."""
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            for c in range(3):
                out[y, x, c] = guide[y, x, c] * mask[y, x]


@kernel
def _fit(
    inverse: NDArray[np.float32], guide: NDArray[np.float32], mask: Plane, masked: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:  # fmt: skip
    """Factors of the colours and the constant, from the local means of the guide, the mask and their product."""
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            mean = mask[y, x]
            red, green, blue = guide[y, x, 0], guide[y, x, 1], guide[y, x, 2]
            with_red, with_green = masked[y, x, 0] - red * mean, masked[y, x, 1] - green * mean
            with_blue = masked[y, x, 2] - blue * mean
            for c in range(3):
                out[y, x, c] = (
                    inverse[y, x, c, 0] * with_red + inverse[y, x, c, 1] * with_green + inverse[y, x, c, 2] * with_blue
                )
            out[y, x, 3] = mean - (out[y, x, 0] * red + out[y, x, 1] * green + out[y, x, 2] * blue)


def _axis_samples(span: slice, length: int, small: int) -> AxisSamples:
    """Positions, on an axis reduced from `length` to `small` px, of the full-size pixels in `span`."""
    at = (np.arange(span.start, span.stop, dtype=np.float32) + np.float32(0.5)) * np.float32(small / length)
    at = np.clip(at - np.float32(0.5), 0, small - 1)
    first = np.minimum(at.astype(np.int32), max(small - 2, 0)).astype(np.int32)
    return first, (at - first).astype(np.float32)


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
