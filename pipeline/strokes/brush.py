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
"""A painting in the making, `float32` (height, width, 7): red, green, blue in 0..255; the paint's height in px; and
what the painter meant to match: red, green, blue without the brush's shift, jitter and traces of hairs. Whether a place
needs more strokes is judged by what was meant, or free colours would call for ever more of them."""

Direction: TypeAlias = NDArray[np.float32]
"""Orientation per pixel, `float32` (height, width, 2): (cos 2a, sin 2a) of the stroke's angle a; (0, 0) = none."""


STRAY = 80.0
"""How far jitter at its fullest takes each of red, green and blue: gray levels up or down, half of them together."""


@dataclass(frozen=True)
class Brush:
    """Style of strokes; each attribute is a number, or a plane float32 (h, w) that is read at the stroke's seed.

    Attributes:
        size_px: width of a stroke, diameter of a disc, > 0.
        length_px: of a stroke from tip to tip, >= 0; 0 paints discs.
        opacity: 0..1.
        hue_deg, saturation, value: colour shift: degrees, and parts of the full range -1..1.
        jitter: 0..1: how far a stroke's colour strays, in parts of `STRAY`.
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
        colours: float32 (n, 3), RGB 0..255, as they are painted; maybe beyond, since the light comes later.
        aims: float32 (n, 3), RGB 0..255: the picture's colours that they stand for.
        ids: uint64 (n,), the names of the seeds.
    """

    points: NDArray[np.float32]
    counts: NDArray[np.int32]
    radius_px: NDArray[np.float32]
    colours: NDArray[np.float32]
    aims: NDArray[np.float32]
    opacity: NDArray[np.float32]
    relief_px: NDArray[np.float32]
    grain: NDArray[np.float32]
    ids: Ids

    def __len__(self) -> int:
        return len(self.ids)


def discs(seeds: Seeds, brush: Brush, aims: NDArray[np.float32], seed: int = 0) -> Strokes:
    """Strokes of one point each, where the seeds are: pointillists' dots, or the start of longer strokes.

    Args:
        aims: float32 (n, 3), RGB 0..255, the picture's colour for each; `tint` makes the paint of it.
        seed: of the jitter.
    """
    n = len(seeds)
    size, opacity, relief, grain = (
        sample(f, seeds.xy) for f in (brush.size_px, brush.opacity, brush.relief_px, brush.grain)
    )
    colours, points, counts = tint(aims, seeds, brush, seed), seeds.xy.reshape(n, 1, 2), np.ones(n, np.int32)
    return Strokes(points, counts, size / np.float32(2), colours, aims, opacity, relief, grain, seeds.ids)


def colours_at(seeds: Seeds, picture: Frame) -> NDArray[np.float32]:
    """The picture's colour at each seed, float32 (n, 3), RGB 0..255.

    Args:
        picture: uint8 (h, w, 3), the frame, or better a blurred one: a pixel's noise is no colour to paint with.
    """
    x, y = nearest(seeds.xy, picture.shape)
    return picture[y, x].astype(np.float32)


def tint(aims: NDArray[np.float32], seeds: Seeds, brush: Brush, seed: int = 0) -> NDArray[np.float32]:
    """Colours (n, 3) of the seeds' paint: shifted, then jittered; exactly as given where the brush does neither.

    Grays have no hue, so a shift of saturation leaves them gray. A stroke keeps its jitter for life.
    """
    hue, saturation, value, jitter = (
        sample(f, seeds.xy) for f in (brush.hue_deg, brush.saturation, brush.value, brush.jitter)
    )
    colours = np.ascontiguousarray(aims, np.float32)
    if len(seeds) and (hue.any() or saturation.any() or value.any()):
        colours = _shift(colours, hue, saturation, value)
    if jitter.any():
        noise = draws(seeds.ids, seed, Purpose.COLOUR) * 2 - 1
        stray = np.float32(0.5) * (noise[:, 3:] + noise[:, :3] - noise[:, :3].mean(axis=1, keepdims=True))
        colours = np.clip(colours + stray * (jitter[:, None] * np.float32(STRAY)), 0, 255)
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
    """A canvas in the reference's colours, without paint on it."""
    out = np.zeros((*reference.shape[:2], 7), np.float32)
    out[..., :3] = out[..., 4:] = reference
    return out


__all__ = ["Brush", "Canvas", "Direction", "Points", "Strokes", "blank", "colours_at", "discs", "tint"]
