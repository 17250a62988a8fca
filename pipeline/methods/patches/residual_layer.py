"""Residual layer: painting of the pixels that no patch covers.

New residual pixels are painted from the current frame. In later frames their paint is advected by the optical flow
while it still matches the picture:

    painted frame i - 1               residual pixel of frame i        result
      paint of a patch    -------->   flow is valid, paint matches     advected paint
      single-frame paint  -------->   flow is valid, paint matches     advected paint
      any                 -------->   no valid flow, or it changed     painted from frame i alone

Each run of frames is a separate task and begins with new paint. The last few frames of a run are cross-faded to the
painting of the next run's first frame, advected backward.

Departure from zhang2011patches, section 5, which paints unclustered pixels in each frame separately: most pixels that
cannot be clustered can still be followed from one frame to the next, which lowers the flicker.

hertzmann2000video also repaints only where the picture has changed. Departures from it: repeated warping would blur
the paint, so each pixel stores the frame and position where its paint was made and samples it once; where paint
matches partly, old and new paint are blended (flicker 0.54 -> 0.52 on the running actor).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from pipeline.arrays import AnyArray, Arrays, State
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.gaussian import upscale_cells
from pipeline.kernels.executors import INLINE, FrameExecutor
from pipeline.kernels.jit import kernel
from pipeline.methods.patches.face_strokes import FacePlanes
from pipeline.methods.patches.paint_error import Rendering, cell_px, fine_sigma_px, misfit
from pipeline.methods.patches.paint_source import NO_SOURCE, Paintings, PaintSource, valid_flow
from pipeline.methods.patches.paint_sum import WeightedSum, add_weighted
from pipeline.methods.patches.painter import HertzmannPainter
from pipeline.methods.patches.scan import WorkingGrid
from pipeline.methods.patches.window_flow import WindowFlow

VISIBLE_OPACITY = 0.02
"""Least opacity of the residual layer in a pixel, 0..1, for painting it; a lower opacity is invisible."""
TRANSITION_PX = 5
"""Width of the transition between old and new paint, px of a frame 344 px high."""
KEEP_MISFIT, REPLACE_MISFIT = 0.65, 2.1
"""Misfit up to which old paint is kept, and misfit from which it is replaced. In between, both are blended."""
MAX_OPACITY_DECREASE = 0.07
"""Largest decrease of the opacity of a pixel per painting. The opacity may increase at any rate."""
FADE_PAINTINGS = 4
"""Number of paintings in the cross-fade from a run to the next one."""


@dataclass(frozen=True)
class FirstPainting:
    """Painting of a run's first frame, and the state of the residual layer after it.

    Attributes:
        index: number of the frame.
        picture, painting: source colours, uint8 (h, w, 3), and paint, patches included, uint8 or uint16 (h, w, 3).
        opacity: float32, 0..1, opacity of the residual layer, at the working size.
        used: whether the residual layer was visible.
    """

    index: int
    picture: Frame
    painting: AnyArray
    opacity: Plane
    used: bool

    @classmethod
    def of(cls, index: int, arrays: Arrays) -> FirstPainting:
        """The painting whose method `state` returned these arrays."""
        picture = np.asarray(arrays["picture"], np.uint8)
        return cls(index, picture, arrays["painting"], np.asarray(arrays["opacity"], np.float32), bool(arrays["used"]))

    def state(self) -> State:
        """The arrays by name."""
        return {
            "picture": self.picture, "painting": self.painting, "opacity": self.opacity, "used": np.array(self.used),
        }  # fmt: skip


@dataclass
class ResidualLayer:
    """Paints the residual layer of the frames of a run, in order.

    Attributes:
        painter: paints new pixels.
        background: its helper takes a part of the work.
        last: number of the previous painted frame; None before the first.
        opacity: opacity of the residual layer in that frame, float32, 0..1, at the working size.
        source: source of each pixel's paint in that frame.
        paintings: pictures and paintings of the source frames.
        next_painting: picture and painting of the next run's first frame, by its number.
        next_source: that painting advected back to the last frames of this run, with its cross-fade weight, by frame.
        used: True once a frame had a visible residual layer.
    """

    painter: HertzmannPainter
    flow: WindowFlow
    grid: WorkingGrid
    background: FrameExecutor = INLINE
    last: int | None = None
    opacity: Plane | None = None
    source: PaintSource = field(default_factory=lambda: PaintSource.identity(NO_SOURCE, (0, 0)))
    paintings: dict[int, Rendering] = field(default_factory=dict)
    next_painting: dict[int, Rendering] = field(default_factory=dict)
    next_source: dict[int, tuple[PaintSource, float]] = field(default_factory=dict)
    used: bool = False

    def paint(
        self, index: int, frame: Frame, opacity: Plane, limit: Plane, faces: FacePlanes | None = None
    ) -> WeightedSum:  # fmt: skip
        """Picture and painting of the residual layer of frame `index`, float32 (2, h, w, 3).

        Args:
            opacity: float32 (h, w), 0..1. The result is undefined where it is at most
                `VISIBLE_OPACITY`.
            limit: float32 (h, w), tolerated RGB distance.
            faces: where strokes are added on faces; None = nowhere.
        """
        visible, self.used = opacity > VISIBLE_OPACITY, True
        self.source = self._advected_source(index, visible)
        old, weight = self._old_paint(self.source, self.paintings, frame, visible, limit)
        rendering, total = self._with_next_run(index, frame, visible, limit, old, weight)
        if (incomplete := visible & (total < 1)).any():
            painting = self.painter.paint_part(frame, incomplete, faces, self.background)
            add_weighted(rendering, (frame, painting), 1 - total)
        self.source, self.last = self.source.reset(index, ~visible | (weight < 1)), index
        return rendering

    def limited_opacity(self, index: int, opacity: Plane) -> Plane:
        """Opacity of the layer with a limited decrease: float32 (h, w), 0..1.

        Patches regain a pixel by at most `MAX_OPACITY_DECREASE` per painting, which prevents flicker between the two.

        Args:
            opacity: float32 (h, w), 0..1, opacity that the patches leave to the layer in frame `index`.
        """
        if self.opacity is not None and self.last is not None and self.opacity.max() > MAX_OPACITY_DECREASE:
            previous = self.opacity
            for step in range(self.last + 1, index + 1):
                previous = _warped(previous, self.flow.backward(step))
            opacity = np.maximum(opacity, self.grid.upscale(previous) - np.float32(MAX_OPACITY_DECREASE))
        self.opacity = np.asarray(cv2.resize(opacity, self.grid.size, interpolation=cv2.INTER_AREA), np.float32)
        return opacity

    def store(self, index: int, picture: Frame, painting: AnyArray) -> None:
        """Store the complete painting of frame `index`, patches included, since they may lose pixels later.

        Args:
            picture: the source colours of the painting, blended like the paint itself.
        """
        if self.last != index:
            self.source, self.last = PaintSource.identity(index, painting.shape), index
        used = self.source.frames()
        paintings = self.paintings | {index: (picture, painting)}
        self.paintings = {key: both for key, both in paintings.items() if key in used}

    @property
    def known_opacity(self) -> Plane:
        """Opacity of the layer in the last frame."""
        assert self.opacity is not None, "a frame was painted"
        return self.opacity

    def restore(self, first: FirstPainting) -> None:
        """Continue after the first frame of the run."""
        self.source, self.last = PaintSource.identity(first.index, first.painting.shape), first.index
        self.paintings = {first.index: (first.picture, first.painting)}
        self.opacity, self.used = first.opacity, first.used

    def prepare_cross_fade(self, following: FirstPainting, frames_per_painting: int) -> None:
        """Prepare the cross-fade to the next run, which begins with this painting."""
        index, painting = following.index, following.painting
        source, self.next_painting = PaintSource.identity(index, painting.shape), {index: (following.picture, painting)}
        every = np.ones(painting.shape[:2], np.bool_)
        frames = FADE_PAINTINGS * frames_per_painting
        for step in range(index - 1, index - frames, -1):
            source = source.advect(self.flow.forward(step), self.grid, every)
            if (index - step) % frames_per_painting == 0:
                self.next_source[step] = source, 1 - (index - step) / frames

    def _advected_source(self, index: int, visible: Mask) -> PaintSource:
        """Sources of the previous painting, advected to frame `index`."""
        if self.last is None:
            return PaintSource.identity(NO_SOURCE, visible.shape)
        source = self.source
        for step in range(self.last + 1, index + 1):
            where = visible if step == index else np.ones_like(visible)
            source = source.advect(self.flow.backward(step), self.grid, where)
        return source

    def _with_next_run(
        self, index: int, frame: Frame, visible: Mask, limit: Plane, old: Rendering, weight: Plane
    ) -> tuple[WeightedSum, Plane]:
        """Weighted sum of old paint and the next run's paint, and the sum of the weights, float32 (h, w), 0..1."""
        rendering = np.zeros((2, *frame.shape), np.float32)
        if index not in self.next_source:
            add_weighted(rendering, old, weight)
            return rendering, weight
        source, cross_fade = self.next_source.pop(index)
        following, following_weight = self._old_paint(source, self.next_painting, frame, visible, limit)
        fade = np.float32(cross_fade)
        before = weight * (1 - fade * following_weight)
        after = following_weight * (fade + (1 - fade) * (1 - weight))
        add_weighted(rendering, old, before)
        add_weighted(rendering, following, after)
        return rendering, before + after

    def _old_paint(
        self, source: PaintSource, paintings: Paintings, frame: Frame, visible: Mask, limit: Plane
    ) -> tuple[Rendering, Plane]:
        """Advected picture and paint, and the weight with which it is kept: float32 (h, w), 0..1.

        The weight is 1 where the paint matches the frame, and outside `visible`.
        """
        known = visible & (source.frame != NO_SOURCE)
        rendering = source.sample(paintings, known)
        if not known.any():
            return rendering, (~visible).astype(np.float32)
        sigma = fine_sigma_px(self.grid)
        off = upscale_cells(misfit(frame, rendering, limit, sigma, known), cell_px(sigma), known.shape)
        source.clear_distorted(known)
        kept = np.empty(known.shape, np.float32)
        _kept(off, known, visible, kept)
        side = 2 * int(TRANSITION_PX * self.grid.unit / 2) + 1
        smooth = np.asarray(cv2.blur(kept, (side, side), borderType=cv2.BORDER_REPLICATE), np.float32)
        _with_transition(smooth, kept)
        return rendering, kept


