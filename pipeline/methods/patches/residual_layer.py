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
cannot be clustered can still be followed from one frame to the next. Relative to single-frame painting, flicker fell
from 0.67 to 0.49 on a running actor (chaplin) and from 0.50 to 0.37 on a lifted kettle (coffee); it rose on no clip.

hertzmann2000video also repaints only where the picture has changed. Departures from it: repeated warping would blur
the paint, so each pixel stores the frame and position where its paint was made and samples it once; where paint
matches partly, old and new paint are blended (flicker 0.54 -> 0.52 on the running actor).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.flow.warp import scale_flow
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.gaussian import enlarge_cells
from pipeline.jit import kernel
from pipeline.methods.patches.face_strokes import FacePlanes
from pipeline.methods.patches.paint_error import Rendering, cell_px, fine_sigma_px, misfit
from pipeline.methods.patches.paint_sum import WeightedSum, add_weighted
from pipeline.methods.patches.painter import HertzmannPainter
from pipeline.methods.patches.scan import PAPER_HEIGHT, WorkingGrid
from pipeline.methods.patches.window_flow import WindowFlow

VISIBLE_OPACITY = 0.02
"""Least opacity of the residual layer in a pixel, 0..1, for painting it; a lower opacity is invisible."""
MIN_RELIABILITY = 0.02
"""Reliability, 0..1, from which a flow vector is valid. It is low because changes of colour are left to the misfit."""
MIN_INVALID_PX = 3
"""Areas of invalid flow narrower than this, working px, are treated as valid, like their surroundings."""
TRANSITION_PX = 5
"""Width of the transition between old and new paint, px of a frame 344 px high."""
KEEP_MISFIT, REPLACE_MISFIT = 0.65, 2.1
"""Misfit up to which old paint is kept, and misfit from which it is replaced. In between, both are blended."""
MAX_STRETCH = 1.0
"""Relative change of the distance between neighbours above which advected strokes count as distorted. Flow in areas
without texture is arbitrary and would distort them."""
NEIGHBOUR_PX = 4
"""Distance of those neighbours, px."""
MAX_OPACITY_DECREASE = 0.07
"""Largest decrease of the opacity of a pixel per painting. The opacity may increase at any rate."""
FADE_PAINTINGS = 4
"""Number of paintings in the cross-fade from a run to the next one."""
REMAP_ROW = 512
"""Row length of the tables given to `cv2.remap`, which limits each side of an image to 32767."""
NO_SOURCE = -1

Positions = NDArray[np.float32]
"""float32 (h, w, 2): positions (x, y), px."""
Paintings = Mapping[int, tuple[Frame, Frame]]
"""Frame number -> source picture and its painting, both uint8 (h, w, 3)."""


@dataclass(frozen=True)
class PaintSource:
    """Source of each pixel's paint: a frame number and a position in that frame.

    Attributes:
        frame: int32 (h, w), number of the source frame, or NO_SOURCE.
        position: float32 (h, w, 2), position (x, y) in the source frame, px.
    """

    frame: NDArray[np.int32]
    position: Positions

    @classmethod
    def identity(cls, index: int, shape: tuple[int, ...]) -> PaintSource:
        """Every pixel comes from frame `index`, at its own position."""
        out = cls(np.empty(shape[:2], np.int32), np.empty((*shape[:2], 2), np.float32))
        _reset(index, np.ones(shape[:2], np.bool_), out.frame, out.position)
        return out

    def advect(self, pair: tuple[Flow, Plane] | None, grid: WorkingGrid, where: Mask) -> PaintSource:
        """Advect the sources to the frame in which `pair` starts.

        Args:
            pair: flow, working px, from the new frame to this one and its reliability; None = no valid flow.
            where: bool (h, w), pixels to compute; all others get NO_SOURCE.
        """
        out = PaintSource(np.full_like(self.frame, NO_SOURCE), np.zeros_like(self.position))
        if pair is not None:
            flow = scale_flow(np.asarray(grid.enlarge(pair[0]), np.float32), *grid.ratio)
            valid = np.asarray(grid.enlarge(_valid_flow(pair[1]).astype(np.float32)), np.float32)
            _advect(self.frame, self.position, flow, where, valid, out.frame, out.position)
        return out

    def reset(self, index: int, where: Mask) -> PaintSource:
        """Replace the source of the pixels in `where` by frame `index`, at their own positions."""
        out = PaintSource(self.frame.copy(), self.position.copy())
        _reset(index, where, out.frame, out.position)
        return out

    def sample(self, paintings: Paintings, where: Mask) -> Rendering:
        """Sample the source pictures and their paintings at the stored positions: uint8 (2, h, w, 3).

        Pixels outside `where` are 0.
        """
        out = np.zeros((2, *where.shape, 3), np.uint8)
        first, last = min(paintings, default=0), max(paintings, default=0)
        pixels, positions = np.empty(where.size, np.int32), np.empty((where.size, 2), np.float32)
        bounds = np.zeros(last - first + 2, np.int64)
        _group(self.frame, self.position, where, first, bounds, pixels, positions)
        for source, (start, stop) in enumerate(pairwise(bounds.tolist()), start=first):
            if stop > start:
                for which, plane in enumerate(out):
                    found = _sampled(paintings[source][which], positions[start:stop], bicubic=which == 1)
                    _scatter(found, pixels[start:stop], plane)
        return out


