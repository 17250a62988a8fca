"""Painting of the pixels that no patch covers (the remainder).

New remainder pixels are painted from the current frame. In later frames their paint is advected by the optical flow
while it still matches the picture:

    painted frame i - 1               remainder pixel of frame i       result
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

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.jit import kernel
from pipeline.methods.patches.fit import Rendering, apart, fine_px
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.hertzmann import Painter
from pipeline.methods.patches.links import Links

SEEN = 0.02
"""Share of the remainder in a pixel, 0..1, above which the remainder is painted; a smaller share is invisible."""
LEADS_BACK = 0.02
"""Reliability, 0..1, from which a flow vector is valid. It is low because changes of colour are left to the misfit."""
LOST_PX = 3
"""Areas of invalid flow narrower than this, working px, are treated as valid, like their surroundings."""
SOFT_PX = 5
"""Width of the transition between old and new paint, px of a frame 344 px high."""
STAYS, GONE = 0.65, 2.1
"""Misfit, in units of the limit, up to which old paint is kept, and from which it is replaced; blended in between."""
STRETCH = 1.0
"""Relative change of the distance between neighbours above which advected strokes count as distorted. Flow in areas
without texture is arbitrary and would distort them."""
SPAN_PX = 4
"""Distance of those neighbours, px."""
RETURNS = 0.07
"""Largest decrease of the remainder's share in a pixel per painting. The share may increase at any rate."""
FADE = 4
"""Number of paintings in the cross-fade from a run to the next one."""
ROW = 512
"""Row length of the tables given to `cv2.remap`, which limits each side of an image to 32767."""
NOWHERE = -1

Places = NDArray[np.float32]
"""float32 (h, w, 2): positions (x, y), px."""
Shown = Mapping[int, tuple[Frame, Frame]]
"""Frame number -> source picture and its painting, both uint8 (h, w, 3)."""


@dataclass(frozen=True)
class Carried:
    """Source of each pixel's paint: a frame number and a position in that frame.

    Attributes:
        origin: int32 (h, w), number of the source frame, or NOWHERE.
        place: float32 (h, w, 2), position (x, y) in the source frame, px.
    """

    origin: NDArray[np.int32]
    place: Places

    @classmethod
    def here(cls, index: int, shape: tuple[int, ...]) -> Carried:
        """Every pixel comes from frame `index`, at its own position."""
        rows, columns = np.indices(shape[:2], np.float32)
        return cls(np.full(shape[:2], index, np.int32), np.dstack([columns, rows]))

    def follow(self, pair: tuple[Flow, Plane] | None, grid: Grid, where: Mask) -> Carried:
        """Advect the sources to the frame in which `pair` starts.

        Args:
            pair: flow, working px, from the new frame to this one and its reliability; None = no valid flow.
            where: bool (h, w), pixels to compute; all others get NOWHERE.
        """
        out = Carried(np.full_like(self.origin, NOWHERE), np.zeros_like(self.place))
        if pair is not None:
            flow = (grid.enlarge(pair[0]) * np.array(grid.ratio, np.float32)).astype(np.float32)
            leads = grid.enlarge(_leads(pair[1]).astype(np.float32)) > 0.5
            _carry(self.origin, self.place, flow, where & leads, out.origin, out.place)
        return out

    def anew(self, index: int, where: Mask) -> Carried:
        """Replace the source of the pixels in `where` by frame `index`, at their own positions."""
        fresh = Carried.here(index, where.shape)
        return Carried(
            np.where(where, fresh.origin, self.origin), np.where(where[..., None], fresh.place, self.place)
        )  # fmt: skip

    def fetch(self, shown: Shown, which: int, where: Mask) -> NDArray[np.float32]:
        """Sample the source pictures (`which` 0) or paintings (1) at the stored positions: float32 (h, w, 3).

        Pixels outside `where` are 0.
        """
        out = np.zeros((*where.shape, 3), np.float32)
        for source in _sources(self.origin[where]):
            mine = np.flatnonzero(where & (self.origin == source))
            out.reshape(-1, 3)[mine] = _sampled(shown[source][which], self.place.reshape(-1, 2)[mine], bool(which))
        return out


