"""Hertzmann's curved-stroke painter (hertzmann1998painterly) with the brush sizes of zhang2011patches, table 1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.frames import Frame, Mask, Plane
from pipeline.kernels.executors import INLINE, FrameExecutor
from pipeline.kernels.jit import kernel
from pipeline.methods.patches.face_strokes import (
    FACE_BLUR,
    FACE_LENGTH,
    LAYERS,
    LEAST_WEIGHT,
    FaceBrush,
    FacePlanes,
    narrow_px,
    smallest_width,
)
from pipeline.methods.patches.layer_picture import LEAST_PAD_PX, Box, LayerPicture, areas_around
from pipeline.methods.patches.paint_error import error_tolerance
from pipeline.methods.patches.params import STROKE_STYLES, PatchesParams, StrokeStyle
from pipeline.methods.patches.scan import PAPER_SIDE
from pipeline.strokes.brush import Brush, Canvas, blank, colours_at
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
from pipeline.strokes.raster import StrokeTrace, paint
from pipeline.strokes.seeds import Seeds, place
from pipeline.strokes.steepen import steepen, steepen_wide
from pipeline.strokes.trace import TraceRules, trace
from pipeline.strokes.tracks import fade

TABLE_1 = ((64, 2.0, 1.0, 16.0), (512, 4.0, 2.0, 32.0), (float("inf"), 8.0, 4.0, 128.0))
"""Rows of (largest region area, r_max, l_min, l_max), in px of a frame 344 px high."""
FINEST_RADIUS = 1.0
"""Radius of the finest layer, px of a frame 344 px high."""
FINEST_THRESHOLD = 1.5
"""Factor on the threshold of the finest layer, which is meant for small, salient details."""
STEEPENING, MOST_STEPS = 2.0, 8
"""Steps of edge steepening per px of a frame 344 px high, see `steepen`, and the largest number of them."""
PAINT_STEEPENING = 1.0
"""Steps of steepening of the wide edges that strokes leave in a painting, per px of a frame 344 px high."""
MIN_RADIUS = 0.8
"""Smallest stroke radius, px."""
START_REACH = 0.25
"""Distance from the pixels to be painted within which strokes start, in reaches of a stroke of the layer."""
KEPT_SEEDS = 16
"""Layers whose seeds stay in memory: those of the frame, and of a few panoramas."""


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
        deep: whether paintings are uint16.
        trace: of the strokes of one painting, which `paint_picture` fills; None: it is not wanted.
    """

    style: StrokeStyle
    brush: Brush
    min_length: float
    layers: int
    threshold: float
    seed: int
    unit: float
    deep: bool = False
    trace: StrokeTrace | None = None

    @classmethod
    def of(
        cls, name: str, area_px: float, side: int, params: PatchesParams, seed: int, deep: bool = False
    ) -> HertzmannPainter:  # fmt: skip
        """Make the painter for a region.

        Args:
            name: name of the style, a key of `STROKE_STYLES`.
            area_px: area of the region summed over all its frames, px.
            side: shorter side of the frames, px.
            deep: whether paintings are uint16.

        Source: zhang2011patches, table 1. Departure: the table's sizes are scaled from a shorter side of 344 px, so
        that a painting looks the same at any resolution.
        """
        style, unit = STROKE_STYLES[name], side / PAPER_SIDE
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
        return cls(style, brush, low / high, layers, params.threshold * style.threshold, seed, unit, deep)

    @property
    def scheme(self) -> LayerScheme:
        """Number, brush ratio and stroke density of the layers."""
        return LayerScheme(most=self.layers, ratio=0.5, overlap=self.style.overlap, blur=0.5, edge=90.0)

    @property
    def finest_px(self) -> float:
        """Width of the finest strokes outside faces, px."""
        return float(self.brush.size_px) * self.scheme.ratio ** (self.layers - 1)

    def reference(self, picture: Frame, brush: Brush) -> Frame:
        """The picture of a layer, blurred in proportion to its strokes, with steep edges: uint8 (h, w, 3).

        Departure from hertzmann1998painterly, section 2.1: strokes that take their colours from a blurred edge are of
        mixed colours, and make every silhouette a ramp of 4 px at 720 lines.
        """
        return self._steepened(layer_reference(picture, brush, self.scheme))

    def _steepened(self, picture: Frame) -> Frame:
        return steepen(picture, min(round(STEEPENING * self.unit), MOST_STEPS))

    def paint_picture(
        self, picture: Frame, faces: FacePlanes | None = None, background: FrameExecutor = INLINE
    ) -> AnyArray:
        """Paint a picture, with lighting: uint8 (h, w, 3), or uint16.

        Args:
            faces: where strokes are added on faces; None = nowhere.
            background: its helper prepares a layer while the one before it is painted.
        """
        every = np.ones(picture.shape[:2], np.bool_)
        return self._painting(picture, [every] * self.layers, (slice(None), slice(None)), faces, background)

    def paint_part(
        self, picture: Frame, where: Mask, faces: FacePlanes | None = None, background: FrameExecutor = INLINE
    ) -> AnyArray:
        """Paint the pixels of `where`, bool (h, w), by the strokes that start in them or near them.

        "Near" is a quarter of a stroke's reach, which differs from layer to layer. The result has the size of the
        picture; it is undefined outside `where`.

        Args:
            faces, background: as for `paint_picture`.
        """
        own, near = where.astype(np.uint8), list[Mask]()
        for index in range(self.layers):
            side = 2 * int(reach_px(layer_brush(self.brush, self.scheme.ratio, index)) * START_REACH) + 1
            near.append(cv2.dilate(own, np.ones((side, side), np.uint8)) > 0)
        box = _bounding_box(near[0], int(reach_px(self.brush)))
        out = np.zeros(picture.shape, np.uint16 if self.deep else np.uint8)
        out[box] = self._painting(np.ascontiguousarray(picture[box]), near, box, faces, background)
        return out

    def _painting(
        self, picture: Frame, where: Sequence[Mask], box: Box, faces: FacePlanes | None, background: FrameExecutor
    ) -> AnyArray:
        """Paint a crop of the frame.

        Args:
            picture: the crop `box` of the frame.
            where: for each layer, the pixels in which its strokes may start, bool of the frame's size. Seeds are placed
                on the frame, so they do not depend on the crop.
        """
        base, tolerance = self.reference(picture, self.brush), error_tolerance(picture, self.unit)
        canvas, shape = blank(base), (where[0].shape[0], where[0].shape[1])

        def prepared(index: int) -> tuple[Brush, Mask, LayerPicture]:
            brush, inside = layer_brush(self.brush, self.scheme.ratio, index), np.ascontiguousarray(where[index][box])
            return brush, inside, self._layer_picture(picture, base, brush, index, inside)

        following = background.submit_parallel(partial(prepared, 0))
        for index in range(len(where)):
            brush, inside, layer = following.result()
            if index + 1 < len(where):
                following = background.submit_parallel(partial(prepared, index + 1))
            seeds = self._seeds(brush, index, inside, shape, box)
            if index:
                limit = self.error_limit(index, tolerance)
                seeds = seeds[wanted(seeds, layer.reference, canvas, brush.size_px, limit)]
            self.paint_layer(canvas, seeds, layer, brush, index)
        if faces is not None:
            for width, group in faces.where(where[0]).groups(narrow_px(self.finest_px)):
                self._paint_faces(canvas, picture, width, group, box, shape)
        steepen_wide(canvas, min(round(PAINT_STEEPENING * self.unit), MOST_STEPS))
        return emboss(canvas, deep=self.deep)

    def _layer_picture(self, picture: Frame, base: Frame, brush: Brush, index: int, where: Mask) -> LayerPicture:
        """The picture of layer `index` for strokes that start in `where`; `base` is that of the coarsest layer."""
        areas = areas_around(where, int(float(brush.size_px)) + LEAST_PAD_PX)
        if [(area[0].stop - area[0].start, area[1].stop - area[1].start) for area in areas] == [where.shape]:
            return LayerPicture.of(self.reference(picture, brush) if index else base, brush)
        if not index:
            return LayerPicture.within(areas, base, brush, lambda area: np.ascontiguousarray(base[area]))
        return LayerPicture.within(
            areas, base, brush, lambda area: self.reference(np.ascontiguousarray(picture[area]), brush)
        )

    def _paint_faces(self, canvas: Canvas, picture: Frame, width_px: float, faces: FacePlanes, box: Box,
                     shape: tuple[int, int]) -> None:  # fmt: skip
        """Add strokes on faces of similar width, in place.

        Opacity and number of the strokes fall with the weight, so that no seam appears.

        Args:
            width_px: typical width of the faces, px.
            faces: the faces, in the part of the frame that they cover.
            box: the crop of the frame that `canvas` and `picture` are.
            shape: (height, width) of the frame, px.
        """
        pad = int(max(float(self.brush.size_px), width_px * LAYERS[0].share * FACE_LENGTH))
        outer, inner = _around(faces, pad, box, shape)
        part, own = np.ascontiguousarray(picture[inner]), np.ascontiguousarray(canvas[inner])
        seen = self.trace
        trace = None if seen is None else StrokeTrace(seen.owners[inner].copy(), seen.cover[inner].copy())
        painter = replace(self, trace=trace)
        near = faces.upscaled(outer, float(smallest_width(width_px)))
        where = near.weight > LEAST_WEIGHT
        for index, layer in enumerate(LAYERS, start=self.layers):
            face = FaceBrush(layer, self.finest_px)
            brush = face.brush(self.brush, near)
            sigma = FACE_BLUR * float(face.size_px(width_px)) / 2
            reference = np.asarray(cv2.GaussianBlur(part, (0, 0), sigma), np.uint8)
            if face.is_large(width_px):
                reference = self._steepened(reference)
            seeds = place(
                shape, spacing_px(brush, self.scheme), jitter=self.scheme.scatter, seed=self.seed, layer=index,
                corner=near.corner,
            )  # fmt: skip
            seeds = _seeds_in(seeds, where, near.corner)
            seeds = seeds[wanted(seeds, reference, own, brush.size_px, face.limit(near, self.threshold))]
            if len(seeds):
                layer_picture = LayerPicture.of(reference, brush)
                painter.paint_layer(own, seeds, layer_picture, brush, index, edge=face.edge(width_px))
        canvas[inner] = own
        if seen is not None and trace is not None:
            seen.owners[inner], seen.cover[inner] = trace

    def _seeds(self, brush: Brush, index: int, inside: Mask, shape: tuple[int, int], box: Box) -> Seeds:
        """Seeds of a layer in the mask `inside` of the crop `box`, and relative to it; `shape` is that of the frame."""
        spacing = float(spacing_px(brush, self.scheme))
        seeds = _uniform_seeds(shape, spacing, self.scheme.scatter, self.seed, index)
        return _seeds_in(seeds, inside, (box[0].start or 0, box[1].start or 0))

    def error_limit(self, index: int, tolerance: Plane) -> Plane:
        """Error above which layer `index` is painted: float32 (h, w), RGB distance.

        Args:
            tolerance: float32 (h, w), factor on the threshold, see `error_tolerance`.
        """
        finest = self.layers > 1 and index == self.layers - 1
        threshold = np.float32(self.threshold * (FINEST_THRESHOLD if finest else 1)) * tolerance
        return layer_threshold(self.layers, np.minimum(threshold, np.float32(FARTHEST)), index, tolerance.shape)

    def paint_layer(
        self, canvas: Canvas, seeds: Seeds, layer: LayerPicture, brush: Brush, index: int,
        targets: NDArray[np.float32] | None = None, presence: NDArray[np.float32] | None = None,
        edge: float | None = None,
    ) -> None:  # fmt: skip
        """Paint the strokes of one layer, in place.

        Args:
            canvas: the painting of the layers before.
            layer: what the strokes follow.
            targets, presence: colours float32 (n, 3) and fading state float32 (n,) of tracked strokes; None for new
                strokes.
            edge: RGB distance at which strokes end; None = the scheme's, for that layer.
        """
        edge, reference = self.scheme.edge * 0.8**index if edge is None else edge, layer.reference
        rules = TraceRules(reference, canvas if index else None, edge, self.min_length, self.style.curvature)
        targets = colours_at(seeds, reference) if targets is None else targets
        strokes = trace(seeds, layer.field, brush, targets, rules, self.seed)
        if presence is not None:
            strokes = fade(strokes, presence)
        paint(canvas, strokes, seed=self.seed, guide=reference, tolerance=edge, slopes=layer.slopes, trace=self.trace)