@dataclass(frozen=True)
class FirstPainting:
    """Painting of a run's first frame, and the state of the residual layer after it.

    Attributes:
        index: number of the frame.
        picture, painting: uint8 (h, w, 3), source colours and paint, patches included.
        opacity: float32, 0..1, opacity of the residual layer, at the working size.
        used: whether the residual layer was visible.
    """

    index: int
    picture: Frame
    painting: Frame
    opacity: Plane
    used: bool

    @classmethod
    def of(cls, index: int, arrays: Arrays) -> FirstPainting:
        """From the arrays that `state` returned."""
        picture, painting = (np.asarray(arrays[name], np.uint8) for name in ("picture", "painting"))
        return cls(index, picture, painting, np.asarray(arrays["opacity"], np.float32), bool(arrays["used"]))

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
    last: int | None = None
    opacity: Plane | None = None
    source: PaintSource = field(default_factory=lambda: PaintSource.identity(NO_SOURCE, (0, 0)))
    paintings: dict[int, tuple[Frame, Frame]] = field(default_factory=dict)
    next_painting: dict[int, tuple[Frame, Frame]] = field(default_factory=dict)
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
            add_weighted(rendering, np.stack([frame, self.painter.paint_part(frame, incomplete, faces)]), 1 - total)
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
            opacity = np.maximum(opacity, self.grid.enlarge(previous) - np.float32(MAX_OPACITY_DECREASE))
        self.opacity = np.asarray(cv2.resize(opacity, self.grid.size, interpolation=cv2.INTER_AREA), np.float32)
        return opacity

    def store(self, index: int, picture: Frame, painting: Frame) -> None:
        """Store the complete painting of frame `index`, patches included, since they may lose pixels later.

        Args:
            picture: the source colours of the painting, blended like the paint itself.
        """
        if self.last != index:
            self.source, self.last = PaintSource.identity(index, painting.shape), index
        used = _source_frames(self.source.frame)
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
        rendering = np.zeros(old.shape, np.float32)
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
        off = enlarge_cells(misfit(frame, rendering, limit, sigma, known), cell_px(sigma), known.shape)
        _clear_distorted(source.frame, source.position, known)
        kept = np.empty(known.shape, np.float32)
        _kept(off, known, visible, kept)
        side = 2 * int(TRANSITION_PX * self.grid.height / (2 * PAPER_HEIGHT)) + 1
        smooth = np.asarray(cv2.blur(kept, (side, side), borderType=cv2.BORDER_REPLICATE), np.float32)
        _with_transition(smooth, kept)
        return rendering, kept


def _warped(plane: Plane, pair: tuple[Flow, Plane] | None) -> Plane:
    """Warp a plane at the working size by the flow; 0 where the flow is invalid."""
    if pair is None:
        return np.zeros_like(plane)
    rows, columns = np.indices(plane.shape, np.float32)
    warped = cv2.remap(plane, columns + pair[0][..., 0], rows + pair[0][..., 1], cv2.INTER_LINEAR)
    return np.where(_valid_flow(pair[1]), warped, 0).astype(np.float32)


def _valid_flow(reliable: Plane) -> Mask:
    """Mask of valid flow, bool (h, w); invalid areas narrower than `MIN_INVALID_PX` count as valid."""
    invalid = (reliable < MIN_RELIABILITY).astype(np.uint8)
    square = np.ones((MIN_INVALID_PX, MIN_INVALID_PX), np.uint8)
    return np.asarray(cv2.morphologyEx(invalid, cv2.MORPH_OPEN, square) == 0)


def _source_frames(frames: NDArray[np.int32]) -> list[int]:
    """Sorted numbers of the source frames in `frames`."""
    if not frames.size:
        return []
    first, last = int(frames.min()), int(frames.max())
    flags = np.zeros(last - first + 1, np.bool_)
    _flag(frames, first, flags)
    return (np.flatnonzero(flags) + first).tolist()


@kernel
def _flag(frames: NDArray[np.int32], first: int, flags: Mask) -> None:
    height, width = frames.shape
    for y in range(height):
        for x in range(width):
            flags[frames[y, x] - first] = True