@dataclass
class Remainder:
    """Paints the remainder of the frames of a run, in order.

    Attributes:
        painter: paints new pixels.
        last: number of the previous painted frame; None before the first.
        left: share of the remainder in that frame, float32, 0..1, at the working size.
        carried: source of each pixel's paint in that frame.
        shown: pictures and paintings of the source frames.
        coming: picture and painting of the next run's first frame, by its number.
        turned: that painting advected back to the last frames of this run, with its cross-fade weight, by frame.
        used: True once a frame had a visible remainder.
    """

    painter: Painter
    links: Links
    grid: Grid
    last: int | None = None
    left: Plane | None = None
    carried: Carried = field(default_factory=lambda: Carried.here(NOWHERE, (0, 0)))
    shown: dict[int, tuple[Frame, Frame]] = field(default_factory=dict)
    coming: dict[int, tuple[Frame, Frame]] = field(default_factory=dict)
    turned: dict[int, tuple[Carried, float]] = field(default_factory=dict)
    used: bool = False

    def paint(self, index: int, frame: Frame, left: Plane, limit: Plane) -> Rendering:
        """Picture and painting of the remainder of frame `index`, float32 (2, h, w, 3).

        Args:
            left: float32 (h, w), 0..1, share of the remainder. The result is undefined where it is at most `SEEN`.
            limit: float32 (h, w), tolerated RGB distance.
        """
        seen, self.used = left > SEEN, True
        self.carried = self._now(index, seen)
        old, fits = self._old(self.carried, self.shown, frame, seen, limit)
        rendering, known = self._with_next(index, frame, seen, limit, old, fits)
        if (lacks := seen & (known < 1)).any():
            fresh = (1 - known)[..., None]
            rendering[0] += frame * fresh
            rendering[1] += self._fresh(frame, lacks) * fresh
        self.carried, self.last = self.carried.anew(index, ~seen | (fits < 1)), index
        return rendering

    def lingers(self, index: int, left: Plane) -> Plane:
        """Share of the remainder with a limited decrease: float32 (h, w), 0..1.

        A patch takes a pixel back by at most `RETURNS` per painting, which prevents flicker between the two.
        """
        if self.left is not None and self.last is not None and self.left.max() > RETURNS:
            before = self.left
            for step in range(self.last + 1, index + 1):
                before = _followed(before, self.links.back(step))
            left = np.maximum(left, self.grid.enlarge(before) - np.float32(RETURNS))
        self.left = np.asarray(cv2.resize(left, self.grid.size, interpolation=cv2.INTER_AREA), np.float32)
        return left

    def keep(self, index: int, picture: Frame, shown: Frame) -> None:
        """Store the complete painting of frame `index`, patches included, since they may lose pixels later.

        Args:
            picture: the source colours of the painting, blended like the paint itself.
            shown: the painting.
        """
        if self.last != index:
            self.carried, self.last = Carried.here(index, shown.shape), index
        used = _sources(self.carried.origin)
        self.shown = {key: both for key, both in (self.shown | {index: (picture, shown)}).items() if key in used}

    def turn_to(self, index: int, picture: Frame, shown: Frame, hold: int) -> None:
        """Prepare the cross-fade to the next run, which begins at frame `index` with the painting `shown`."""
        now, self.coming = Carried.here(index, shown.shape), {index: (picture, shown)}
        for step in range(index - 1, index - FADE * hold, -1):
            now = now.follow(self.links.ahead(step), self.grid, np.ones(shown.shape[:2], np.bool_))
            if (index - step) % hold == 0:
                self.turned[step] = now, 1 - (index - step) / (FADE * hold)

    def _now(self, index: int, seen: Mask) -> Carried:
        """Sources of the previous frame's paint, advected to frame `index`."""
        if self.last is None:
            return Carried.here(NOWHERE, seen.shape)
        now = self.carried
        for step in range(self.last + 1, index + 1):
            now = now.follow(self.links.back(step), self.grid, seen if step == index else np.ones_like(seen))
        return now

    def _with_next(
        self, index: int, frame: Frame, seen: Mask, limit: Plane, old: Rendering, fits: Plane
    ) -> tuple[Rendering, Plane]:
        """Weighted sum of old paint and the next run's paint, and the sum of the weights, float32 (h, w), 0..1."""
        if index not in self.turned:
            return old * fits[..., None], fits
        turned, due = self.turned.pop(index)
        coming, coming_fits = self._old(turned, self.coming, frame, seen, limit)
        share = np.float32(due)
        before, after = fits * (1 - share * coming_fits), coming_fits * (share + (1 - share) * (1 - fits))
        return old * before[..., None] + coming * after[..., None], before + after

    def _old(self, carried: Carried, shown: Shown, frame: Frame, seen: Mask, limit: Plane) -> tuple[Rendering, Plane]:
        """Advected picture and paint, and how well it matches the frame, float32 (h, w): 1 = keep, 0 = repaint.

        Pixels outside `seen` are 1.
        """
        known = seen & (carried.origin != NOWHERE)
        rendering = np.stack([carried.fetch(shown, which, known) for which in (0, 1)])
        if not known.any():
            return rendering, (~seen).astype(np.float32)
        sigma = fine_px(self.grid)
        share = np.maximum(cv2.GaussianBlur(known.astype(np.float32), (0, 0), sigma), np.float32(0.1))
        there = np.where(known[..., None], rendering, frame)
        off = apart(frame, there, limit * share, sigma)
        _without_distorted(carried.origin, carried.place, known)
        good = np.where(known, np.clip((GONE - off) / (GONE - STAYS), 0, 1), ~seen).astype(np.float32)
        soft = 2 * int(SOFT_PX * self.grid.height / 688) + 1
        fits = np.minimum(np.clip(2 * cv2.blur(good, (soft, soft), borderType=cv2.BORDER_REPLICATE) - 1, 0, 1), good)
        return rendering, np.where(fits > 0.999, 1, fits).astype(np.float32)

    def _fresh(self, frame: Frame, where: Mask) -> Frame:
        """Paint the frame by itself, near the pixels of `where`."""
        reach = 2 * int(self.painter.reach_px / 4) + 1
        near = cv2.dilate(where.astype(np.uint8), np.ones((reach, reach), np.uint8)) > 0
        return self.painter.part(frame, near)


