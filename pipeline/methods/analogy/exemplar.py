"""A style pair for those who have given none: a frame of their own video, and the same painted in short strokes.

So the style has every tone and hue that the video needs, and the scene reads whatever it shows.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from pipeline.frames import Frame
from pipeline.methods.base import Bench
from pipeline.strokes.brush import Brush
from pipeline.strokes.emboss import emboss
from pipeline.strokes.layers import paint_still
from pipeline.tensors.structure import structure_tensor, tangent_field
from pipeline.video.contact import fit

OWN = "own"
"""The artefact of the step `scan`."""
_SIDE_PX = 960
_BRUSH = Brush(size_px=9, length_px=34, jitter=0.35, relief_px=1.0, grain=0.5)
"""In a picture 320 px high."""


def keep_own(bench: Bench, frames: int) -> None:
    """Paint the middle one of the video's `frames`, and keep both as an artefact."""
    plain = fit(next(bench.frames("video", frames // 2, frames // 2 + 1)), _SIDE_PX)
    bench.save(OWN, {"plain": plain, "painting": painted(plain)})


def own_pair(bench: Bench) -> tuple[Frame, Frame]:
    """(S, S^) as `keep_own` has kept them; uint8 (height, width, 3), at most 960 px wide or high."""
    kept = bench.load("scan", OWN)
    return np.asarray(kept["plain"], np.uint8), np.asarray(kept["painting"], np.uint8)


def painted(plain: Frame) -> Frame:
    """A picture in short strokes, in its own colours, with a little relief. The same bytes always."""
    gray = cv2.cvtColor(plain, cv2.COLOR_RGB2GRAY).astype(np.float32)
    along = tangent_field(structure_tensor(gray, 6.0), 0.0)
    doubled = np.stack([along[..., 0] ** 2 - along[..., 1] ** 2, 2 * along[..., 0] * along[..., 1]], -1)
    field = np.where((along == 0).all(-1, keepdims=True), np.array([1, 0], np.float32), doubled).astype(np.float32)
    times = max(1.0, plain.shape[0] / 320)
    brush = replace(_BRUSH, size_px=_BRUSH.size_px * times, length_px=_BRUSH.length_px * times)
    return emboss(paint_still(plain, field, brush, threshold=24.0))
