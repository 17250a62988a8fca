"""Layers from coarse to fine: large strokes everywhere, smaller ones where the painting is still far off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Plane
from pipeline.segmentation.jit import kernel
from pipeline.strokes.brush import Brush, Canvas, Direction, blank, colours_at, discs
from pipeline.strokes.carry import present
from pipeline.strokes.raster import Touch, paint
from pipeline.strokes.seeds import Field, Points, Seeds, as_plane, place, sample
from pipeline.strokes.sweep import sweep
from pipeline.strokes.trace import trace

FARTHEST = 442.0
"""Distance of black and white in RGB, rounded up: no error exceeds this threshold, so no stroke is painted."""

Renderer = Literal["explicit", "implicit"]


@dataclass(frozen=True)
class Recipe:
    """How layers are built up, alike for the whole picture.

    Attributes:
        most: layers that are painted at most.
        ratio: size of a layer's strokes, as part of that of the layer below; lengths shrink by its square root.
        overlap: strokes of a layer that lie upon each other, on average, where all of it is painted.
        scatter: of the jittered grid, 0..1.
        blur: sigma of the Gaussian that a layer's reference is blurred with, in radii of its strokes.
        edge: difference of colour at which strokes end and beyond which they do not cover, RGB; each finer layer takes
            four fifths of it.
        hold: 0..1: a stroke that was painted in the last frame stays down to this part of the threshold.
    """

    most: int = 3
    ratio: float = 0.5
    overlap: float = 3.0
    scatter: float = 1.0
    blur: float = 0.5
    edge: float = 90.0
    hold: float = 0.6


def layer_threshold(layers: Field, threshold: Field, index: int, shape: tuple[int, ...]) -> Plane:
    """Area error above which layer `index` (0 = the coarsest) paints, float32 (h, w), RGB distance.

    Args:
        layers: wished number of layers, may be fractional.
        threshold: area error of places with all their layers, 0..442.

    The number is snapped to the nearest integer, and the threshold slides: it is `threshold` where the layer is wholly
    there, and rises to `FARTHEST`, where no error reaches it, half a layer lower, so strokes come and go singly. The
    coarsest layer is painted everywhere: -1.

    Source: kagaya2011video, section 4.1. Departure: it slides quadratically, since most of 0..442 is above any error.
    """
    if index == 0:
        return np.full(shape[:2], -1, np.float32)
    missing = np.clip((np.float32(index + 1) - as_plane(layers, shape)) * 2, 0, 1)
    full = as_plane(threshold, shape)
    return np.asarray(full + (np.float32(FARTHEST) - full) * missing * missing, np.float32)


def colour_error(reference: Frame, canvas: Canvas) -> Plane:
    """Euclidean distance in RGB between picture and what the painter meant, float32 (h, w), 0..442."""
    out = np.empty(reference.shape[:2], np.float32)
    _error(reference, canvas, out)
    return out


@kernel
def _error(reference: Frame, canvas: Canvas, out: Plane) -> None:
    height, width = out.shape
    for y in range(height):
        for x in range(width):
            r = np.float32(reference[y, x, 0]) - canvas[y, x, 4]
            g = np.float32(reference[y, x, 1]) - canvas[y, x, 5]
            b = np.float32(reference[y, x, 2]) - canvas[y, x, 6]
            out[y, x] = np.sqrt(r * r + g * g + b * b)


def area_error(error: Plane, xy: Points, side_px: NDArray[np.float32]) -> NDArray[np.float32]:
    """Mean of the error over the square of `side_px` about each point, within the picture: float32 (n,).

    Source: hertzmann1998painterly, section 2.1.
    """
    out = np.empty(len(xy), np.float32)
    total: NDArray[Any] = cv2.integral(error, sdepth=cv2.CV_64F)
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


def layer_brush(brush: Brush, recipe: Recipe, index: int) -> Brush:
    """The brush of layer `index`: finer, and shorter, though less so."""
    if index == 0:
        return brush
    small = recipe.ratio**index
    fine = brush.scaled(small)
    length = np.multiply(brush.length_px, small**0.5)
    return Brush(
        fine.size_px, length, brush.opacity, brush.hue_deg, brush.saturation, brush.value,
        np.multiply(brush.jitter, small), fine.relief_px, brush.grain,
    )  # fmt: skip


def spacing_px(brush: Brush, recipe: Recipe) -> Field:
    """Distance of seeds at which strokes overlap as the recipe says: the square root of a stroke's area by that."""
    area = np.multiply(brush.size_px, np.add(brush.length_px, brush.size_px))
    return np.asarray(np.sqrt(area / recipe.overlap), np.float32)


