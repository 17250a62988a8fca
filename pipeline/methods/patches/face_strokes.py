"""Strokes on faces: their widths follow the width of the face, so that small and large faces are both painted.

Departure: zhang2011patches paints faces like everything else. With the strokes of its table 1, the eyes of a face 30 px
wide are covered by single strokes. Strokes fine enough for such a face turn a large one into a photograph.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.frames import Mask, Plane
from pipeline.strokes.brush import Brush
from pipeline.strokes.layers import FARTHEST
from pipeline.strokes.seeds import StyleField

LEAST_WEIGHT = 0.02
"""Weight below which a pixel counts as outside faces."""
FACE_LENGTH = 3.0
"""Largest length of a stroke in its widths. An eye is a fifth as wide as a face: longer strokes would cross it."""
FACE_BLUR = 0.25
"""Sigma of the blur of a layer's reference picture, in stroke radii."""


@dataclass(frozen=True)
class FaceStrokeLayer:
    """One layer of strokes on faces, for small and for large faces; values for sizes in between are interpolated.

    Attributes:
        share: stroke width as a fraction of the width of the face.
        finest: lower bound of the stroke width, in widths of the finest strokes outside faces.
        threshold: factors on the approximation threshold.
        edge: RGB distances at which strokes end and beyond which they do not cover.
    """

    share: float
    finest: float
    threshold: tuple[float, float]
    edge: tuple[float, float]


LAYERS = (
    FaceStrokeLayer(1 / 9, 2.0, (0.1, 0.1), (20.0, 24.0)),
    FaceStrokeLayer(1 / 18, 1.0, (0.1, 0.5), (20.0, 22.0)),
    FaceStrokeLayer(1 / 36, 0.5, (0.1, 0.7), (20.0, 20.0)),
)
"""Layers, coarse to fine. The box of a face ends at brows and chin; a ninth of it is a twelfth of the head's height."""
LEAST_SIZE_PX = 1.6
"""Smallest stroke width, px."""
LARGE = 2.0
"""A face is large if the coarsest layer's share of it is this many times the lower bound of the stroke width."""
_OCTAVES = np.array([2.0 ** (k + 0.5) for k in range(16)], np.float32)
"""Bounds between widths that are nearer to 2^k and to 2^(k + 1), px."""


