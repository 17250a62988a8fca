"""Hertzmann's curved-stroke painter (hertzmann1998painterly) with the brush sizes of zhang2011patches, table 1."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Mask, Plane
from pipeline.methods.patches.face_strokes import FACE_BLUR, FACE_LENGTH, LAYERS, LEAST_WEIGHT, FaceBrush, FacePlanes
from pipeline.methods.patches.paint_error import error_tolerance
from pipeline.methods.patches.params import STROKE_STYLES, PatchesParams, StrokeStyle
from pipeline.methods.patches.scan import PAPER_HEIGHT
from pipeline.strokes.brush import Brush, Canvas, Direction, blank, colours_at
from pipeline.strokes.emboss import emboss
from pipeline.strokes.layers import (
    FARTHEST,
    LayerScheme,
    layer_brush,
    layer_reference,
    layer_threshold,
    spacing_px,
    wanted,
)
from pipeline.strokes.raster import paint, slopes_of
from pipeline.strokes.seeds import Seeds, place
from pipeline.strokes.steepen import steepen
from pipeline.strokes.trace import TraceRules, trace
from pipeline.strokes.tracks import fade
from pipeline.tensors.structure import doubled_tangents

TABLE_1 = ((64, 2.0, 1.0, 16.0), (512, 4.0, 2.0, 32.0), (float("inf"), 8.0, 4.0, 128.0))
"""Rows of (largest region area, r_max, l_min, l_max), in px of a frame 344 px high."""
FINEST_RADIUS = 1.0
"""Radius of the finest layer, px of a frame 344 px high."""
FINEST_THRESHOLD = 1.5
"""Factor on the threshold of the finest layer, which is meant for small, salient details."""
STEEPENING, MOST_STEPS = 2.0, 8
"""Steps of edge steepening per px of a frame 344 px high, see `steepen`, and the largest number of them."""
MIN_RADIUS = 0.8
"""Smallest stroke radius, px."""
KEPT_SEEDS = 16
"""Layers whose seeds stay in memory: those of the frame, and of a few panoramas."""

Box = tuple[slice, slice]
"""Rows and columns."""


@dataclass(frozen=True)
class HertzmannPainter:
    """Painter of one style, with brush sizes that depend on the size of a region.

    Attributes:
        style: the stroke style.
        brush: brush of the coarsest layer; lengths in px.
        min_length: l_min / l_max, ratio.
        layers: number of layers; each layer halves the radius.
        threshold: approximation threshold T, RGB distance.
        seed: random seed.
        unit: pixels of the frame per pixel of a frame 344 px high.
    """

    style: StrokeStyle
    brush: Brush
    min_length: float
    layers: int
    threshold: float
    seed: int
    unit: float

    @classmethod
    def of(cls, name: str, area_px: float, height: int, params: PatchesParams, seed: int) -> HertzmannPainter:
        """Make the painter for a region.

        Args:
            name: name of the style, a key of `STROKE_STYLES`.
            area_px: area of the region summed over all its frames, px.
            height: height of the frames, px.

        Source: zhang2011patches, table 1. Departure: the table's sizes are scaled from a frame height of 344 px, so
        that a painting looks the same at any resolution.
        """
        style, unit = STROKE_STYLES[name], height / PAPER_HEIGHT
        _, radius, low, high = next(row for row in TABLE_1 if area_px / unit**2 <= row[0])
        scale = unit * params.stroke_size
        radius = max(radius * scale * style.radius, MIN_RADIUS)
        layers = 1
        while radius / 2**layers >= max(FINEST_RADIUS * scale * style.radius, MIN_RADIUS) - 1e-6:
            layers += 1
        brush = Brush(
            2 * radius, high * scale * style.length, style.opacity, 0.0, style.saturation_shift, 0.0,
            min(params.jitter + style.jitter, 1.0), 1.2 * params.relief * min(unit, 1.5), 0.55,
        )  # fmt: skip
        return cls(style, brush, low / high, layers, params.threshold * style.threshold, seed, unit)

    @property
    def scheme(self) -> LayerScheme:
        """Number, brush ratio and stroke density of the layers."""
        return LayerScheme(most=self.layers, ratio=0.5, overlap=self.style.overlap, blur=0.5, edge=90.0)

    @property
    def reach_px(self) -> float:
        """Largest distance of a stroke's pixels from its seed, px."""
        return float(self.brush.length_px) / 2 + float(self.brush.size_px)

    def reference(self, picture: Frame, brush: Brush) -> Frame:
        """The picture of a layer, blurred in proportion to its strokes, with steep edges: uint8 (h, w, 3).

        Departure from hertzmann1998painterly, section 2.1: strokes that take their colours from a blurred edge are of
        mixed colours, and make every silhouette a ramp of 4 px at 720 lines.
        """
        return self._steepened(layer_reference(picture, brush, self.scheme))

    def _steepened(self, picture: Frame) -> Frame:
        return steepen(picture, min(round(STEEPENING * self.unit), MOST_STEPS))

    def paint_picture(self, picture: Frame, faces: FacePlanes | None = None) -> Frame:
        """Paint a picture, with lighting: uint8 (h, w, 3).

        Args:
            faces: where strokes are added on faces; None = nowhere.
        """
        every = np.ones(picture.shape[:2], np.bool_)
        return self._painting(picture, every, (slice(None), slice(None)), faces)

    def paint_part(self, picture: Frame, where: Mask, faces: FacePlanes | None = None) -> Frame:
        """Paint only the strokes that start in `where`, bool (h, w); pixels beyond their reach are black.

        Args:
            faces: as for `paint_picture`.
        """
        box = _bounding_box(where, int(self.reach_px))
        out = np.zeros_like(picture)
        out[box] = self._painting(np.ascontiguousarray(picture[box]), where, box, faces)
        return out

    def _painting(self, picture: Frame, where: Mask, box: Box, faces: FacePlanes | None) -> Frame:
        """Paint a crop. Seeds are placed on the full frame `where`, so they do not depend on the crop `box`."""
        reference, tolerance = self.reference(picture, self.brush), error_tolerance(picture, self.unit)
        canvas = blank(reference)
        for index in range(self.layers):
            brush = layer_brush(self.brush, self.scheme.ratio, index)
            reference = self.reference(picture, brush) if index else reference
            seeds = self._seeds(brush, index, where, box)
            if index:
                seeds = seeds[wanted(seeds, reference, canvas, brush.size_px, self.error_limit(index, tolerance))]
            self.paint_layer(canvas, seeds, reference, brush, index)
        if faces is not None:
            for width, group in faces.where(where).groups():
                self._paint_faces(canvas, picture, width, group, box)
        return emboss(canvas)

    def _paint_faces(self, canvas: Canvas, picture: Frame, width_px: float, faces: FacePlanes, box: Box) -> None:
        """Add strokes on faces of similar width, in place.

        Opacity and number of the strokes fall with the weight, so that no seam appears.

        Args:
            width_px: typical width of the faces, px.
            faces: the faces on the full frame, of which `canvas` and `picture` are the crop `box`.
        """
        finest = float(self.brush.size_px) * self.scheme.ratio ** (self.layers - 1)
        where = faces.weight > LEAST_WEIGHT
        inner = _bounding_box(where[box], int(max(float(self.brush.size_px), width_px * LAYERS[0].share * FACE_LENGTH)))
        part, own = np.ascontiguousarray(picture[inner]), np.ascontiguousarray(canvas[inner])
        outer = _within(box, inner)
        near = faces.within(outer)
        for index, layer in enumerate(LAYERS, start=self.layers):
            face = FaceBrush(layer, finest)
            whole, brush = face.shape(self.brush, faces.width_px), face.brush(self.brush, near)
            sigma = FACE_BLUR * float(face.size_px(width_px)) / 2
            reference = np.asarray(cv2.GaussianBlur(part, (0, 0), sigma), np.uint8)
            if face.is_large(width_px):
                reference = self._steepened(reference)
            seeds = self._seeds(whole, index, where, outer)
            seeds = seeds[wanted(seeds, reference, own, brush.size_px, face.limit(near, self.threshold))]
            self.paint_layer(own, seeds, reference, brush, index, edge=face.edge(width_px))
        canvas[inner] = own

    def _seeds(self, brush: Brush, index: int, where: Mask, box: Box) -> Seeds:
        spacing, shape = spacing_px(brush, self.scheme), (where.shape[0], where.shape[1])
        if np.ndim(spacing):
            seeds = place(shape, spacing, jitter=self.scheme.scatter, seed=self.seed, layer=index)
        else:
            seeds = _uniform_seeds(shape, float(spacing), self.scheme.scatter, self.seed, index)
        seeds = seeds[where[np.rint(seeds.xy[:, 1]).astype(int), np.rint(seeds.xy[:, 0]).astype(int)]]
        corner = np.array([box[1].start or 0, box[0].start or 0], np.float32)
        return Seeds(seeds.xy - corner, seeds.ids)

    def error_limit(self, index: int, tolerance: Plane) -> Plane:
        """Error above which layer `index` is painted: float32 (h, w), RGB distance.

        Args:
            tolerance: float32 (h, w), factor on the threshold, see `error_tolerance`.
        """
        finest = self.layers > 1 and index == self.layers - 1
        threshold = np.float32(self.threshold * (FINEST_THRESHOLD if finest else 1)) * tolerance
        return layer_threshold(self.layers, np.minimum(threshold, np.float32(FARTHEST)), index, tolerance.shape)

    def paint_layer(
        self, canvas: Canvas, seeds: Seeds, reference: Frame, brush: Brush, index: int,
        targets: NDArray[np.float32] | None = None, presence: NDArray[np.float32] | None = None,
        edge: float | None = None,
    ) -> None:  # fmt: skip
        """Paint the strokes of one layer, in place.

        Args:
            canvas: the painting of the layers before.
            reference: uint8 (h, w, 3), the blurred picture of this layer.
            targets, presence: colours float32 (n, 3) and fading state float32 (n,) of tracked strokes; None for new
                strokes.
            edge: RGB distance at which strokes end; None = the scheme's, for that layer.
        """
        edge = self.scheme.edge * 0.8**index if edge is None else edge
        rules = TraceRules(reference, canvas if index else None, edge, self.min_length, self.style.curvature)
        targets = colours_at(seeds, reference) if targets is None else targets
        strokes = trace(seeds, directions(reference, brush), brush, targets, rules, self.seed)
        if presence is not None:
            strokes = fade(strokes, presence)
        paint(canvas, strokes, seed=self.seed, guide=reference, tolerance=edge, slopes=slopes_of(reference))