def typical(size_px: Field) -> float:
    """The median of a field, about: of every eighth pixel."""
    plane = np.asarray(size_px, np.float32)
    return float(np.median(plane[::8, ::8] if plane.ndim else plane))


def layer_reference(picture: Frame, brush: Brush, recipe: Recipe) -> Frame:
    """What a layer paints: the picture without what is smaller than its strokes. One blur, by the median size."""
    sigma = recipe.blur * typical(brush.size_px) / 2
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma), np.uint8) if sigma > 0.3 else picture


def wanted(
    seeds: Seeds, reference: Frame, canvas: Canvas, side_px: Field, threshold: Plane, hold: float = 1.0
) -> NDArray[np.bool_]:
    """Which seeds' area error exceeds `hold` times the threshold, bool (n,)."""
    error = area_error(colour_error(reference, canvas), seeds.xy, sample(side_px, seeds.xy))
    return np.asarray(error > sample(threshold, seeds.xy) * np.float32(hold))


def paint_still(
    picture: Frame, field: Direction, brush: Brush, *, recipe: Recipe | None = None, layers: Field = 3.0,
    threshold: Field = 30.0, renderer: Renderer = "explicit", touch: Touch | None = None, seed: int = 0,
    threads: int = 1,
) -> Canvas:  # fmt: skip
    """Paint one picture without a past: float32 (h, w, 7), ready for `emboss`.

    Args:
        picture: uint8 (h, w, 3).
        field: float32 (h, w, 2), (cos 2a, sin 2a) of the strokes' angle.
        layers, threshold: see `layer_threshold`.

    Source: hertzmann1998painterly, section 2.1.
    """
    recipe = recipe or Recipe()
    canvas = blank(layer_reference(picture, brush, recipe))
    for index in range(recipe.most):
        fine = layer_brush(brush, recipe, index)
        spacing = spacing_px(fine, recipe)
        seeds = place(picture.shape, spacing, jitter=recipe.scatter, seed=seed, layer=index)
        reference = layer_reference(picture, fine, recipe)
        if index:
            limits = layer_threshold(layers, threshold, index, picture.shape)
            seeds = seeds[wanted(seeds, reference, canvas, fine.size_px, limits)]
        paint_layer(canvas, seeds, reference, field, fine, recipe, index, renderer, touch, seed, threads)
    return canvas


def paint_layer(
    canvas: Canvas, seeds: Seeds, reference: Frame, field: Direction, brush: Brush, recipe: Recipe, index: int,
    renderer: Renderer = "explicit", touch: Touch | None = None, seed: int = 0, threads: int = 1,
    aims: NDArray[np.float32] | None = None, presence: NDArray[np.float32] | None = None,
) -> None:  # fmt: skip
    """Paint one layer's seeds on the canvas, in place; `aims` (n, 3) are their colours, else the reference's.

    `presence` (n,), 0..1, is how far each is there, of strokes that live on (see `carry`); None = wholly."""
    edge = recipe.edge * 0.8**index
    aims = colours_at(seeds, reference) if aims is None else aims
    presence = np.ones(len(seeds), np.float32) if presence is None else presence
    if renderer == "implicit":
        starts = present(discs(seeds, brush, aims, seed), presence)
        sweep(
            canvas, starts, field, brush.length_px, seed=seed, touch=touch, guide=reference, tolerance=edge,
            threads=threads,
        )  # fmt: skip
        return
    under = canvas if index else None
    strokes = trace(seeds, field, brush, aims, reference=reference, canvas=under, edge=edge, seed=seed)
    paint(canvas, present(strokes, presence), seed=seed, touch=touch, guide=reference, tolerance=edge)
