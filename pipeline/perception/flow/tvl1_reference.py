"""Operations of TV-L1 in NumPy: the specification of the kernels in `tvl1.cl`.

Planes are stacked: an image pair is float32 (2, h, w); a flow (2, h, w), dx before dy; gradients and dual fields
(4, h, w), x and y of the first plane before x and y of the second. Border pixels are replicated outside the picture.
All operations use float32 in the order of the kernels, so that results agree to the last bit.
"""

from __future__ import annotations

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow
from pipeline.perception.flow.gray import Gray
from pipeline.perception.flow.tvl1_params import TvL1

Planes: TypeAlias = NDArray[np.floating]
"""float32. The annotation is wider because NumPy's stubs infer float64 for a product with a Python float."""

ROF_THETA = np.float32(0.125 * 127.5)
"""Strength of the ROF denoising, gray levels: the 1/8 of wedel2009improved, which is for brightness in -1..1."""
ROF_RATIO = np.float32(0.25 / (0.125 * 127.5))
"""Ratio of the time step to the strength of the ROF denoising."""


class Reference:
    """The operations of `tvl1.solve` on arrays."""

    def load(self, previous: Gray, current: Gray) -> Planes:
        return np.stack([previous, current]).astype(np.float32)

    def size(self, planes: Planes) -> tuple[int, int]:
        return planes.shape[1], planes.shape[2]

    def zeros(self, planes: int, size: tuple[int, int]) -> Planes:
        return np.zeros((planes, *size), np.float32)

    def fetch(self, flow: Planes) -> Flow:
        return np.ascontiguousarray(flow.transpose(1, 2, 0))

    def texture(self, pair: Planes, params: TvL1) -> Planes:
        """Subtract `texture_share` of the ROF-denoised picture, which removes shading (wedel2009improved, section
        2)."""
        if not params.texture_iterations:
            return pair
        dual = self.zeros(4, self.size(pair))
        for _ in range(params.texture_iterations):
            dual = _rof(pair, dual)
        out: Planes = pair - np.float32(params.texture_share) * (pair + ROF_THETA * _divergence(dual))
        return out

    def down(self, pair: Planes) -> Planes:
        """Halve the size, rounded up: binomial filter 1 4 6 4 1 at the even pixels."""
        return _halve(_halve(pair, axis=2), axis=1)

    def up(self, flow: Planes, size: tuple[int, int]) -> Planes:
        """Double the size bilinearly, and the displacements."""
        y, x = np.arange(size[0]), np.arange(size[1])
        y1 = np.minimum((y + 1) // 2, flow.shape[1] - 1)
        x1 = np.minimum((x + 1) // 2, flow.shape[2] - 1)
        above, under = flow[:, y // 2], flow[:, y1]
        out: Planes = 0.5 * ((above[:, :, x // 2] + above[:, :, x1]) + (under[:, :, x // 2] + under[:, :, x1]))
        return out

    def gradient(self, pair: Planes) -> Planes:
        """Central differences of fourth order."""
        slopes = [_central(plane, axis) for plane in pair for axis in (1, 0)]
        return np.stack(slopes)

    def linearise(self, pair: Planes, slope: Planes, flow: Planes) -> Planes:
        """Linearise the data term around `flow`: (3, h, w), gradient and constant part; 0 where the flow leaves the
        picture."""
        h, w = self.size(pair)
        x = np.arange(w, dtype=np.float32) + flow[0]
        y = np.arange(h, dtype=np.float32)[:, None] + flow[1]
        inside = ((x >= 0) & (x <= w - 1) & (y >= 0) & (y <= h - 1)).astype(np.float32)
        value, dx, dy = _cubic_samples([pair[1], slope[2], slope[3]], x, y)
        gx, gy = 0.5 * (slope[0] + dx) * inside, 0.5 * (slope[1] + dy) * inside
        return np.stack([gx, gy, (value - pair[0]) * inside - gx * flow[0] - gy * flow[1]])

    def iterate(self, data: Planes, flow: Planes, dual: Planes, params: TvL1) -> tuple[Planes, Planes]:
        """Alternate the thresholding step (eq. 15), the divergence, and the dual step (eq. 9 to 11) of the paper."""
        theta = np.float32(params.tightness)
        bound = np.float32(params.attachment * params.tightness)
        ratio = np.float32(params.time_step / params.tightness)
        gradient, constant = data[:2], data[2]
        square = np.maximum(gradient[0] * gradient[0] + gradient[1] * gradient[1], 1e-9)
        for _ in range(params.iterations):
            rho = constant + gradient[0] * flow[0] + gradient[1] * flow[1]
            step = np.clip(-rho / square, -bound, bound)
            flow = flow + step * gradient + theta * _divergence(dual)
            dual = _dual(flow, dual, ratio)
        return flow, dual

    def median(self, flow: Planes) -> Planes:
        """Median over 5 x 5 px of each component."""
        return np.stack([cv2.medianBlur(plane, 5) for plane in flow])


def _divergence(dual: Planes) -> Planes:
    """Backward differences of each vector field, zero outside: (2n, h, w) -> (n, h, w)."""
    along_x, along_y = dual[0::2].copy(), dual[1::2].copy()
    along_x[:, :, 1:] -= dual[0::2, :, :-1]
    along_y[:, 1:] -= dual[1::2, :-1]
    return along_x + along_y


def _forward(planes: Planes) -> tuple[Planes, Planes]:
    """Forward differences along x and y, zero at the last column and row."""
    along_x, along_y = np.zeros_like(planes), np.zeros_like(planes)
    along_x[:, :, :-1] = planes[:, :, 1:] - planes[:, :, :-1]
    along_y[:, :-1] = planes[:, 1:] - planes[:, :-1]
    return along_x, along_y


def _rof(pair: Planes, dual: Planes) -> Planes:
    along_x, along_y = _forward(pair + ROF_THETA * _divergence(dual))
    x, y = dual[0::2] + ROF_RATIO * along_x, dual[1::2] + ROF_RATIO * along_y
    norm = np.maximum(1.0, np.sqrt(x * x + y * y))
    stepped = np.empty_like(dual)
    stepped[0::2], stepped[1::2] = x / norm, y / norm
    return stepped


def _dual(flow: Planes, dual: Planes, ratio: np.float32) -> Planes:
    along_x, along_y = _forward(flow)
    norm = 1.0 + ratio * np.sqrt(along_x * along_x + along_y * along_y)
    stepped = np.empty_like(dual)
    stepped[0::2] = (dual[0::2] + ratio * along_x) / norm
    stepped[1::2] = (dual[1::2] + ratio * along_y) / norm
    return stepped


def _near(count: int, shift: int) -> NDArray[np.intp]:
    return np.clip(np.arange(count) + shift, 0, count - 1)


def _halve(planes: Planes, axis: int) -> Planes:
    count = planes.shape[axis]
    even = np.arange(0, count, 2)
    total = np.zeros_like(planes.take(even, axis))
    for shift, weight in zip(range(-2, 3), (0.0625, 0.25, 0.375, 0.25, 0.0625), strict=True):
        total = total + weight * planes.take(np.clip(even + shift, 0, count - 1), axis)
    return total


def _central(plane: Planes, axis: int) -> Planes:
    n = plane.shape[axis]
    near = plane.take(_near(n, 1), axis) - plane.take(_near(n, -1), axis)
    far = plane.take(_near(n, 2), axis) - plane.take(_near(n, -2), axis)
    out: Planes = (8.0 * near - far) / 12.0
    return out


def _cubic_samples(planes: list[Planes], x: Planes, y: Planes) -> list[Planes]:
    """Sample planes at (x, y) by cubic convolution; positions are clamped to the picture."""
    h, w = planes[0].shape
    x, y = np.clip(x, 0, w - 1), np.clip(y, 0, h - 1)
    left, top = np.floor(x), np.floor(y)
    wx, wy = _cubic(x - left), _cubic(y - top)
    columns = [np.clip(left.astype(np.int32) + k, 0, w - 1) for k in range(-1, 3)]
    rows = [np.clip(top.astype(np.int32) + k, 0, h - 1) for k in range(-1, 3)]
    return [_blend([_blend([p[r, c] for c in columns], wx) for r in rows], wy) for p in planes]


def _cubic(t: Planes) -> list[Planes]:
    """Weights of four samples at a fraction t between the middle two (Catmull-Rom)."""
    before: Planes = t * (-0.5 + t * (1.0 - 0.5 * t))
    left: Planes = 1.0 + t * t * (1.5 * t - 2.5)
    right: Planes = t * (0.5 + t * (2.0 - 1.5 * t))
    after: Planes = t * t * (0.5 * t - 0.5)
    return [before, left, right, after]


def _blend(samples: list[Planes], weights: list[Planes]) -> Planes:
    a, b, c, d = weights
    out: Planes = a * samples[0] + b * samples[1] + c * samples[2] + d * samples[3]
    return out
