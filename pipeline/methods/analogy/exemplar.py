"""A style pair for those who have given none: a procedural scene, and the same painted in short strokes."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from pipeline.frames import Frame
from pipeline.scenes import scene
from pipeline.strokes.brush import Brush
from pipeline.strokes.emboss import emboss
from pipeline.strokes.layers import paint_still
from pipeline.tensors.structure import structure_tensor, tangent_field

_SIZE = (480, 320)
_BRUSH = Brush(size_px=9, length_px=34, jitter=0.35, relief_px=1.0, grain=0.5)


@cache
def own_pair() -> tuple[Frame, Frame]:
    """(S, S^): a face before lights, and its painting; uint8 (320, 480, 3). The same bytes always."""
    plain = scene("portrait", _SIZE, frames=1).image(0)
    gray = cv2.cvtColor(plain, cv2.COLOR_RGB2GRAY).astype(np.float32)
    along = tangent_field(structure_tensor(gray, 6.0), 0.0)
    doubled = np.stack([along[..., 0] ** 2 - along[..., 1] ** 2, 2 * along[..., 0] * along[..., 1]], -1)
    field = np.where((along == 0).all(-1, keepdims=True), np.array([1, 0], np.float32), doubled).astype(np.float32)
    return plain, emboss(paint_still(plain, field, _BRUSH, threshold=24.0))
