"""Conversion of frames to 4:2:0 pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.video.yuv import REC_601, REC_709, to_yuv420


def planes_of(frame: NDArray[np.uint8], shares: tuple[float, float]) -> list[NDArray[np.uint8]]:
    planes: Any = to_yuv420(frame, shares).planes  # Any: the stubs do not show that planes are buffers
    return [np.frombuffer(p, np.uint8).reshape(p.height, p.line_size)[:, : p.width] for p in planes]


def exact(rgb: NDArray[np.float64], shares: tuple[float, float]) -> list[NDArray[np.float64]]:
    """Luma and chroma of ITU-R BT.601 and BT.709, limited range."""
    red, blue = shares
    luma = red * rgb[..., 0] + (1 - red - blue) * rgb[..., 1] + blue * rgb[..., 2]
    u, v = (rgb[..., 2] - luma) / (2 - 2 * blue), (rgb[..., 0] - luma) / (2 - 2 * red)
    return [16 + 219 / 255 * luma, 128 + 224 / 255 * u, 128 + 224 / 255 * v]


@pytest.mark.parametrize("shares", [REC_601, REC_709])
@pytest.mark.parametrize("size", [(64, 48), (33, 17)])
def test_samples_are_rounded_values_of_the_standard(size: tuple[int, int], shares: tuple[float, float]) -> None:
    frame = np.random.default_rng(3).integers(0, 256, (size[1], size[0], 3), np.uint8)
    y, u, v = planes_of(frame, shares)
    even = np.pad(frame, ((0, size[1] % 2), (0, size[0] % 2), (0, 0)), "edge").astype(float)
    means = even.reshape(len(even) // 2, 2, -1, 2, 3).mean(axis=(1, 3))
    found = [y, u, v]
    wanted = [exact(frame.astype(float), shares)[0], *exact(means, shares)[1:]]
    for samples, values in zip(found, wanted, strict=True):
        assert samples.shape == values.shape
        assert np.abs(samples - values).max() < 0.52


def test_the_extremes_are_those_of_the_limited_range() -> None:
    corners = np.array([[r, g, b] for r in (0, 255) for g in (0, 255) for b in (0, 255)], np.uint8)
    frame = np.repeat(np.repeat(corners[None], 2, axis=0), 2, axis=1)
    y, u, v = planes_of(frame, REC_709)
    assert (y.min(), y.max()) == (16, 235)
    assert (u.min(), u.max(), v.min(), v.max()) == (16, 240, 16, 240)
