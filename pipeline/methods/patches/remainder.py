"""What belongs to no patch: painted when it comes into view, and carried along the flow for as long as it fits.

    frame i - 1, as it was shown      frame i                         out
      a patch's paint  ----------->   unclustered now, still fits     that paint, where it has gone
      painted alone    ----------->   unclustered still, fits         the same strokes
      anything         ----------->   no way back, or another look    painted alone

Runs of frames are tasks of their own: each begins with new paint, and the last few frames of a run fade over to what
the first frame of the next one is painted like, carried back along the flow.

Departure from zhang2011patches, section 5, which paints unclustered pixels frame by frame: what cannot be tracked as a
thing can mostly be followed from one frame to the next. Flicker fell from 0.67 to 0.49 of painting frame by frame
where an actor runs (chaplin), from 0.50 to 0.37 where a kettle is lifted (coffee), and rose nowhere. The idea is that
of hertzmann2000video: paint again only where the picture has changed. Departure from that one: paint is not moved on
again and again, which smears it; each pixel remembers the frame that its paint is from and where it was there, and is
fetched once. And what fits by half is half repainted (0.54 to 0.52 where the actor runs), which is remembered as that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.patches.fit import Look, apart, fine_px
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.hertzmann import Painter
from pipeline.methods.patches.links import Links
from pipeline.segmentation.jit import kernel

SEEN = 0.02
"""Share from which a pixel's paint is looked for: less cannot be seen."""
LEADS_BACK = 0.02
"""Reliability from which a pixel is where it came from, whatever has become of its colour: that is for the misfit."""
LOST_PX = 3
"""Places narrower than this, working px, whose flow does not lead back go with what is around them."""
SOFT_PX = 5
"""Over so much old paint gives way to new, px of a frame 344 px high."""
STAYS, GONE = 0.65, 2.1
"""Limits up to which carried paint stays, and from which it is gone; between, it is part old and part new."""
STRETCH = 1.0
"""Change of distance to a neighbour, as a part of it, from which carried strokes are distorted: in flat places flow
leads anywhere."""
SPAN_PX = 4
"""How far apart those neighbours are."""
RETURNS = 0.07
"""Share of a pixel that a patch takes back with each painting, once it fits again; what it loses it loses at once."""
FADE = 4
"""Paintings over which a run fades over to the next one."""
ROW = 512
"""Places are looked up in rows of so many, as OpenCV has a most for each side of a picture."""
NOWHERE = -1

Places = NDArray[np.float32]
"""float32 (h, w, 2): (x, y), px."""
Shown = Mapping[int, tuple[Frame, Frame]]
"""By frame: the picture and how it was painted, both uint8 (h, w, 3)."""


@dataclass(frozen=True)
class Carried:
    """Where each pixel's paint is from.

    Attributes:
        origin: int32 (h, w), a frame, or NOWHERE.
        place: where it is there.
    """

    origin: NDArray[np.int32]
    place: Places

    @classmethod
    def here(cls, index: int, shape: tuple[int, ...]) -> Carried:
        """All of it is from this frame."""
        rows, columns = np.indices(shape[:2], np.float32)
        return cls(np.full(shape[:2], index, np.int32), np.dstack([columns, rows]))

    def follow(self, pair: tuple[Flow, Plane] | None, grid: Grid, where: Mask) -> Carried:
        """The same in the frame that the flow leads here from; `where` it is asked for."""
        out = Carried(np.full_like(self.origin, NOWHERE), np.zeros_like(self.place))
        if pair is not None:
            flow = (grid.enlarge(pair[0]) * np.array(grid.ratio, np.float32)).astype(np.float32)
            leads = grid.enlarge(_leads(pair[1]).astype(np.float32)) > 0.5
            _carry(self.origin, self.place, flow, where & leads, out.origin, out.place)
        return out

    def anew(self, index: int, where: Mask) -> Carried:
        """The same, but for what is painted anew in this frame."""
        fresh = Carried.here(index, where.shape)
        return Carried(
            np.where(where, fresh.origin, self.origin), np.where(where[..., None], fresh.place, self.place)
        )  # fmt: skip

    def fetch(self, shown: Shown, which: int, where: Mask) -> NDArray[np.float32]:
        """Pictures (0) or paint (1) from where they are: float32 (h, w, 3)."""
        out = np.zeros((*where.shape, 3), np.float32)
        for source in _sources(self.origin[where]):
            mine = np.flatnonzero(where & (self.origin == source))
            out.reshape(-1, 3)[mine] = _sampled(shown[source][which], self.place.reshape(-1, 2)[mine], bool(which))
        return out