def _warped(plane: Plane, pair: tuple[Flow, Plane] | None) -> Plane:
    """Warp a plane at the working size by the flow; 0 where the flow is invalid."""
    if pair is None:
        return np.zeros_like(plane)
    rows, columns = np.indices(plane.shape, np.float32)
    warped = cv2.remap(plane, columns + pair[0][..., 0], rows + pair[0][..., 1], cv2.INTER_LINEAR)
    return np.where(valid_flow(pair[1]), warped, 0).astype(np.float32)


@kernel
def _kept(off: Plane, known: Mask, visible: Mask, out: Plane) -> None:
    """Fill `out` with the weight of old paint by its misfit; without paint, 1 outside `visible` and 0 inside."""
    height, width = out.shape
    zero, one = np.float32(0), np.float32(1)
    slope, offset = np.float32(1 / (REPLACE_MISFIT - KEEP_MISFIT)), np.float32(REPLACE_MISFIT)
    for y in range(height):
        for x in range(width):
            fits = min(max((offset - off[y, x]) * slope, zero), one)
            out[y, x] = fits if known[y, x] else (zero if visible[y, x] else one)


@kernel
def _with_transition(smooth: Plane, kept: Plane) -> None:
    """Lower the weight of old paint, in place, towards replaced paint nearby; `smooth` is its mean over a square."""
    height, width = kept.shape
    zero, one, full = np.float32(0), np.float32(1), np.float32(0.999)
    for y in range(height):
        for x in range(width):
            weight = min(min(max(smooth[y, x] + smooth[y, x] - one, zero), one), kept[y, x])
            kept[y, x] = one if weight > full else weight
