"""Brush parameters per pixel, and the strokes that they produce."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Plane
from pipeline.kernels.jit import kernel
from pipeline.strokes.random import Ids, Purpose, draws
from pipeline.strokes.seeds import Seeds, StyleField, interpolated, nearest, sample, sample_all

Canvas: TypeAlias = NDArray[np.float32]
"""A painting in progress, `float32` (height, width, 7): paint colour RGB in 0..255; paint height in px; target colour
RGB, which is the paint colour without shift, jitter and bristle texture. The error that calls for finer strokes is
measured on the target colour, otherwise strongly shifted colours would never count as painted."""
HEIGHT, TARGET = 3, 4
"""Channels of `Canvas`: paint height, and red of the target colour, followed by green and blue."""

Direction: TypeAlias = NDArray[np.float32]
"""Orientation per pixel, `float32` (height, width, 2): (cos 2a, sin 2a) of the stroke angle a; (0, 0) = undefined."""

JITTER_RANGE = 80.0
"""Largest change of a colour channel by jitter 1, gray levels; half of it is common to all three channels."""
BLACK = 24.0
"""Largest channel of a colour, 0..255, below which jitter is smaller: the bars of a letterboxed film stay black."""
COLOURED = 16.0
"""Difference of a colour's largest and smallest channel, gray levels, below which jitter changes its hue less and its
lightness as before: in a black-and-white film every stroke is gray."""


@dataclass(frozen=True)
class Brush:
    """Stroke parameters; each is a number, or a plane float32 (h, w) that is sampled at the stroke's seed.

    Attributes:
        size_px: width of a stroke or diameter of a disc, > 0.
        length_px: length of a stroke from tip to tip, >= 0; 0 paints discs.
        opacity: 0..1.
        hue_deg, saturation, value: colour shift in degrees, and as a fraction of the full range, -1..1.
        jitter: random change of colour, 0..1, in units of `JITTER_RANGE`.
        relief_px: height of the paint, px.
        grain: strength of the bristle texture, 0..1; 0 = smooth.
    """

    size_px: StyleField = 8.0
    length_px: StyleField = 48.0
    opacity: StyleField = 1.0
    hue_deg: StyleField = 0.0
    saturation: StyleField = 0.0
    value: StyleField = 0.0
    jitter: StyleField = 0.0
    relief_px: StyleField = 0.0
    grain: StyleField = 0.0

    def scaled(self, factor: StyleField) -> Brush:
        """Return the brush with size, length and relief multiplied by `factor`."""
        size, length, relief = (np.multiply(f, factor) for f in (self.size_px, self.length_px, self.relief_px))
        return replace(self, size_px=size, length_px=length, relief_px=relief)


class StrokeArrays(NamedTuple):
    """The arrays of `Strokes` without ids, in the form of the compiled rasterisers."""

    points: NDArray[np.float32]
    counts: NDArray[np.int32]
    radius_px: NDArray[np.float32]
    colours: NDArray[np.float32]
    targets: NDArray[np.float32]
    opacity: NDArray[np.float32]
    relief_px: NDArray[np.float32]
    grain: NDArray[np.float32]


@dataclass(frozen=True)
class Strokes:
    """n strokes ready for rasterisation, each a polyline of up to P points.

    Attributes:
        points: float32 (n, P, 2): (x, y), px; the first `counts` int32 (n,) are used, at least 1.
        radius_px, opacity, relief_px, grain: float32 (n,).
        colours: float32 (n, 3), paint colour RGB; may exceed 0..255, since lighting is applied later.
        targets: float32 (n, 3), RGB 0..255: colours of the picture that the strokes represent.
        ids: uint64 (n,), identifiers of the seeds.
    """

    points: NDArray[np.float32]
    counts: NDArray[np.int32]
    radius_px: NDArray[np.float32]
    colours: NDArray[np.float32]
    targets: NDArray[np.float32]
    opacity: NDArray[np.float32]
    relief_px: NDArray[np.float32]
    grain: NDArray[np.float32]
    ids: Ids

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def arrays(self) -> StrokeArrays:
        return StrokeArrays(
            self.points, self.counts, self.radius_px, self.colours, self.targets, self.opacity, self.relief_px,
            self.grain,
        )  # fmt: skip


class GuideArgs(NamedTuple):
    """Reference picture that confines strokes to pixels of their own colour, as the compiled rasterisers take it.

    Attributes:
        image: uint8 (h, w, 3); anything if not `enabled`.
        slopes: float32 (h, w), change of colour a px, RGB distance, see `raster.slopes_of`.
        tolerances: float32 (n,), RGB distance between pixel and stroke up to which the stroke covers the pixel.
    """

    image: Frame
    slopes: Plane
    tolerances: NDArray[np.float32]
    enabled: bool


def guide_args(
    count: int, guide: Frame | None, tolerance: float | NDArray[np.float32], slopes: Plane | None = None
) -> GuideArgs:
    """Arguments for `count` strokes; `guide` None lets strokes cover any pixel."""
    own = np.ascontiguousarray(np.broadcast_to(np.asarray(tolerance, np.float32), count))
    image = np.zeros((1, 1, 3), np.uint8) if guide is None else guide
    flat = np.zeros(image.shape[:2], np.float32) if slopes is None else slopes
    return GuideArgs(image, flat, own, guide is not None)


def discs(seeds: Seeds, brush: Brush, targets: NDArray[np.float32], seed: int = 0) -> Strokes:
    """Make strokes of one point each at the seeds: dots, or starting points of longer strokes.

    Args:
        targets: float32 (n, 3), RGB 0..255, the picture's colour for each seed; `tint` turns it into paint colour.
        seed: random seed of the colour jitter.
    """
    n = len(seeds)
    size, opacity, relief, grain = (
        sample(f, seeds.xy) for f in (brush.size_px, brush.opacity, brush.relief_px, brush.grain)
    )
    colours, points, counts = tint(targets, seeds, brush, seed), seeds.xy.reshape(n, 1, 2), np.ones(n, np.int32)
    return Strokes(points, counts, size / np.float32(2), colours, targets, opacity, relief, grain, seeds.ids)


def colours_at(seeds: Seeds, picture: Frame, shape: tuple[int, ...] | None = None) -> NDArray[np.float32]:
    """Sample the picture's colour at each seed: float32 (n, 3), RGB 0..255.

    Args:
        picture: uint8 (h, w, 3), usually blurred, so that the noise of a single pixel does not become paint.
        shape: (height, width, ...) of the frame in whose px the seeds are, if `picture` is smaller.
    """
    if shape is not None and picture.shape[:2] != tuple(shape[:2]):
        return interpolated(picture, seeds.xy, shape)
    x, y = nearest(seeds.xy, picture.shape)
    return picture[y, x].astype(np.float32)


def tint(
    targets: NDArray[np.float32], seeds: Seeds, brush: Brush, seed: int = 0, shape: tuple[int, ...] | None = None
) -> NDArray[np.float32]:
    """Shift and jitter target colours (n, 3) into paint colours; without shift and jitter they stay exactly the same.

    Grays have no hue and stay gray: shift and jitter change their lightness alone. The jitter depends on the stroke's
    id and colour alone, so it is constant over the stroke's lifetime. `shape`: (height, width, ...) of the picture, if
    the brush's parameters are on a coarser grid.
    """
    fields = (brush.hue_deg, brush.saturation, brush.value, brush.jitter)
    at_seeds = sample_all(fields, seeds.xy, _shape_of(fields) if shape is None else shape)
    return shifted(targets, seeds.ids, at_seeds, seed)


def _shape_of(fields: Sequence[StyleField]) -> tuple[int, ...]:
    """Shape of the first field that is a plane; (1, 1) if all are numbers."""
    return next((np.shape(field) for field in fields if np.ndim(field)), (1, 1))


def shifted(
    targets: NDArray[np.float32], ids: Ids, values: Sequence[NDArray[np.float32]], seed: int
) -> NDArray[np.float32]:
    """`tint` for the values of hue, saturation, value and jitter at each stroke, float32 (n,)."""
    hue, saturation, value, jitter = values
    colours = np.ascontiguousarray(targets, np.float32)
    if len(ids) and (hue.any() or saturation.any() or value.any()):
        colours = _shift(colours, hue, saturation, value)
    if jitter.any():
        noise = draws(ids, seed, Purpose.COLOUR) * 2 - 1
        hues = noise[:, :3] - noise[:, :3].mean(axis=1, keepdims=True)
        share = np.minimum(np.ptp(targets, axis=1) / np.float32(COLOURED), np.float32(1))
        stray = np.float32(0.5) * (noise[:, 3:] + hues * share[:, None])
        range_of = np.minimum(colours.max(axis=1), np.float32(BLACK)) * np.float32(JITTER_RANGE / BLACK)
        colours = np.clip(colours + stray * (jitter * range_of)[:, None], 0, 255)
    return colours


def _shift(
    colours: NDArray[np.float32], hue: NDArray[np.float32], saturation: NDArray[np.float32], value: NDArray[np.float32]
) -> NDArray[np.float32]:
    hsv = np.asarray(cv2.cvtColor(colours[None] / np.float32(255), cv2.COLOR_RGB2HSV)[0], np.float32)
    hsv[:, 0] = (hsv[:, 0] + hue) % 360
    hsv[:, 1] = np.clip(hsv[:, 1] + saturation * np.minimum(hsv[:, 1] * 4, 1), 0, 1)
    hsv[:, 2] = np.clip(hsv[:, 2] + value, 0, 1)
    return np.asarray(cv2.cvtColor(hsv[None], cv2.COLOR_HSV2RGB)[0] * np.float32(255), np.float32)


def blank(reference: Frame) -> Canvas:
    """Make a canvas that has the reference's colours and paint of height 0."""
    out = np.empty((*reference.shape[:2], 7), np.float32)
    _fill_blank(reference, out)
    return out


@kernel
def _fill_blank(reference: Frame, canvas: Canvas) -> None:
    height, width = reference.shape[:2]
    for y in range(height):
        for x in range(width):
            for c in range(3):
                value = np.float32(reference[y, x, c])
                canvas[y, x, c] = value
                canvas[y, x, TARGET + c] = value
            canvas[y, x, HEIGHT] = 0
