"""Guides that are computed from the picture itself: its edges, places and faces. Each has a weight, 0 by default.

The style has the same guides, computed from the scene of the painting; without one, from the painting, of which the
strokes are smoothed away. Painted keyframes have those of the frame that they were painted over.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import cv2
import numpy as np

from pipeline.frames import Frame
from pipeline.methods.analogy.inputs import Guide
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.perception.face_masks import head_mask
from pipeline.perception.faces import FaceTracker
from pipeline.synthesis.images import Bytes

_EDGE_SIGMA = 0.002
"""Sigma of the Gaussian before edges are computed, as a fraction of the shorter side; at least 1 px."""
_CLEAR_EDGE = 8.0
"""Gradient of the lightness, gray levels per px, at which the guide of edges has half of its maximum."""


def automatic_guides(params: AnalogyParams) -> tuple[Guide, ...]:
    """The guides of this kind that have a weight."""
    weights = {"edges": params.edge_guide, "places": params.place_guide, "faces": params.face_guide}
    return tuple(Guide(name, weights[name], _CHANNELS[name]) for name in PLANES if weights[name] > 0)


def automatic_planes(guides: tuple[Guide, ...], picture: Frame) -> list[Bytes]:
    """The planes of these guides for a picture, each uint8 (h, w) or (h, w, channels).

    Args:
        guides: some of `automatic_guides`.
        picture: uint8 (h, w, 3): a frame, or the scene of a painting.
    """
    return [PLANES[guide.name](picture) for guide in guides]


def edges(picture: Frame) -> Bytes:
    """Strength of the edges of the lightness, uint8 (h, w): 0 in flat areas, 128 at a gradient of `_CLEAR_EDGE`."""
    sigma = max(1.0, _EDGE_SIGMA * min(picture.shape[:2]))
    gray = cv2.GaussianBlur(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), sigma)
    dx, dy = (cv2.Sobel(gray, cv2.CV_32F, *axis, scale=1 / 8) for axis in ((1, 0), (0, 1)))
    gradient = np.sqrt(dx * dx + dy * dy)
    return np.asarray(np.rint(256 * gradient / (gradient + np.float32(_CLEAR_EDGE))), np.uint8)


def places(picture: Frame) -> Bytes:
    """Place of each pixel, uint8 (h, w, 2): x and y, from 0 at the left and top to 255 at the right and bottom."""
    height, width = picture.shape[:2]
    x, y = (np.rint(np.linspace(0, 255, count)).astype(np.uint8) for count in (width, height))
    return np.stack(np.broadcast_arrays(x[None, :], y[:, None]), axis=-1)


def faces(picture: Frame) -> Bytes:
    """Heads of the frontal faces that are found in the picture alone, uint8 (h, w): 255 inside, soft borders."""
    size = (picture.shape[1], picture.shape[0])
    tracker = FaceTracker(size, 0.0)
    tracker.search_whole(np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8), strength=1.0)
    return np.asarray(np.rint(255 * head_mask(tracker.faces, size, picture.shape[:2])), np.uint8)


PLANES: Mapping[str, Callable[[Frame], Bytes]] = {"edges": edges, "places": places, "faces": faces}
_CHANNELS: Mapping[str, int] = {"edges": 1, "places": 2, "faces": 1}