@lru_cache(maxsize=KEPT_SEEDS)
def _uniform_seeds(shape: tuple[int, int], spacing: float, jitter: float, seed: int, layer: int) -> Seeds:
    """`place` for one spacing, px: every frame of a video has the same seeds. The arrays are read-only."""
    seeds = place(shape, spacing, jitter=jitter, seed=seed, layer=layer)
    for array in (seeds.xy, seeds.ids):
        array.setflags(write=False)
    return seeds


def _within(box: Box, inner: Box) -> Box:
    """The part `inner` of a crop `box` as rows and columns of the full frame."""
    starts = [(outer.start or 0) + part.start for outer, part in zip(box, inner, strict=True)]
    rows, columns = (slice(at, at + part.stop - part.start) for at, part in zip(starts, inner, strict=True))
    return rows, columns


def _bounding_box(where: Mask, pad_px: int) -> Box:
    """Bounding box of a mask, extended by `pad_px` on each side."""
    spans = []
    for axis in (1, 0):
        found = np.flatnonzero(where.any(axis=axis))
        spans.append(slice(max(int(found[0]) - pad_px, 0), int(found[-1]) + 1 + pad_px) if len(found) else slice(0, 1))
    return spans[0], spans[1]


def directions(reference: Frame, brush: Brush) -> Direction:
    """Stroke directions normal to the image gradient: float32 (h, w, 2), (cos 2a, sin 2a) times a length of 0..1.

    Departure from hertzmann1998painterly: the gradient is averaged over the stroke's width by a structure tensor,
    since the gradient of a single pixel is mostly noise in smooth areas.
    """
    gray = np.asarray(cv2.cvtColor(reference, cv2.COLOR_RGB2GRAY), np.uint8)
    return doubled_tangents(gray, max(float(np.median(brush.size_px)) / 2, 1.0))
