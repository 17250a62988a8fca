"""Layers from coarse to fine: large strokes everywhere, smaller ones where the painting differs from the picture."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.frames import Frame, Plane
from pipeline.gaussian import wide_gaussian
from pipeline.kernels.jit import kernel
from pipeline.strokes.brush import TARGET, Brush, Canvas, Direction, blank, colours_at
from pipeline.strokes.raster import StrokeProfile, paint
from pipeline.strokes.seeds import Points, Seeds, StyleField, as_plane, place, sample
from pipeline.strokes.trace import TraceRules, trace

FARTHEST = 442.0
"""RGB distance of black and white, rounded up. No error exceeds this threshold, so no stroke is painted."""


@dataclass(frozen=True)
class LayerScheme:
    """Relation of the layers of a style to each other.

    Attributes:
        most: largest number of layers.
        ratio: stroke size of a layer relative to the layer below; lengths shrink by its square root.
        overlap: mean number of strokes of a layer on a pixel, where the whole layer is painted.
        scatter: jitter of the seed grid, 0..1.
        blur: sigma of the Gaussian blur of a layer's reference, in stroke radii.
        edge: RGB distance at which strokes end and beyond which they do not cover; it is multiplied by 0.8 with each
            finer layer.
        keep: factor on the threshold for strokes that exist already, 0..1 (hysteresis).
    """

    most: int = 3
    ratio: float = 0.5
    overlap: StyleField = 3.0
    scatter: float = 1.0
    blur: float = 0.5
    edge: float = 90.0
    keep: float = 0.6


def layer_threshold(layers: StyleField, threshold: StyleField, index: int, shape: tuple[int, ...]) -> Plane:
    """Area error above which layer `index` (0 = coarsest) paints: float32 (h, w), RGB distance.

    Args:
        layers: requested number of layers, may be fractional.
        threshold: threshold where the layer is fully requested, 0..442.

    The number of layers is rounded to the nearest integer, and the threshold rises from `threshold`, where the layer is
    fully requested, to `FARTHEST`, where half of it is missing, so that strokes appear one by one. The coarsest layer
    is painted everywhere: -1.

    Source: kagaya2011video, section 4.1. Departure: the threshold rises quadratically instead of linearly, since
    errors are small compared with `FARTHEST`.
    """
    if index == 0:
        return np.full(shape[:2], -1, np.float32)
    return threshold_of(as_plane(layers, shape), as_plane(threshold, shape), index)


def threshold_of(layers: NDArray[np.float32], threshold: NDArray[np.float32], index: int) -> NDArray[np.float32]:
    """`layer_threshold` of a finer layer for values of the two parameters, float32 of any one shape."""
    missing = np.clip((np.float32(index + 1) - layers) * 2, 0, 1)
    return np.asarray(threshold + (np.float32(FARTHEST) - threshold) * missing * missing, np.float32)


def colour_error(reference: Frame, canvas: Canvas) -> Plane:
    """Euclidean RGB distance between the picture and the canvas's target colour: float32 (h, w), 0..442."""
    out = np.empty(reference.shape[:2], np.float32)
    _error(reference, canvas, out)
    return out


@kernel
def _error(reference: Frame, canvas: Canvas, out: Plane) -> None:
    height, width = out.shape
    for y in range(height):
        for x in range(width):
            r = np.float32(reference[y, x, 0]) - canvas[y, x, TARGET]
            g = np.float32(reference[y, x, 1]) - canvas[y, x, TARGET + 1]
            b = np.float32(reference[y, x, 2]) - canvas[y, x, TARGET + 2]
            out[y, x] = np.sqrt(r * r + g * g + b * b)


def area_error(error: Plane, xy: Points, side_px: NDArray[np.float32]) -> NDArray[np.float32]:
    """Mean error over the square of side `side_px` around each point, clipped to the picture: float32 (n,).

    Source: hertzmann1998painterly, section 2.1.
    """
    out = np.empty(len(xy), np.float32)
    total: AnyArray = cv2.integral(error, sdepth=cv2.CV_64F)
    _area_error(total, xy, side_px, out)
    return out


