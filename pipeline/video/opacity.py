"""Pictures with opacity as frames: over white, as their own colours, or their opacity."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.frames import Frame
from pipeline.video.media import SourceOptions
from pipeline.video.stills import over_white

_LEAST = 16
"""Least opacity, of 255, of a premultiplied pixel whose colour is known: below it, a level is more than a tenth."""


def as_frame(picture: AnyArray, options: SourceOptions) -> Frame:
    """The frame of a picture, uint8 (h, w), (h, w, 3) or (h, w, 4), as `options.opacity` says: "white", "straight" or
    "matte" (the opacity as a gray frame; of a picture without any, white)."""
    if picture.ndim == 2:
        picture = np.dstack([picture] * 3)
    if options.opacity == "matte":
        return np.dstack([picture[..., 3] if picture.shape[2] == 4 else np.full(picture.shape[:2], 255, np.uint8)] * 3)
    if picture.shape[2] == 3:
        return np.ascontiguousarray(picture)
    if options.premultiplied:
        picture = unpremultiplied(picture)
    return (
        over_white(picture) if options.opacity == "white" else extended(picture, _LEAST if options.premultiplied else 1)
    )


def unpremultiplied(rgba: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Straight colours of premultiplied ones, uint8 (h, w, 4); 0 where the opacity is 0."""
    clear = rgba[..., 3:].astype(np.float32)
    straight = rgba[..., :3] * np.divide(255, clear, out=np.zeros_like(clear), where=clear > 0)
    return np.dstack([np.clip(np.rint(straight), 0, 255).astype(np.uint8), rgba[..., 3]])


def extended(rgba: NDArray[np.uint8], least: int = 1) -> Frame:
    """The colours of a picture with straight opacity, uint8 (h, w, 4). Pixels with an opacity below `least`, whose
    colours are unknown, get those of their surroundings, so that no brush and no filter draws a background into the
    visible part. Source: push-pull, Gortler et al.: The lumigraph (SIGGRAPH 1996), section 3.4.2.
    """
    known = rgba[..., 3] >= least
    if known.all() or not known.any():
        return np.ascontiguousarray(rgba[..., :3])
    weight = known[..., None].astype(np.float32)
    filled = _pulled(rgba[..., :3] * weight, weight)
    return np.where(known[..., None], rgba[..., :3], np.clip(np.rint(filled), 0, 255)).astype(np.uint8)


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