def _followed(plane: Plane, pair: tuple[Flow, Plane] | None) -> Plane:
    """Warp a plane at the working size by the flow; 0 where the flow is invalid."""
    if pair is None:
        return np.zeros_like(plane)
    rows, columns = np.indices(plane.shape, np.float32)
    found = cv2.remap(plane, columns + pair[0][..., 0], rows + pair[0][..., 1], cv2.INTER_LINEAR)
    return np.where(_leads(pair[1]), found, 0).astype(np.float32)


def _leads(reliable: Plane) -> Mask:
    """Mask of valid flow, bool (h, w); invalid areas narrower than `LOST_PX` count as valid."""
    lost = (reliable < LEADS_BACK).astype(np.uint8)
    return np.asarray(cv2.morphologyEx(lost, cv2.MORPH_OPEN, np.ones((LOST_PX, LOST_PX), np.uint8)) == 0)


def _sources(origin: NDArray[np.int32]) -> list[int]:
    """Sorted numbers of the source frames in `origin`."""
    first = int(origin.min(initial=np.iinfo(np.int32).max))
    return (np.flatnonzero(np.bincount(origin.ravel() - first)) + first).tolist()


def _sampled(picture: Frame, places: Places, sharp: bool) -> Frame:
    """Sample a picture at float32 (n, 2) positions: uint8 (n, 3). Bicubic if `sharp`, else bilinear."""
    rows = -(-len(places) // ROW)
    table = np.zeros((2, rows * ROW), np.float32)
    table[:, : len(places)] = places.T
    x, y = table.reshape(2, rows, ROW)
    how = cv2.INTER_CUBIC if sharp else cv2.INTER_LINEAR
    found = cv2.remap(picture, x, y, how, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found.reshape(-1, 3)[: len(places)], np.uint8)


@kernel
def _carry(
    origin: NDArray[np.int32], place: Places, flow: Flow, where: Mask, out: NDArray[np.int32], out_place: Places
) -> None:
    """Sample source frame and position at the flow's target.

    The source frame is that of the nearest pixel; the position is interpolated among those of the four surrounding
    pixels that have the same source frame.
    """
    height, width = where.shape
    for y in range(height):
        for x in range(width):
            if not where[y, x]:
                continue
            u = min(max(np.float32(x) + flow[y, x, 0], np.float32(0)), np.float32(width - 1))
            v = min(max(np.float32(y) + flow[y, x, 1], np.float32(0)), np.float32(height - 1))
            source = origin[int(v + np.float32(0.5)), int(u + np.float32(0.5))]
            if source < 0:
                continue
            column, row = min(int(u), max(width - 2, 0)), min(int(v), max(height - 2, 0))
            a, b = u - np.float32(column), v - np.float32(row)
            total, at_x, at_y = np.float32(0), np.float32(0), np.float32(0)
            for corner in range(4):
                r, c = min(row + corner // 2, height - 1), min(column + corner % 2, width - 1)
                if origin[r, c] == source:
                    share = (b if corner >= 2 else np.float32(1) - b) * (a if corner % 2 else np.float32(1) - a)
                    total += share
                    at_x += share * (place[r, c, 0] - np.float32(c) + u)
                    at_y += share * (place[r, c, 1] - np.float32(r) + v)
            out[y, x] = source
            out_place[y, x, 0], out_place[y, x, 1] = at_x / total, at_y / total


@kernel
def _without_distorted(origin: NDArray[np.int32], place: Places, where: Mask) -> None:
    """Clear pixels of `where`, in place, whose distance to a neighbour of the same source frame has changed too much.

    The limit is `STRETCH` times the distance `SPAN_PX`.
    """
    height, width = where.shape
    most = np.float32(STRETCH * SPAN_PX)
    for y in range(height):
        for x in range(width):
            if not where[y, x]:
                continue
            for axis in range(2):
                r, c = y + (SPAN_PX if axis else 0), x + (0 if axis else SPAN_PX)
                if r >= height or c >= width or origin[r, c] != origin[y, x]:
                    r, c = y - (SPAN_PX if axis else 0), x - (0 if axis else SPAN_PX)
                if r < 0 or c < 0 or origin[r, c] != origin[y, x]:
                    continue
                along = abs(place[r, c, 0] - place[y, x, 0] - np.float32(c - x))
                across = abs(place[r, c, 1] - place[y, x, 1] - np.float32(r - y))
                where[y, x] = where[y, x] and max(along, across) <= most