@kernel
def _area_error(total: NDArray[np.float64], xy: Points, side: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    height, width = total.shape[0] - 1, total.shape[1] - 1
    for k in range(len(xy)):
        half = max(int(side[k] * np.float32(0.5)), 0)
        px, py = int(xy[k, 0] + np.float32(0.5)), int(xy[k, 1] + np.float32(0.5))
        left, right = max(px - half, 0), min(px + half + 1, width)
        top, bottom = max(py - half, 0), min(py + half + 1, height)
        inside = total[bottom, right] - total[top, right] - total[bottom, left] + total[top, left]
        out[k] = np.float32(inside / ((right - left) * (bottom - top)))


def layer_brush(brush: Brush, ratio: StyleField, index: int) -> Brush:
    """The brush of layer `index`: size scales with `ratio` a layer, length with its square root."""
    if index == 0:
        return brush
    small = ratio**index
    fine = brush.scaled(small)
    length = np.multiply(brush.length_px, small**0.5)
    return Brush(
        fine.size_px, length, brush.opacity, brush.hue_deg, brush.saturation, brush.value,
        np.multiply(brush.jitter, small), fine.relief_px, brush.grain,
    )  # fmt: skip


def spacing_px(brush: Brush, scheme: LayerScheme) -> StyleField:
    """Distance of seeds, px, for the scheme's overlap: square root of stroke area over overlap."""
    area = np.multiply(brush.size_px, np.add(brush.length_px, brush.size_px))
    return np.asarray(np.sqrt(np.divide(area, scheme.overlap)), np.float32)


def typical(size_px: StyleField) -> float:
    """Approximate median of a field: the median of every eighth pixel."""
    plane = np.asarray(size_px, np.float32)
    return float(np.median(plane[::8, ::8] if plane.ndim else plane))


def layer_reference(picture: Frame, brush: Brush, scheme: LayerScheme) -> Frame:
    """The reference of a layer: the picture, blurred in proportion to the median stroke size."""
    sigma = scheme.blur * typical(brush.size_px) / 2
    return wide_gaussian(picture, sigma) if sigma > 0.3 else picture


def wanted(
    seeds: Seeds, reference: Frame, canvas: Canvas, side_px: StyleField, threshold: Plane, factor: float = 1.0
) -> NDArray[np.bool_]:
    """Flags of the seeds whose area error exceeds `factor` times the threshold: bool (n,)."""
    error = area_error(colour_error(reference, canvas), seeds.xy, sample(side_px, seeds.xy))
    return np.asarray(error > sample(threshold, seeds.xy) * np.float32(factor))


@dataclass(frozen=True)
class StillPainting:
    """Parameters of a painting of a single picture with explicit strokes.

    Attributes:
        layers, threshold: see `layer_threshold`.
    """

    brush: Brush
    scheme: LayerScheme = LayerScheme()
    layers: StyleField = 3.0
    threshold: StyleField = 30.0
    profile: StrokeProfile | None = None
    seed: int = 0


def paint_still(picture: Frame, field: Direction, painting: StillPainting) -> Canvas:
    """Paint a single picture: float32 (h, w, 7), input of `emboss`.

    Args:
        picture: uint8 (h, w, 3).
        field: float32 (h, w, 2), (cos 2a, sin 2a) of the stroke angle.

    Source: hertzmann1998painterly, section 2.1.
    """
    scheme = painting.scheme
    canvas = blank(layer_reference(picture, painting.brush, scheme))
    for index in range(scheme.most):
        brush = layer_brush(painting.brush, scheme.ratio, index)
        reference = layer_reference(picture, brush, scheme)
        seeds = place(picture.shape, spacing_px(brush, scheme), jitter=scheme.scatter, seed=painting.seed, layer=index)
        if index:
            limits = layer_threshold(painting.layers, painting.threshold, index, picture.shape)
            seeds = seeds[wanted(seeds, reference, canvas, brush.size_px, limits)]
        edge = scheme.edge * 0.8**index
        rules = TraceRules(reference, canvas if index else None, edge)
        strokes = trace(seeds, field, brush, colours_at(seeds, reference), rules, painting.seed)
        paint(canvas, strokes, seed=painting.seed, profile=painting.profile, guide=reference, tolerance=edge)
    return canvas
