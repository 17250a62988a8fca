"""The default style pair: one frame of the video, and the same frame painted in short strokes.

It is used when the job has no painting. Such a style contains every tone and hue of the video.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from pipeline.frames import Frame
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.base import TaskContext
from pipeline.strokes.brush import Brush
from pipeline.strokes.emboss import emboss
from pipeline.strokes.layers import StillPainting, paint_still
from pipeline.tensors.structure import structure_tensor, tangent_field
from pipeline.video.contact import fit

DEFAULT_PAIR = "own"
"""Name of the artefact that the step `scan` saves."""
_SIDE_PX = 960
_BRUSH = Brush(size_px=9, length_px=34, jitter=0.35, relief_px=1.0, grain=0.5)
"""Stroke sizes for a picture 320 px high; they grow with the height."""


def save_default_pair(context: TaskContext[AnalogyParams], frames: int) -> None:
    """Paint the middle frame of a video of `frames` frames; save both pictures as an artefact."""
    plain = fit(next(context.frames("video", frames // 2, frames // 2 + 1)), _SIDE_PX)
    context.save(DEFAULT_PAIR, {"plain": plain, "painting": paint_in_strokes(plain)})


def default_pair(context: TaskContext[AnalogyParams]) -> tuple[Frame, Frame]:
    """Load (S, S^) as saved by `save_default_pair`: uint8 (h, w, 3), at most 960 px on the longer side."""
    saved = context.load("scan", DEFAULT_PAIR)
    return np.asarray(saved["plain"], np.uint8), np.asarray(saved["painting"], np.uint8)


def paint_in_strokes(plain: Frame) -> Frame:
    """Paint a picture in short embossed strokes of its own colours. Deterministic; uint8 (h, w, 3)."""
    gray = cv2.cvtColor(plain, cv2.COLOR_RGB2GRAY).astype(np.float32)
    along = tangent_field(structure_tensor(gray, 6.0), 0.0)
    doubled = np.stack([along[..., 0] ** 2 - along[..., 1] ** 2, 2 * along[..., 0] * along[..., 1]], -1)
    field = np.where((along == 0).all(-1, keepdims=True), np.array([1, 0], np.float32), doubled).astype(np.float32)
    scale = max(1.0, plain.shape[0] / 320)
    brush = replace(_BRUSH, size_px=_BRUSH.size_px * scale, length_px=_BRUSH.length_px * scale)
    return emboss(paint_still(plain, field, StillPainting(brush, threshold=24.0)))