@dataclass(frozen=True)
class FacePlanes:
    """Faces of a picture, or of a part of it.

    Attributes:
        weight: float32 (h, w), 0..1, weight of strokes on faces.
        width_px: float32 (h, w), width of the face at each pixel, px; any value where the weight is 0.
        corner: row and column of the picture at which the part begins.
    """

    weight: Plane
    width_px: Plane
    corner: tuple[int, int] = (0, 0)

    def within(self, box: tuple[slice, slice]) -> FacePlanes:
        """The faces in a part of the picture."""
        return FacePlanes(np.ascontiguousarray(self.weight[box]), np.ascontiguousarray(self.width_px[box]))

    def where(self, mask: Mask) -> FacePlanes:
        """The faces in the pixels of a mask, bool (h, w): the part of the picture that they cover."""
        inside = (self.weight > LEAST_WEIGHT) & mask
        return self._cropped(inside, np.where(mask, self.weight, np.float32(0)), self.width_px)

    def groups(self, least_px: float) -> Iterator[tuple[float, FacePlanes]]:
        """Faces whose widths are within a factor of sqrt 2 of a power of two, and that power, px; large ones first.

        Elsewhere the width is the smallest of the group, so that the grid of seeds depends on the group alone.

        Args:
            least_px: width up to which strokes on all faces have the same width, see `narrow_px`. These faces are one
                group.
        """
        inside = (self.weight > LEAST_WEIGHT) & (self.width_px > 0)
        if not inside.any():
            return
        narrow = max(int(np.searchsorted(_OCTAVES, least_px, side="right")) - 1, 0)
        octave = np.maximum(np.searchsorted(_OCTAVES, self.width_px), narrow)
        for value in np.unique(octave[inside])[::-1].tolist():
            own = inside & (octave == value)
            width = np.where(own, self.width_px, smallest_width(2.0**value))
            yield 2.0**value, self._cropped(own, np.where(own, self.weight, np.float32(0)), width)

    def upscaled(self, box: tuple[slice, slice], width_px: float) -> FacePlanes:
        """These faces in a larger part of the picture, without faces around them.

        Args:
            box: rows and columns of the picture.
            width_px: width of faces in the added pixels, px.
        """
        rows, columns = box
        shape = rows.stop - rows.start, columns.stop - columns.start
        weight, width = np.zeros(shape, np.float32), np.full(shape, width_px, np.float32)
        top, left = self.corner[0] - rows.start, self.corner[1] - columns.start
        own = slice(top, top + self.weight.shape[0]), slice(left, left + self.weight.shape[1])
        weight[own], width[own] = self.weight, self.width_px
        return FacePlanes(weight, width, (rows.start, columns.start))

    def _cropped(self, inside: Mask, weight: Plane, width_px: Plane) -> FacePlanes:
        """The part of two planes of this size around the pixels of `inside`."""
        rows, columns = (np.flatnonzero(inside.any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            return FacePlanes(weight[:0, :0], width_px[:0, :0], self.corner)
        box = slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
        corner = self.corner[0] + box[0].start, self.corner[1] + box[1].start
        return FacePlanes(np.ascontiguousarray(weight[box]), np.ascontiguousarray(width_px[box]), corner)


def smallest_width(power_px: float) -> np.float32:
    """Smallest width of the group of faces around that power of two, see `FacePlanes.groups`, px."""
    return np.float32(power_px * 2.0**-0.5)


def narrow_px(finest_px: float) -> float:
    """Largest width of a face on which the strokes of all layers have their least width, px.

    Args:
        finest_px: width of the finest strokes outside faces, px.
    """
    return min(max(layer.finest * finest_px, LEAST_SIZE_PX) / layer.share for layer in LAYERS)


@dataclass(frozen=True)
class FaceBrush:
    """Widths and limits of the strokes of one layer.

    Attributes:
        layer: the layer.
        finest_px: width of the finest strokes outside faces, px.
    """

    layer: FaceStrokeLayer
    finest_px: float

    def size_px(self, width_px: StyleField) -> StyleField:
        """Stroke width on faces of that width, px."""
        floor = np.float32(max(self.layer.finest * self.finest_px, LEAST_SIZE_PX))
        return np.maximum(np.multiply(width_px, np.float32(self.layer.share)), floor)

    def largeness(self, width_px: StyleField) -> StyleField:
        """Size of faces of that width between small and large, 0..1."""
        bound = LAYERS[0].finest * self.finest_px / LAYERS[0].share
        return np.clip((np.multiply(width_px, np.float32(1 / bound)) - 1) / np.float32(LARGE - 1), 0, 1)

    def is_large(self, width_px: float) -> bool:
        """Whether strokes on faces of that width are more like large strokes than like fine ones.

        Steep edges and bristles, which make a large stroke look like one, hide the eyes of a small face.
        """
        return float(self.largeness(width_px)) > 0.5

    def limit(self, planes: FacePlanes, threshold: float) -> Plane:
        """Error above which strokes are added: float32 (h, w), RGB distance; it rises where the weight falls."""
        small, large = self.layer.threshold
        factor = small + (large - small) * self.largeness(planes.width_px)
        missing = 1 - planes.weight
        return np.asarray(np.float32(threshold) * factor + np.float32(FARTHEST) * missing * missing, np.float32)

    def edge(self, width_px: float) -> float:
        """RGB distance at which strokes end."""
        small, large = self.layer.edge
        return small + (large - small) * float(self.largeness(width_px))

    def shape(self, base: Brush, width_px: Plane) -> Brush:
        """The brush `base` with the width and length of strokes on faces of that width, float32 (h, w), px."""
        size = self.size_px(width_px)
        return replace(base, size_px=size, length_px=np.minimum(FACE_LENGTH * size, np.float32(base.length_px)))

    def brush(self, base: Brush, planes: FacePlanes) -> Brush:
        """The brush: width and length by the face, opacity by the weight.

        Args:
            base: brush of the coarsest layer outside faces.
        """
        shape = self.shape(base, planes.width_px)
        size = shape.size_px
        large = self.largeness(planes.width_px)
        relief = np.multiply(np.multiply(size, large), np.float32(float(base.relief_px) / float(base.size_px)))
        jitter, grain = np.multiply(large, np.float32(base.jitter)), np.multiply(large, np.float32(base.grain))
        opacity = np.multiply(planes.weight, np.float32(base.opacity))
        return replace(shape, opacity=opacity, jitter=jitter, grain=grain, relief_px=relief)
