"""Flow-based difference of Gaussians, which favours long lines over specks (kang2007coherent)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.compute import Device, DeviceArray
from pipeline.errors import BadParameter
from pipeline.frames import Flow, Plane
from pipeline.lines.dog import GAUSSIAN_RATIO

_SOURCE = Path(__file__).with_suffix(".cl")
_Floats: TypeAlias = NDArray[np.float32]
"""float32 arrays."""

REACH = 2.5
"""Radius at which Gaussians are truncated, in standard deviations."""


def fdog_response(
    gray: Plane, tangent: Flow, sigma_px: float, tau: float, sigma_along_px: float,
    device: Device | None = None, iterations: int = 1,
) -> Plane:  # fmt: skip
    """Difference of Gaussians across the edge, averaged along it: float32 (h, w), gray levels, positive on the dark
    side.

    The response to a straight edge equals that of `dog.dog_response`, so the same thresholds can be used. At a sharp
    slanting edge it is up to a sixth lower, since bilinear sampling blurs.

    Args:
        gray: float32 (h, w), gray levels.
        tangent: float32 (h, w, 2), unit vectors along the structure or (0, 0), from `tangent_field`.
        sigma_px: standard deviation of the narrower Gaussian across the edge, > 0.
        tau: weight of the wider Gaussian (1.6 sigma), 0..1.
        sigma_along_px: standard deviation of the Gaussian along the streamline, >= 0; 0 = no averaging.
        device: device of the kernels; None = the NumPy reference, which is many times slower. The result is the same
            on devices with correctly rounded divisions, such as the CPU runtimes.
        iterations: >= 1. Each further iteration first draws the lines found so far into the picture, which closes
            gaps.

    Raises:
        BadParameter: fewer than one iteration.
        DeviceError: the device failed.

    Source: kang2007coherent, sections 2.2 and 2.3.

    Departure: the positive response itself is drawn in for the next iteration, not its thresholded version, since a
    threshold would make whole strokes appear and vanish from frame to frame.
    """
    if iterations < 1:
        raise BadParameter("At least one iteration is needed.", field="iterations", value=iterations, remedy="Use 1.")
    difference = _difference(sigma_px, tau)
    mean = _gaussian(sigma_along_px, math.ceil(REACH * sigma_along_px)).astype(np.float32)
    if device is None:
        return _reference(gray, tangent, difference, mean, iterations)
    return _launch(device, gray, tangent, difference, mean, iterations)


def _gaussian(sigma_px: float, radius: int) -> NDArray[np.float64]:
    """Gaussian weights at 0, 1, ... `radius` px; both sides together sum to 1."""
    values = np.array([math.exp(-0.5 * (k / sigma_px) ** 2) if k else 1.0 for k in range(radius + 1)])
    return np.asarray(values / (2 * values.sum() - values[0]))


def _difference(sigma_px: float, tau: float) -> _Floats:
    wide_px = sigma_px * GAUSSIAN_RATIO
    radius = math.ceil(REACH * wide_px)
    return (tau * _gaussian(wide_px, radius) - _gaussian(sigma_px, radius)).astype(np.float32)


def _launch(device: Device, gray: Plane, tangent: Flow, difference: _Floats, mean: _Floats, iterations: int) -> Plane:
    height, width = gray.shape
    source, direction, out = device.upload(gray), device.upload(tangent), device.empty(gray.shape)
    picture, raw = device.empty(gray.shape), device.empty(gray.shape)
    first, second = device.upload(difference), device.upload(mean)

    def run(name: str, *args: DeviceArray | float) -> None:
        device.kernel(_SOURCE, name)((width, height), *args, width, height)

    for iteration in range(iterations):
        if iteration:
            run("superimpose", source, out, picture)
        run("across", picture if iteration else source, direction, first, raw, len(difference) - 1)
        run("along", raw, direction, second, out, len(mean) - 1)
    return device.download(out)


def _reference(gray: Plane, tangent: Flow, difference: _Floats, mean: _Floats, iterations: int) -> Plane:
    picture: Plane = gray
    for _ in range(iterations):
        out = _along(_across(picture, tangent, difference), tangent, mean)
        picture = gray - np.maximum(out, 0)
    return out


def _across(gray: _Floats, tangent: _Floats, weights: _Floats) -> _Floats:
    """Weighted sum of samples along the normal, one px apart; weights[k] applies to distance k on either side."""
    x, y = _grid(gray)
    out: _Floats = weights[0] * gray
    for k, weight in enumerate(weights[1:], 1):
        dx, dy = np.float32(k) * -tangent[..., 1], np.float32(k) * tangent[..., 0]
        out += weight * (_sample(gray, *_inside(gray, x + dx, y + dy)) + _sample(gray, *_inside(gray, x - dx, y - dy)))
    return out


def _along(response: _Floats, tangent: _Floats, weights: _Floats) -> _Floats:
    """Weighted mean along the streamline through each pixel, in both directions up to its ends.

    Each step of one px uses the tangent half a step ahead (midpoint method).
    """
    total, weight = weights[0] * response, np.full_like(response, weights[0])
    for direction in (tangent, -tangent):
        px, py = _grid(response)
        alive = np.ones(response.shape, bool)
        for w in weights[1:]:
            direction, alive = _next_direction(tangent, px, py, direction, alive)
            px, py = px + direction[..., 0], py + direction[..., 1]
            sx, sy = _inside(response, px, py)
            alive = alive & (sx == px) & (sy == py)
            total += np.where(alive, w * _sample(response, sx, sy), np.float32(0))
            weight += np.where(alive, w, np.float32(0))
    out: _Floats = total / weight
    return out


def _next_direction(
    tangent: _Floats, px: _Floats, py: _Floats, direction: _Floats, alive: NDArray[np.bool_]
) -> tuple[_Floats, NDArray[np.bool_]]:  # fmt: skip
    """Tangent half a step from (px, py) with the sign nearer to `direction`; not alive where it is undefined."""
    half = np.float32(0.5)
    mx, my = _inside(px, px + half * direction[..., 0], py + half * direction[..., 1])
    ahead = tangent[(my + half).astype(np.intp), (mx + half).astype(np.intp)]
    dot = ahead[..., 0] * direction[..., 0] + ahead[..., 1] * direction[..., 1]
    return np.where(dot[..., None] < 0, -ahead, ahead), alive & (dot != 0)


def _grid(plane: _Floats) -> tuple[_Floats, _Floats]:
    places = np.indices(plane.shape, np.float32)
    return places[1], places[0]


def _inside(plane: _Floats, x: _Floats, y: _Floats) -> tuple[_Floats, _Floats]:
    right, bottom = plane.shape[1] - 1, plane.shape[0] - 1
    return np.asarray(x.clip(0, right)), np.asarray(y.clip(0, bottom))


def _sample(plane: _Floats, x: _Floats, y: _Floats) -> _Floats:
    """Sample bilinearly at positions inside the picture."""
    x0, y0 = x.astype(np.intp), y.astype(np.intp)
    x1, y1 = np.minimum(x0 + 1, plane.shape[1] - 1), np.minimum(y0 + 1, plane.shape[0] - 1)
    fx, fy = x - x0.astype(np.float32), y - y0.astype(np.float32)
    top = plane[y0, x0] + fx * (plane[y0, x1] - plane[y0, x0])
    low = plane[y1, x0] + fx * (plane[y1, x1] - plane[y1, x0])
    out: _Floats = top + fy * (low - top)
    return out
