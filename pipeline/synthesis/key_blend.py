"""Blends the pictures that two keyframes give for a frame between them, in the gradient domain.

Source: jamriska2019stylizing, section 3.4: the gradients come from the picture in which each pixel belongs to one
keyframe, the colours from a blend of both keyframes, and a screened Poisson equation joins the two. Departures:

- The picture is the result of one synthesis instead of two separate ones.
- Colours are blended only where the keyframes show what the frame shows. A moving object would leave a ghost.
- Gradients change only between pixels from distant positions. Neighbours often skip or repeat a pixel of a keyframe,
  and thin lines would lose their contrast.
- The blend is the weighted mean instead of one that preserves contrast (heitz2018high): where both keyframes show the
  same, it keeps their contrast.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Mask
from pipeline.synthesis.images import Bytes, Offsets

_STIFFNESS = 0.004
"""Weight of colours relative to gradients, 1/px^2: colours are adjusted over about 1 / sqrt(0.004) = 16 px."""
_SEAM_PX = 4
"""Distance between the positions of two neighbours, px, above which there is a seam between them."""
_ALIKE_LEVELS = 8.0
"""Difference between the scene and what the keyframes show of it, levels of 8-bit CIELAB, at which the blend has 1/e of
its weight."""
_ALIKE_RADIUS_PX = 4
"""Radius of the box over which that difference is averaged, so that noise does not count."""


@dataclass(frozen=True)
class KeyPicture:
    """The picture that one keyframe gives for a frame, and its weight.

    Attributes:
        colours: the keyframe advected along the motion, uint8 (h, w, 3).
        scene: the frame that it was painted over, advected in the same way, CIELAB, uint8 (h, w, 3).
        known: pixels that are visible in the keyframe, bool (h, w).
        weight: 0..1; the weights of both keyframes have a sum of 1.
        nearness: 0..1, 1 at the keyframe and 0 at the other one, in time.
    """

    colours: Bytes
    scene: Bytes
    known: Mask
    weight: float
    nearness: float


@dataclass(frozen=True)
class Synthesised:
    """A synthesised frame with the gradients that its pixels have in the keyframes.

    Attributes:
        colours: S^(M(p)), uint8 (h, w, 3).
        right: S^(M(p) + (1, 0)), uint8 (h, w, 3): colour to the right of the pixel in its keyframe.
        below: S^(M(p) + (0, 1)), uint8 (h, w, 3).
        offsets: M(p), position (x, y) of each pixel in the image of all keyframes, float32 (h, w, 2).
        scene: the frame of the video, CIELAB, uint8 (h, w, 3).
    """

    colours: Bytes
    right: Bytes
    below: Bytes
    offsets: Offsets
    scene: Bytes


def with_blended_colours(frame: Synthesised, before: KeyPicture, after: KeyPicture, amount: float) -> Bytes:
    """Adjust the colours of a synthesised frame to the blend of both keyframes, keeping the gradients of its pixels.

    Seams between pixels of different keyframes, or of distant parts of one, are no gradients of either, and disappear.

    Args:
        amount: 0 = unchanged, 1 = adjusted completely.

    Returns:
        uint8 (h, w, 3). Its colours are in general no colours of the keyframes.
    """
    keys, picture = (before, after), frame.colours.astype(np.float32)
    alike = _likeness(frame.scene, keys)
    blend = _mean([key.colours for key in keys], keys, [key.weight for key in keys])
    source = np.float32(_STIFFNESS) * alike[..., None] * (blend - picture)
    for axis, neighbour in ((1, frame.right), (0, frame.below)):
        here = tuple(slice(None, -1) if k == axis else slice(None) for k in (0, 1))
        there = tuple(slice(1, None) if k == axis else slice(None) for k in (0, 1))
        jump = np.abs(np.diff(frame.offsets, axis=axis) - np.array([axis, 1 - axis], np.float32)).max(-1)
        counts = np.where(jump > _SEAM_PX, np.minimum(alike[here], alike[there]), np.float32(0))
        seam = counts[..., None] * (neighbour[here] - picture[there])
        source[here] -= seam
        source[there] += seam
    change = np.dstack([_screened_poisson(plane) for plane in np.moveaxis(source, -1, 0)])
    return np.asarray(np.rint(picture + amount * change).clip(0, 255), np.uint8)


def _likeness(scene: Bytes, keys: tuple[KeyPicture, KeyPicture]) -> NDArray[np.float32]:
    """How well the scene is what the visible keyframes show of it, 0..1, float32 (h, w); light may change evenly."""
    known = keys[0].known | keys[1].known
    difference = scene - _mean([key.scene for key in keys], keys, [key.nearness for key in keys])
    difference[~known] = 0
    averaged = cv2.blur(difference, (2 * _ALIKE_RADIUS_PX + 1,) * 2)
    return np.where(known, np.exp((averaged**2).sum(-1) / np.float32(-(_ALIKE_LEVELS**2))), np.float32(0))


def _mean(pictures: list[Bytes], keys: tuple[KeyPicture, KeyPicture], weights: list[float]) -> NDArray[np.float32]:
    """Weighted mean of the pictures of those keyframes that are visible, float32 (h, w, 3); 0 where none is."""
    shares = [np.float32(weight) * key.known for key, weight in zip(keys, weights, strict=True)]
    total = np.maximum(shares[0] + shares[1], np.float32(1e-6))
    mean = sum((share / total)[..., None] * picture for share, picture in zip(shares, pictures, strict=True))
    return np.asarray(mean, np.float32)


def _screened_poisson(source: NDArray[np.float32]) -> NDArray[np.float64]:
    """The x with `_STIFFNESS` x - laplacian(x) = `source`, without flow through the border; (h, w).

    The cosine transform diagonalises the equation. OpenCV's needs even sizes: the last row or column is repeated.
    """
    height, width = source.shape
    even = cv2.copyMakeBorder(source.astype(np.float64), 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE)
    down, across = (2 - 2 * np.cos(np.pi * np.arange(size) / size) for size in even.shape)
    return np.asarray(cv2.idct(cv2.dct(even) / (_STIFFNESS + down[:, None] + across)))[:height, :width]