def reach_px(brush: Brush) -> float:
    """Largest distance of a stroke's pixels from its seed, px, for a brush of uniform size."""
    return float(brush.length_px) / 2 + float(brush.size_px)


@lru_cache(maxsize=KEPT_SEEDS)
def _uniform_seeds(shape: tuple[int, int], spacing: float, jitter: float, seed: int, layer: int) -> Seeds:
    """`place` for one spacing, px: every frame of a video has the same seeds. The arrays are read-only."""
    seeds = place(shape, spacing, jitter=jitter, seed=seed, layer=layer)
    for array in (seeds.xy, seeds.ids):
        array.setflags(write=False)
    return seeds


def _seeds_in(seeds: Seeds, where: Mask, corner: tuple[int, int]) -> Seeds:
    """The seeds in a mask of a part of the picture, relative to that part's first pixel at `corner`, row and column."""
    keep = np.empty(len(seeds), np.bool_)
    _inside(seeds.xy, where, corner, keep)
    found = seeds[keep]
    return Seeds(found.xy - np.array([corner[1], corner[0]], np.float32), found.ids)


@kernel
def _inside(xy: NDArray[np.float32], where: Mask, corner: tuple[int, int], keep: NDArray[np.bool_]) -> None:
    height, width = where.shape
    for k in range(len(keep)):
        column, row = int(np.rint(xy[k, 0])) - corner[1], int(np.rint(xy[k, 1])) - corner[0]
        keep[k] = 0 <= row < height and 0 <= column < width and where[row, column]


def _around(faces: FacePlanes, pad: int, box: Box, shape: tuple[int, int]) -> tuple[Box, Box]:
    """The part of the frame within `pad` px of the faces, inside the crop `box`; and the same part of the crop."""
    outer, inner = [], []
    for first, length, side, whole in zip(faces.corner, faces.weight.shape, box, shape, strict=True):
        low, high = side.start or 0, min(side.stop or whole, whole)
        span = slice(max(first - pad, low), min(first + length + pad, high))
        outer.append(span)
        inner.append(slice(span.start - low, span.stop - low))
    return (outer[0], outer[1]), (inner[0], inner[1])


def _bounding_box(where: Mask, pad_px: int) -> Box:
    """Bounding box of a mask, extended by `pad_px` on each side."""
    spans = []
    for axis in (1, 0):
        found = np.flatnonzero(where.any(axis=axis))
        spans.append(slice(max(int(found[0]) - pad_px, 0), int(found[-1]) + 1 + pad_px) if len(found) else slice(0, 1))
    return spans[0], spans[1]
