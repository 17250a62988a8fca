"""Pictures with opacity as frames: over white, as their own colours, or their opacity."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.video.depth import white_of
from pipeline.video.media import SourceOptions
from pipeline.video.stills import over_white

_LEAST = 16
"""Least opacity, of 255, of a premultiplied pixel whose colour is known: below it, a level is more than a tenth."""


def as_frame(picture: AnyArray, options: SourceOptions) -> AnyArray:
    """The frame of a picture, uint8, uint16 or float32 (h, w), (h, w, 3) or (h, w, 4), as `options.opacity` says:
    "white", "straight" or "matte" (the opacity as a gray frame; of a picture without any, white). Same type."""
    if picture.ndim == 2:
        picture = np.dstack([picture] * 3)
    if options.opacity == "matte":
        opaque = np.full(picture.shape[:2], white_of(picture), picture.dtype)
        return np.dstack([picture[..., 3] if picture.shape[2] == 4 else opaque] * 3)
    if picture.shape[2] == 3:
        return np.ascontiguousarray(picture)
    if options.premultiplied:
        picture = unpremultiplied(picture)
    return (
        over_white(picture) if options.opacity == "white" else extended(picture, _LEAST if options.premultiplied else 1)
    )


def unpremultiplied(rgba: AnyArray) -> AnyArray:
    """Straight colours of premultiplied ones, uint8, uint16 or float32 (h, w, 4); 0 where the opacity is 0."""
    clear, white = rgba[..., 3:].astype(np.float32), np.float32(white_of(rgba))
    straight = rgba[..., :3] * np.divide(white, clear, out=np.zeros_like(clear), where=clear > 0)
    return np.dstack([_of_type(straight, rgba), rgba[..., 3]])


def _of_type(values: NDArray[np.float32], like: AnyArray) -> AnyArray:
    """The values, as they are for a float picture, else rounded and clipped to the type of `like`."""
    if like.dtype == np.float32:
        return values
    return np.asarray(np.clip(np.rint(values), 0, white_of(like)), like.dtype)


def extended(rgba: AnyArray, least: int = 1) -> AnyArray:
    """The colours of a picture with straight opacity, uint8, uint16 or float32 (h, w, 4). Pixels with an opacity below
    `least` of 255, whose colours are unknown, get those of their surroundings, so that no brush and no filter draws a
    background into the visible part. Source: push-pull, Gortler et al.: The lumigraph (SIGGRAPH 1996), section 3.4.2.
    """
    known = rgba[..., 3] >= least * white_of(rgba) / 255
    if known.all() or not known.any():
        return np.ascontiguousarray(rgba[..., :3])
    weight = known[..., None].astype(np.float32)
    filled = _pulled(rgba[..., :3] * weight, weight)
    return np.where(known[..., None], rgba[..., :3], _of_type(filled, rgba))


def _pulled(colours: NDArray[np.float32], weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """Colours, multiplied by their weights (h, w, 1), completed from the next coarser level where the weight is low."""
    height, width = weight.shape[:2]
    if min(height, width) > 1 and weight.min() < 1:
        half = ((width + 1) // 2, (height + 1) // 2)
        sums = cv2.resize(np.dstack([colours, weight]), half, interpolation=cv2.INTER_AREA)
        below = _pulled(np.asarray(sums[..., :3], np.float32), np.asarray(sums[..., 3:], np.float32))
        around = cv2.resize(below, (width, height), interpolation=cv2.INTER_LINEAR)
    else:
        around = np.zeros_like(colours)
    own = np.divide(colours, weight, out=np.zeros_like(colours), where=weight > 0)
    share = np.minimum(weight * 4, 1)
    return np.asarray(share * own + (1 - share) * (around if around.any() else own), np.float32)
