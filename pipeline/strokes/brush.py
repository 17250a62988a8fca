"""What a stroke looks like: style parameters per pixel, and the strokes they make."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.strokes.random import Ids, Purpose, draws
from pipeline.strokes.seeds import Field, Points, Seeds, nearest, sample

Canvas: TypeAlias = NDArray[np.float32]
"""A painting in the making, `float32` (height, width, 4): red, green, blue in 0..255 and the paint's height in px."""

Direction: TypeAlias = NDArray[np.float32]
"""Orientation per pixel, `float32` (height, width, 2): (cos 2a, sin 2a) of the stroke's angle a; (0, 0) = none."""


@dataclass(frozen=True)
class Brush:
    """Style of strokes; each attribute is a number, or a plane float32 (h, w) that is read at the stroke's seed.

    Attributes:
        size_px: width of a stroke, diameter of a disc, > 0.
        length_px: of a stroke from tip to tip, >= 0; 0 paints discs.
        opacity: 0..1.
        hue_deg, saturation, value: colour shift: degrees, and parts of the full range -1..1.
        jitter: 0..1: how far a stroke's colour strays, in parts of a quarter of the full range of H, S and V.
        relief_px: height of the paint, px.
        grain: density of the bristle's traces in a stroke, 0..1; 0 = smooth.
    """

    size_px: Field = 8.0
    length_px: Field = 48.0
    opacity: Field = 1.0
    hue_deg: Field = 0.0
    saturation: Field = 0.0
    value: Field = 0.0
    jitter: Field = 0.0
    relief_px: Field = 0.0
    grain: Field = 0.0

    def scaled(self, factor: float) -> Brush:
        """The same brush, `factor` as large: size, length and relief."""
        size, length, relief = (np.multiply(f, factor) for f in (self.size_px, self.length_px, self.relief_px))
        return replace(self, size_px=size, length_px=length, relief_px=relief)


@dataclass(frozen=True)
class Strokes:
    """Strokes ready to paint, n of them, each a line of up to P points.

    Attributes:
        points: float32 (n, P, 2): (x, y), px; `counts` int32 (n,) of them are used, at least 1.
        radius_px, opacity, relief_px, grain: float32 (n,).
        colours: float32 (n, 3), RGB 0..255.
        ids: uint64 (n,), the names of the seeds.
    """

    points: NDArray[np.float32]
    counts: NDArray[np.int32]
    radius_px: NDArray[np.float32]
    colours: NDArray[np.float32]
    opacity: NDArray[np.float32]
    relief_px: NDArray[np.float32]
    grain: NDArray[np.float32]
    ids: Ids

    def __len__(self) -> int:
        return len(self.ids)


def discs(seeds: Seeds, brush: Brush, colours: NDArray[np.float32]) -> Strokes:
    """Strokes of one point each, where the seeds are: pointillists' dots, or the start of longer strokes."""
    n = len(seeds)
    radius, opacity, relief, grain = (
        sample(f, seeds.xy) for f in (brush.size_px, brush.opacity, brush.relief_px, brush.grain)
    )
    points, counts = seeds.xy.reshape(n, 1, 2), np.ones(n, np.int32)
    return Strokes(points, counts, radius / np.float32(2), colours, opacity, relief, grain, seeds.ids)


def stroke_colours(seeds: Seeds, picture: Frame, brush: Brush, seed: int = 0) -> NDArray[np.float32]:
    """The picture's colour at each seed, shifted and jittered as the brush says: float32 (n, 3), RGB 0..255.

    Args:
        picture: uint8 (h, w, 3), the frame, or better a blurred one: a pixel's noise is no colour to paint with.
        seed: of the jitter; a stroke keeps its jitter for life.
    """
    x, y = nearest(seeds.xy, picture.shape)
    return tint(picture[y, x].astype(np.float32), seeds, brush, seed)


def tint(colours: NDArray[np.float32], seeds: Seeds, brush: Brush, seed: int = 0) -> NDArray[np.float32]:
    """Colours (n, 3) of the seeds' strokes, shifted and jittered; exactly as given where the brush does neither."""
    hue, saturation, value, jitter = (
        sample(f, seeds.xy) for f in (brush.hue_deg, brush.saturation, brush.value, brush.jitter)
    )
    if not (hue.any() or saturation.any() or value.any() or jitter.any()):
        return np.ascontiguousarray(colours, np.float32)
    stray = (draws(seeds.ids, seed, Purpose.COLOUR)[:, :3] * 2 - 1) * jitter[:, None]
    hsv = _hsv(colours)
    hsv[:, 0] = (hsv[:, 0] + hue + stray[:, 0] * 45) % 360
    hsv[:, 1] = np.clip(hsv[:, 1] + saturation + stray[:, 1] * np.float32(0.25) * np.sqrt(hsv[:, 1]), 0, 1)
    hsv[:, 2] = np.clip(hsv[:, 2] + value + stray[:, 2] * np.float32(0.25), 0, 1)
    return np.ascontiguousarray(cv2.cvtColor(hsv[None], cv2.COLOR_HSV2RGB)[0] * np.float32(255))


def _hsv(colours: NDArray[np.float32]) -> NDArray[np.float32]:
    if len(colours) == 0:
        return np.zeros((0, 3), np.float32)
    rows = np.ascontiguousarray(colours, np.float32)[None] / np.float32(255)
    return np.asarray(cv2.cvtColor(rows, cv2.COLOR_RGB2HSV)[0], np.float32)


def blank(reference: Frame) -> Canvas:
    """A canvas in the reference's colours, without paint on it."""
    out = np.zeros((*reference.shape[:2], 4), np.float32)
    out[..., :3] = reference
    return out


__all__ = ["Brush", "Canvas", "Direction", "Points", "Strokes", "blank", "discs", "stroke_colours", "tint"]