@dataclass
class Remainder:
    """Paints what is left of the frames of a run, one after the other.

    Attributes:
        painter: of what is new.
        last, left: the last frame's number, and what was left of it, at the working size.
        carried, shown: its paint, and the frames that this is from.
        coming, turned: the next run's first frame as it will be shown; its paint in frames before it, and its share.
        used: whether anything was left in any frame.
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

    def paint(self, index: int, frame: Frame, left: Plane, limit: Plane) -> Look:
        """What frame `index` is painted like where `left`, 0..1, is seen; anything elsewhere."""
        seen, self.used = left > SEEN, True
        self.carried = self._now(index, seen)
        old, fits = self._old(self.carried, self.shown, frame, seen, limit)
        look, known = self._with_next(index, frame, seen, limit, old, fits)
        if (lacks := seen & (known < 1)).any():
            fresh = (1 - known)[..., None]
            look[0] += frame * fresh
            look[1] += self._fresh(frame, lacks) * fresh
        self.carried, self.last = self.carried.anew(index, ~seen | (fits < 1)), index
        return look

    def lingers(self, index: int, left: Plane) -> Plane:
        """What is left of a frame, 0..1: a patch takes over again by RETURNS a painting, lest it flickers."""
        if self.left is not None and self.last is not None and self.left.max() > RETURNS:
            before = self.left
            for step in range(self.last + 1, index + 1):
                before = _followed(before, self.links.back(step))
            left = np.maximum(left, self.grid.enlarge(before) - np.float32(RETURNS))
        self.left = np.asarray(cv2.resize(left, self.grid.size, interpolation=cv2.INTER_AREA), np.float32)
        return left

    def keep(self, index: int, picture: Frame, shown: Frame) -> None:
        """Remember frame `index` as it is shown, patches and all: what they lose is carried too.

        `picture` is what that paint was made from: of paint that is half old and half new, half of each.
        """
        if self.last != index:
            self.carried, self.last = Carried.here(index, shown.shape), index
        used = _sources(self.carried.origin)
        self.shown = {key: both for key, both in (self.shown | {index: (picture, shown)}).items() if key in used}

    def turn_to(self, index: int, picture: Frame, shown: Frame, hold: int) -> None:
        """The next run begins at frame `index` and shows it like this: fade over to it."""
        now, self.coming = Carried.here(index, shown.shape), {index: (picture, shown)}
        for step in range(index - 1, index - FADE * hold, -1):
            now = now.follow(self.links.ahead(step), self.grid, np.ones(shown.shape[:2], np.bool_))
            if (index - step) % hold == 0:
                self.turned[step] = now, 1 - (index - step) / (FADE * hold)

    def _now(self, index: int, seen: Mask) -> Carried:
        """What the last frame has shown, where it is in this one."""
        if self.last is None:
            return Carried.here(NOWHERE, seen.shape)
        now = self.carried
        for step in range(self.last + 1, index + 1):
            now = now.follow(self.links.back(step), self.grid, seen if step == index else np.ones_like(seen))
        return now

    def _with_next(
        self, index: int, frame: Frame, seen: Mask, limit: Plane, old: Look, fits: Plane
    ) -> tuple[Look, Plane]:
        """Old paint and that of the next run, weighted, and the sum of the weights, 0..1."""
        if index not in self.turned:
            return old * fits[..., None], fits
        turned, due = self.turned.pop(index)
        coming, coming_fits = self._old(turned, self.coming, frame, seen, limit)
        share = np.float32(due)
        before, after = fits * (1 - share * coming_fits), coming_fits * (share + (1 - share) * (1 - fits))
        return old * before[..., None] + coming * after[..., None], before + after

    def _old(self, carried: Carried, shown: Shown, frame: Frame, seen: Mask, limit: Plane) -> tuple[Look, Plane]:
        """Paint where it is now, and 1 where it shows what is in the frame, 0 where it does not, between at borders."""
        known = seen & (carried.origin != NOWHERE)
        look = np.stack([carried.fetch(shown, which, known) for which in (0, 1)])
        if not known.any():
            return look, (~seen).astype(np.float32)
        sigma = fine_px(self.grid)
        share = np.maximum(cv2.GaussianBlur(known.astype(np.float32), (0, 0), sigma), np.float32(0.1))
        there = np.where(known[..., None], look, frame)
        off = apart(frame, there, limit * share, sigma)
        _without_distorted(carried.origin, carried.place, known)
        good = np.where(known, np.clip((GONE - off) / (GONE - STAYS), 0, 1), ~seen).astype(np.float32)
        soft = 2 * int(SOFT_PX * self.grid.height / 688) + 1
        fits = np.minimum(np.clip(2 * cv2.blur(good, (soft, soft), borderType=cv2.BORDER_REPLICATE) - 1, 0, 1), good)
        return look, np.where(fits > 0.999, 1, fits).astype(np.float32)

    def _fresh(self, frame: Frame, where: Mask) -> Frame:
        """A painting of the frame alone, where it is needed."""
        reach = 2 * int(self.painter.reach_px / 4) + 1
        near = cv2.dilate(where.astype(np.uint8), np.ones((reach, reach), np.uint8)) > 0
        return self.painter.part(frame, near)


def _followed(plane: Plane, pair: tuple[Flow, Plane] | None) -> Plane:
    """A plane of the grid in the frame that the flow leads from; 0 where it does not lead back."""
    if pair is None:
        return np.zeros_like(plane)
    rows, columns = np.indices(plane.shape, np.float32)
    found = cv2.remap(plane, columns + pair[0][..., 0], rows + pair[0][..., 1], cv2.INTER_LINEAR)
    return np.where(_leads(pair[1]), found, 0).astype(np.float32)


def _leads(reliable: Plane) -> Mask:
    """Where flow leads back, but for specks where it does not."""
    lost = (reliable < LEADS_BACK).astype(np.uint8)
    return np.asarray(cv2.morphologyEx(lost, cv2.MORPH_OPEN, np.ones((LOST_PX, LOST_PX), np.uint8)) == 0)


def _sources(origin: NDArray[np.int32]) -> list[int]:
    """The frames that are among the origins."""
    first = int(origin.min(initial=np.iinfo(np.int32).max))
    return (np.flatnonzero(np.bincount(origin.ravel() - first)) + first).tolist()


def _sampled(picture: Frame, places: Places, sharp: bool) -> Frame:
    """A picture's colours at (n, 2) places, bicubic or else bilinear: uint8 (n, 3)."""
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
    """The origin at the nearest pixel to where the flow leads, and the mean place of the four of that origin."""
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
    """Leave out, in place, what is nearer to or further from a neighbour of its origin than it was there."""
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
