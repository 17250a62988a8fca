"""Hertzmann's painter (hertzmann1998painterly), with the paper's table 1, and other styles of the stroke library."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Mask, Plane
from pipeline.methods.patches.grid import PAPER_HEIGHT
from pipeline.methods.patches.masking import leniency
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.styles import STYLES, Style
from pipeline.strokes.brush import Brush, Canvas, Direction, blank, colours_at
from pipeline.strokes.carry import present
from pipeline.strokes.emboss import Light, emboss
from pipeline.strokes.layers import FARTHEST, Recipe, layer_brush, layer_reference, layer_threshold, spacing_px, wanted
from pipeline.strokes.raster import Touch, paint, slopes_of
from pipeline.strokes.seeds import Seeds, place
from pipeline.strokes.trace import trace
from pipeline.tensors.structure import structure_tensor, tangent_field

TABLE_1 = ((64, 2.0, 1.0, 16.0), (512, 4.0, 2.0, 32.0), (float("inf"), 8.0, 4.0, 128.0))
"""Region area up to, r_max, l_min, l_max, in pixels of the paper's frames."""
FINEST_RADIUS = 1.0
"""Of the finest layer, in such pixels."""
RARE = 1.5
"""Factor on the threshold of strokes under two such pixels: they are for what is small and stands out."""
SMALLEST_RADIUS = 0.8
"""px: smaller strokes are not strokes any more."""

Box = tuple[slice, slice]
"""Rows and columns."""


@dataclass(frozen=True)
class Painter:
    """Paints pictures in one style with the brushes of a region's size.

    Attributes:
        brush: of the coarsest layer, px.
        least: l_min over l_max.
        layers: how many; radii are halved from layer to layer.
    """

    style: Style
    brush: Brush
    least: float
    layers: int
    threshold: float
    seed: int
    unit: float

    @classmethod
    def of(cls, name: str, area_px: float, height: int, params: PatchesParams, seed: int) -> Painter:
        """The painter of a region.

        Args:
            name: of the style.
            area_px: of the region over all its frames, px; `height` of the frames, px.

        Source: zhang2011patches, table 1. Departure: its pixels are those of a frame 344 px high, so that a painting
        looks alike at any size.
        """
        style, unit = STYLES[name], height / PAPER_HEIGHT
        _, radius, low, high = next(row for row in TABLE_1 if area_px / unit**2 <= row[0])
        scale = unit * params.stroke_size
        radius = max(radius * scale * style.radius, SMALLEST_RADIUS)
        layers = 1
        while radius / 2**layers >= max(FINEST_RADIUS * scale * style.radius, SMALLEST_RADIUS) - 1e-6:
            layers += 1
        brush = Brush(
            2 * radius, high * scale * style.length, style.opacity, 0.0, style.saturation_shift, 0.0,
            min(params.jitter + style.jitter, 1.0), 1.2 * params.relief * min(unit, 1.5), 0.55,
        )  # fmt: skip
        return cls(style, brush, low / high, layers, params.threshold * style.threshold, seed, unit)

    @property
    def recipe(self) -> Recipe:
        return Recipe(most=self.layers, ratio=0.5, overlap=self.style.overlap, blur=0.5, edge=90.0)

    @property
    def reach_px(self) -> float:
        """How far from its seed a stroke can reach, px."""
        return float(self.brush.length_px) / 2 + float(self.brush.size_px)

    def picture(self, picture: Frame) -> Frame:
        """The painting in the light, uint8 (h, w, 3)."""
        every = np.ones(picture.shape[:2], np.bool_)
        return self._painting(picture, every, (slice(None), slice(None)))

    def part(self, picture: Frame, where: Mask) -> Frame:
        """The same, but only strokes that start in `where`; beyond what is around that, it is black."""
        box = _around(where, int(self.reach_px))
        out = np.zeros_like(picture)
        out[box] = self._painting(np.ascontiguousarray(picture[box]), where, box)
        return out

    def _painting(self, picture: Frame, where: Mask, box: Box) -> Frame:
        """Of a picture that is this box of a larger one: its seeds are those of the whole."""
        canvas, lenient = blank(layer_reference(picture, self.brush, self.recipe)), leniency(picture, self.unit)
        for index in range(self.layers):
            fine = layer_brush(self.brush, self.recipe, index)
            reference = layer_reference(picture, fine, self.recipe)
            seeds = self._seeds(fine, index, where, box)
            if index:
                seeds = seeds[wanted(seeds, reference, canvas, fine.size_px, self.limit(index, lenient))]
            self.layer(canvas, seeds, reference, fine, index)
        return emboss(canvas, Light())

    def _seeds(self, brush: Brush, index: int, where: Mask, box: Box) -> Seeds:
        spacing = spacing_px(brush, self.recipe)
        seeds = place(where.shape, spacing, jitter=self.recipe.scatter, seed=self.seed, layer=index)
        seeds = seeds[where[np.rint(seeds.xy[:, 1]).astype(int), np.rint(seeds.xy[:, 0]).astype(int)]]
        corner = np.array([box[1].start or 0, box[0].start or 0], np.float32)
        return Seeds(seeds.xy - corner, seeds.ids)

    def limit(self, index: int, lenient: Plane) -> Plane:
        """Error from which layer `index` is painted, float32 (h, w), RGB distance."""
        fine = self.layers > 1 and index == self.layers - 1
        threshold = np.float32(self.threshold * (RARE if fine else 1)) * lenient
        return layer_threshold(self.layers, np.minimum(threshold, np.float32(FARTHEST)), index, lenient.shape)

    def layer(
        self, canvas: Canvas, seeds: Seeds, reference: Frame, brush: Brush, index: int,
        aims: NDArray[np.float32] | None = None, presence: NDArray[np.float32] | None = None,
    ) -> None:  # fmt: skip
        """Paint one layer's strokes, in place; `aims` and `presence` are those of strokes that live on."""
        edge = self.recipe.edge * 0.8**index
        strokes = trace(
            seeds, directions(reference, brush), brush, colours_at(seeds, reference) if aims is None else aims,
            reference=reference, canvas=canvas if index else None, edge=edge, min_length=self.least,
            curvature=self.style.curvature, seed=self.seed,
        )  # fmt: skip
        if presence is not None:
            strokes = present(strokes, presence)
        paint(
            canvas, strokes, seed=self.seed, touch=Touch(), guide=reference, tolerance=edge, slopes=slopes_of(reference)
        )


def _around(where: Mask, pad_px: int) -> Box:
    """The smallest box that holds all of a mask, and `pad_px` around it."""
    spans = []
    for axis in (1, 0):
        found = np.flatnonzero(where.any(axis=axis))
        spans.append(slice(max(int(found[0]) - pad_px, 0), int(found[-1]) + 1 + pad_px) if len(found) else slice(0, 1))
    return spans[0], spans[1]


def directions(reference: Frame, brush: Brush) -> Direction:
    """Across the picture's gradient, averaged over a stroke's width: (cos 2a, sin 2a), float32 (h, w, 2).

    Departure from hertzmann1998painterly: the gradient at the seed's very pixel is noise in flat places.
    """
    gray = cv2.cvtColor(reference, cv2.COLOR_RGB2GRAY).astype(np.float32)
    along = tangent_field(structure_tensor(gray, max(float(np.median(brush.size_px)) / 2, 1.0)))
    x, y = along[..., 0], along[..., 1]
    return np.dstack([x * x - y * y, 2 * x * y]).astype(np.float32)