def _sampled(picture: Frame, positions: Positions, *, bicubic: bool) -> Frame:
    """Sample a picture at float32 (n, 2) positions: uint8 (n, 3). Bilinear unless `bicubic`."""
    rows = -(-len(positions) // REMAP_ROW)
    table = np.empty((2, rows * REMAP_ROW), np.float32)
    table[:, : len(positions)] = positions.T
    table[:, len(positions) :] = 0
    x, y = table.reshape(2, rows, REMAP_ROW)
    interpolation = cv2.INTER_CUBIC if bicubic else cv2.INTER_LINEAR
    found = cv2.remap(picture, x, y, interpolation, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found.reshape(-1, 3)[: len(positions)], np.uint8)


@kernel
def _reset(index: int, where: Mask, frames: NDArray[np.int32], position: Positions) -> None:
    height, width = where.shape
    for y in range(height):
        for x in range(width):
            if where[y, x]:
                frames[y, x] = index
                position[y, x, 0], position[y, x, 1] = x, y


@kernel
def _group(
    frames: NDArray[np.int32], position: Positions, where: Mask, first: int, bounds: NDArray[np.int64],
    pixels: NDArray[np.int32], positions: Positions,
) -> None:  # fmt: skip
    """Sort the pixels of `where` by source frame: their flat indices and positions.

    Args:
        first: number of the first source frame.
        bounds: zeros; where the pixels of each source frame begin, and where the last ones end.
    """
    height, width = where.shape
    used = np.zeros(len(bounds), np.int64)
    for y in range(height):
        for x in range(width):
            if where[y, x]:
                used[frames[y, x] - first] += 1
    for k in range(len(bounds) - 1):
        bounds[k + 1] = bounds[k] + used[k]
        used[k] = bounds[k]
    for y in range(height):
        for x in range(width):
            if where[y, x]:
                at = used[frames[y, x] - first]
                used[frames[y, x] - first] = at + 1
                pixels[at] = y * width + x
                positions[at, 0], positions[at, 1] = position[y, x, 0], position[y, x, 1]


@kernel
def _scatter(colours: NDArray[np.uint8], pixels: NDArray[np.int32], out: Frame) -> None:
    width = out.shape[1]
    for k in range(len(pixels)):
        y, x = pixels[k] // width, pixels[k] % width
        out[y, x, 0], out[y, x, 1], out[y, x, 2] = colours[k, 0], colours[k, 1], colours[k, 2]


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


@kernel
def _advect(
    frames: NDArray[np.int32],
    position: Positions,
    flow: Flow,
    where: Mask,
    valid: Plane,
    out: NDArray[np.int32],
    out_position: Positions,
) -> None:
    """Sample source frame and position at the flow's target, where the flow is `valid` by more than half.

    The source frame is that of the nearest pixel; the position is interpolated among those of the four surrounding
    pixels that have the same source frame.
    """
    height, width = where.shape
    for y in range(height):
        for x in range(width):
            if not where[y, x] or not valid[y, x] > np.float32(0.5):
                continue
            u = min(max(np.float32(x) + flow[y, x, 0], np.float32(0)), np.float32(width - 1))
            v = min(max(np.float32(y) + flow[y, x, 1], np.float32(0)), np.float32(height - 1))
            source = frames[int(v + np.float32(0.5)), int(u + np.float32(0.5))]
            if source < 0:
                continue
            column, row = min(int(u), max(width - 2, 0)), min(int(v), max(height - 2, 0))
            a, b = u - np.float32(column), v - np.float32(row)
            total, at_x, at_y = np.float32(0), np.float32(0), np.float32(0)
            for corner in range(4):
                r, c = min(row + corner // 2, height - 1), min(column + corner % 2, width - 1)
                if frames[r, c] == source:
                    weight = (b if corner >= 2 else np.float32(1) - b) * (a if corner % 2 else np.float32(1) - a)
                    total += weight
                    at_x += weight * (position[r, c, 0] - np.float32(c) + u)
                    at_y += weight * (position[r, c, 1] - np.float32(r) + v)
            out[y, x] = source
            out_position[y, x, 0], out_position[y, x, 1] = at_x / total, at_y / total


@kernel
def _clear_distorted(frames: NDArray[np.int32], position: Positions, where: Mask) -> None:
    """Clear pixels of `where`, in place, whose distance to a neighbour of the same source frame has changed too much.

    The limit is `MAX_STRETCH` times the distance `NEIGHBOUR_PX`.
    """
    height, width = where.shape
    most = np.float32(MAX_STRETCH * NEIGHBOUR_PX)
    for y in range(height):
        for x in range(width):
            if not where[y, x]:
                continue
            for axis in range(2):
                r, c = y + (NEIGHBOUR_PX if axis else 0), x + (0 if axis else NEIGHBOUR_PX)
                if r >= height or c >= width or frames[r, c] != frames[y, x]:
                    r, c = y - (NEIGHBOUR_PX if axis else 0), x - (0 if axis else NEIGHBOUR_PX)
                if r < 0 or c < 0 or frames[r, c] != frames[y, x]:
                    continue
                along = abs(position[r, c, 0] - position[y, x, 0] - np.float32(c - x))
                across = abs(position[r, c, 1] - position[y, x, 1] - np.float32(r - y))
                where[y, x] = where[y, x] and max(along, across) <= most
