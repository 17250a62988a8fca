"""The painter: one frame and what the eye knows of it become one picture. It has no memory."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.frames import Frame, Plane
from pipeline.methods.abstraction.state import Clock, no_clock
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.sight import Marks, Sight
from pipeline.methods.multistyle.styles import STYLES, Manner
from pipeline.strokes.brush import Canvas, Direction
from pipeline.strokes.carry import present
from pipeline.strokes.emboss import emboss
from pipeline.strokes.raster import paint
from pipeline.strokes.sweep import sweep
from pipeline.strokes.trace import draw_out

EDGE_SHRINKS = 0.85
"""Each finer layer keeps to its colour this much more strictly."""


class Painter:
    """Paints frames; safe to call from several threads.

    Args:
        params: the method's.
        size: (width, height), px.
        seed: of all random numbers.
        threads: bands of rows that the implicit renderer works on at once; the bytes are the same.
    """

    def __init__(
        self, params: MultistyleParams, size: tuple[int, int], seed: int, clock: Clock = no_clock, threads: int = 1
    ) -> None:  # fmt: skip
        self.params, self.size, self.seed, self.clock, self.threads = params, size, seed, clock, threads
        self.manner = STYLES[params.style].manner

    def paint(self, frame: Frame, sight: Sight) -> Frame:
        with self.clock("ground"):
            direction = sight.direction(self.size)
            canvas = ground(_blurred(frame, sight.layers[0].sigma_px * 2), self.manner)
        length = sight.length_px(self.size)
        for index, marks in enumerate(sight.layers):
            if len(marks):
                with self.clock(f"layer {index + 1}"):
                    self._layer(canvas, frame, marks, direction, length, index)
        with self.clock("light"):
            return emboss(canvas, self.manner.light)

    def _layer(
        self, canvas: Canvas, frame: Frame, marks: Marks, direction: Direction, length: Plane, index: int
    ) -> None:
        recipe, touch = self.manner.recipe, self.manner.touch
        guide = _blurred(frame, marks.sigma_px)
        edge = recipe.edge * EDGE_SHRINKS**index
        dots = present(marks.dots(), marks.presence)
        if self.params.renderer == "implicit":
            sweep(
                canvas, dots, direction, length * np.float32(recipe.ratio ** (index / 2)), seed=self.seed, touch=touch,
                guide=guide, tolerance=edge, threads=self.threads, order=marks.uppermost_first,
            )  # fmt: skip
            return
        under = canvas if index else None
        strokes = draw_out(dots, marks.lengths_px, direction, reference=guide, canvas=under, edge=edge)
        paint(canvas, strokes, seed=self.seed, touch=touch, guide=guide, tolerance=edge)


def ground(picture: Frame, manner: Manner) -> Canvas:
    """The canvas before the first stroke: the picture's broad colours, under a veil of the ground's own."""
    height, width = picture.shape[:2]
    canvas = np.zeros((height, width, 7), np.float32)
    canvas[..., :3] = canvas[..., 4:] = picture
    if manner.cover > 0:
        own = np.array(manner.ground, np.float32)
        canvas[..., :3] += np.float32(manner.cover) * (own - canvas[..., :3])
    return canvas


def _blurred(frame: Frame, sigma_px: float) -> Frame:
    return np.asarray(cv2.GaussianBlur(frame, (0, 0), sigma_px), np.uint8) if sigma_px > 0.3 else frame
