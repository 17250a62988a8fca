"""The painter: a frame and what the eye knows of it become a picture. It remembers the last few paintings, no more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Plane
from pipeline.methods.abstraction.state import Clock, State, flatten, no_clock, part
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.sight import Marks, Sight, unpack
from pipeline.methods.multistyle.styles import STYLES, pigment
from pipeline.strokes.brush import Canvas, Direction
from pipeline.strokes.carry import present
from pipeline.strokes.drag import bare, drag, lay_on
from pipeline.strokes.emboss import emboss, settle_pigment
from pipeline.strokes.linger import Layout, linger
from pipeline.strokes.raster import paint
from pipeline.strokes.trace import draw_out

GRAIN = 0.09
"""How much darker thick paint is in a hollow of paper, of one deviation, where the paper shows fully."""

ROUND, LEAST_ROUND_PX = 0.0018, 0.35
"""Sigma, in heights, over which thick paint is rounded off; below so many px it is not worth it."""

VEIL = 60.0
"""Gray levels that the ground's veil stays below: bare canvas in a dark thing is a glimpse, not a glare."""


def frames_that_linger(params: MultistyleParams) -> int:
    """How many paintings are averaged with the one after them."""
    if params.temporal == "off" or params.renderer == "explicit" or not params.linger:
        return 0
    return params.linger + STYLES[params.style].manner.linger


class Painter:
    """Paints frame after frame of one size. Not thread-safe.

    Its memory is what lingers: a painter that was shown the last frames before (`recall`) goes on with the same bytes.

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
        self.linger = frames_that_linger(params)
        self.past: list[tuple[Sight, Layout]] = []

    def paint(self, sight: Sight) -> Frame:
        """The picture of what was seen: uint8 (h, w, 3)."""
        now = self._layout(sight)
        if not self.linger:
            return now.paint
        with self.clock("linger"):
            picture = linger(now, [before for _, before in self._before(sight)])
        self._keep(sight, now)
        return picture

    def recall(self, sight: Sight) -> None:
        """Paint a frame only to remember it."""
        if self.linger:
            self._keep(sight, self._layout(sight))

    def state(self) -> State:
        """The frames it remembers, as they were seen."""
        return flatten({str(index): sight.pack() for index, (sight, _) in enumerate(self.past)})

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.past = []
        count = len({name.partition(".")[0] for name in state})
        for index in reversed(range(count)):
            self.recall(unpack(part(state, str(index))))

    def _before(self, sight: Sight) -> list[tuple[Sight, Layout]]:
        """What it remembers of the frames right before, the latest first."""
        follows = bool(self.past) and self.past[0][0].number == sight.number - 1 and sight.back is not None
        return self.past if follows else []

    def _keep(self, sight: Sight, now: Layout) -> None:
        self.past = [(sight, now), *self._before(sight)][: self.linger]

    def _layout(self, sight: Sight) -> Layout:
        canvas = self._lay(sight)
        with self.clock("light"):
            self._smooth(canvas)
            lit = emboss(canvas, self.manner.light)
        return Layout(self._dried(lit, sight), sight.picture, sight.way_back())

    def _smooth(self, canvas: Canvas) -> None:
        """Round the paint's height off, in place: its slopes, and so the light on it, are alike at every size."""
        sigma = ROUND * canvas.shape[0]
        if sigma > LEAST_ROUND_PX:
            canvas[..., 3] = cv2.GaussianBlur(np.ascontiguousarray(canvas[..., 3]), (0, 0), sigma)

    def _lay(self, sight: Sight) -> Canvas:
        with self.clock("ground"):
            direction, bottom = sight.direction(self.size), self._ground(sight)
        if self.params.renderer == "implicit":
            return self._implicit(sight, direction, bottom)
        return self._explicit(sight, direction, bottom)

    def _dried(self, lit: Frame, sight: Sight) -> Frame:
        """On paper, if the manner has any."""
        if not self.manner.paper:
            return lit
        with self.clock("paper"):
            grain = GRAIN * self.manner.paper
            return settle_pigment(lit, sight.rims_of(self.size, self.manner.rim), grain)

    def _implicit(self, sight: Sight, direction: Direction, bottom: Plane) -> Canvas:
        """From the uppermost stroke of the finest layer down to the ground."""
        wet = bare(bottom.shape)
        for index in reversed(range(len(sight.layers))):
            marks = sight.layers[index]
            with self.clock(f"layer {index + 1}"):
                drag(
                    wet, present(marks.dots(), marks.presence), direction, marks.lengths_px, marks.uppermost_first,
                    seed=self.seed, touch=self.manner.touch, guide=self._guide(sight, marks),
                    tolerance=marks.tolerance, threads=self.threads,
                )  # fmt: skip
        return lay_on(wet, bottom)

    def _explicit(self, sight: Sight, direction: Direction, bottom: Plane) -> Canvas:
        canvas = np.zeros((*bottom.shape[:2], 7), np.float32)
        canvas[..., :3] = canvas[..., 4:] = bottom
        canvas[..., 4:] = _stretched(sight.picture, self.size)
        for index, marks in enumerate(sight.layers):
            edge = float(np.median(marks.tolerance)) if len(marks) else 0.0
            with self.clock(f"layer {index + 1}"):
                dots, guide = present(marks.dots(), marks.presence), self._guide(sight, marks)
                under = canvas if index else None
                strokes = draw_out(dots, marks.lengths_px, direction, reference=guide, canvas=under, edge=edge)
                paint(canvas, strokes, seed=self.seed, touch=self.manner.touch, guide=guide, tolerance=edge)
        return canvas

    def _guide(self, sight: Sight, marks: Marks) -> Frame:
        return _stretched(_blurred(sight.picture, marks.sigma_px), self.size)

    def _ground(self, sight: Sight) -> Plane:
        """The canvas before the first stroke, float32 (h, w, 3): the picture's broad colours under a veil."""
        manner = self.manner
        broad = _blurred(sight.picture, sight.layers[0].sigma_px * 2)
        colours = pigment(broad.reshape(-1, 3).astype(np.float32), manner.vivid, manner.contrast).reshape(broad.shape)
        own = np.array(manner.ground, np.float32)
        veil = np.float32(manner.cover) * (own - colours)
        veil /= 1 + np.abs(veil) * np.float32(1 / VEIL)
        return np.asarray(_stretched(colours + veil, self.size), np.float32)


def _stretched(image: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    if (image.shape[1], image.shape[0]) == size:
        return image
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR))


def _blurred(picture: Frame, sigma_px: float) -> Frame:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma_px), np.uint8) if sigma_px > 0.3 else picture
