"""Strokes that live on: carried by the flow, added where paint is missing, lifted where they crowd or are hidden.

What lives is the seed: its place, its name (which holds its jitter, its hairs and its turn among others) and its
colour, which follows the picture slowly. The stroke is traced anew through it in each frame. Strokes come and go by
their `presence`, never at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Mask
from pipeline.segmentation.jit import kernel
from pipeline.strokes.brush import Strokes, colours_at
from pipeline.strokes.seeds import Field, Points, Seeds, as_plane, nearest, sample

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Living:
    """Strokes of a layer in one frame, the oldest first.

    Attributes:
        seeds: where they are now, and their names.
        aims: float32 (n, 3), RGB 0..255, the colours that they stand for.
        presence: float32 (n,), 0..1: how far they have come up, or gone.
        leaving: bool (n,): they are being lifted, for good.
        born: float32 (n, 3), RGB 0..255, the colours that they came with. What depends on colour but must not change
            in a stroke's life, as who covers whom, takes these.
    """

    seeds: Seeds
    aims: NDArray[np.float32]
    presence: NDArray[np.float32]
    leaving: Flags
    born: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.seeds)

    def __getitem__(self, keep: Flags) -> Living:
        return Living(self.seeds[keep], self.aims[keep], self.presence[keep], self.leaving[keep], self.born[keep])


@dataclass(frozen=True)
class Habits:
    """How strokes live.

    Attributes:
        gap: a new stroke comes where no other is nearer than this, in spacings.
        crowd: the younger of two strokes nearer than this is lifted, in spacings; below `gap`.
        fade: presence won or lost a frame, 0..1.
        follow: how far a stroke's colour goes towards the picture's in a frame, 0..1; further the more they differ, all
            the way at `break_off`: a stroke whose colour no longer fits paints nothing and keeps others away.
        break_off: beyond this change of colour (RGB distance) a stroke is lifted: it is on another thing now.
    """

    gap: float = 0.7
    crowd: float = 0.3
    fade: float = 0.25
    follow: float = 0.2
    break_off: float = 90.0


def begin(seeds: Seeds, reference: Frame, spacing_px: Field, habits: Habits | None = None) -> Living:
    """The first frame's seeds, wholly there, save those that crowd others; colours are the reference's (uint8)."""
    spacing, none = as_plane(spacing_px, reference.shape), np.zeros(len(seeds), np.bool_)
    crowded, _ = _room(seeds, none, seeds[none], spacing, habits or Habits())
    return _fresh(seeds[~crowded], reference, 1.0)


def _fresh(seeds: Seeds, reference: Frame, presence: float | NDArray[np.float32]) -> Living:
    n, colours = len(seeds), colours_at(seeds, reference)
    there = np.full(n, presence, np.float32)
    return Living(seeds, colours, there, np.zeros(n, np.bool_), colours)


def carry(living: Living, flow: Flow, hidden: Mask | None = None) -> Living:
    """Move strokes along the flow; those that leave the picture are gone, those that go into hiding begin to leave.

    Args:
        flow: float32 (h, w, 2), from the last frame to this one, px.
        hidden: bool (h, w), pixels of the last frame that this one does not show.
    """
    height, width = flow.shape[:2]
    x, y = nearest(living.seeds.xy, flow.shape)
    xy = living.seeds.xy + _between(flow, living.seeds.xy)
    leaving = living.leaving if hidden is None else living.leaving | hidden[y, x]
    inside = (xy[:, 0] >= 0) & (xy[:, 1] >= 0) & (xy[:, 0] <= width - 1) & (xy[:, 1] <= height - 1)
    return replace(living, seeds=Seeds(xy.astype(np.float32), living.seeds.ids), leaving=leaving)[inside]


def _between(flow: Flow, xy: Points) -> Points:
    """The flow at points between pixels, bilinear."""
    height, width = flow.shape[:2]
    left = np.clip(np.floor(xy), 0, [max(width - 2, 0), max(height - 2, 0)]).astype(np.intp)
    a, b = (xy - left).astype(np.float32).T[..., None]
    column, row = left.T
    top = flow[row, column] * (1 - a) + flow[row, column + 1] * a
    bottom = flow[row + 1, column] * (1 - a) + flow[row + 1, column + 1] * a
    return np.asarray(top * (1 - b) + bottom * b, np.float32)


def tend(
    living: Living, candidates: Seeds, reference: Frame, spacing_px: Field, *, habits: Habits | None = None,
    wanted: Flags | None = None, revealed: Mask | None = None,
) -> Living:  # fmt: skip
    """The strokes of this frame: colours and presence ease, what crowds is lifted, where paint is missing it is added.

    Args:
        candidates: fresh seeds of this frame (`place` with `birth` = the frame's number); each is taken where there
            is room.
        reference: uint8 (h, w, 3), what the layer paints.
        wanted: bool (n,), of the living ones; False = the picture needs this stroke no longer.
        revealed: bool (h, w), what has just come into the picture: new strokes are wholly there, and old ones take its
            colour or go, at once.

    Source: hays2004image, section 5. Departure: colours ease too, and a stroke that must go fades where it is.
    """
    habits = habits or Habits()
    now = colours_at(living.seeds, reference)
    change = np.sqrt(((now - living.aims) ** 2).sum(axis=1))
    leaving = living.leaving | (change > habits.break_off)
    if wanted is not None:
        leaving = leaving | ~wanted
    far = np.minimum(change / np.float32(habits.break_off), 1)
    share = (np.float32(habits.follow) + np.float32(1 - habits.follow) * far * far)[:, None]
    struck = np.zeros(len(living), np.bool_)
    if revealed is not None:
        x, y = nearest(living.seeds.xy, reference.shape)
        struck = revealed[y, x]
        share[struck] = 1
    aims = np.where(leaving[:, None], living.aims, living.aims + share * (now - living.aims))
    spacing = as_plane(spacing_px, reference.shape)
    crowded, room = _room(living.seeds, leaving, candidates, spacing, habits)
    leaving = leaving | crowded
    step = np.where(leaving, np.float32(-habits.fade), np.float32(habits.fade))
    presence = np.clip(living.presence + step, 0, 1).astype(np.float32)
    presence[struck & leaving] = 0
    old = Living(living.seeds, aims.astype(np.float32), presence, leaving, living.born)[presence > 0]
    new = candidates[room]
    presence = np.full(len(new), habits.fade, np.float32)
    if revealed is not None:
        x, y = nearest(new.xy, reference.shape)
        presence[revealed[y, x]] = 1
    return _join(old, _fresh(new, reference, presence))


def _join(old: Living, new: Living) -> Living:
    seeds = Seeds(np.concatenate([old.seeds.xy, new.seeds.xy]), np.concatenate([old.seeds.ids, new.seeds.ids]))
    return Living(
        seeds,
        np.concatenate([old.aims, new.aims]),
        np.concatenate([old.presence, new.presence]),
        np.concatenate([old.leaving, new.leaving]),
        np.concatenate([old.born, new.born]),
    )


def present(strokes: Strokes, presence: NDArray[np.float32]) -> Strokes:
    """Strokes as far as they are there, float32 (n,) in 0..1: narrower and fainter while they come and go."""
    ease = presence * presence * (3 - 2 * presence)
    return replace(
        strokes,
        opacity=strokes.opacity * ease,
        radius_px=strokes.radius_px * (np.float32(0.4) + np.float32(0.6) * ease),
    )


def carry_points(strokes: Strokes, flow: Flow, stretch: float = 1.6) -> tuple[Strokes, Flags]:
    """Move whole strokes, point by point, and say which are still good, bool (n,).

    A stroke is good while its length is within a factor of `stretch` of what it was in the last frame, and its middle
    is in the picture. Points may lie outside.

    Args:
        flow: float32 (h, w, 2), px; beyond the border its pixel goes on.

    Source: hertzmann2000video; litwinowicz1997processing, section 3.3.
    """
    shape, height, width = strokes.points.shape, *flow.shape[:2]
    flat = strokes.points.reshape(-1, 2)
    used = (np.arange(shape[1]) < strokes.counts[:, None]).reshape(-1)
    moved = flat.copy()
    moved[used] += _between(flow, np.clip(flat[used], 0, np.array([width - 1, height - 1], np.float32)))
    points = moved.reshape(shape)
    before, after = _lengths(strokes.points, strokes.counts), _lengths(points, strokes.counts)
    middle = points[np.arange(len(points)), strokes.counts // 2]
    inside = ((middle >= 0) & (middle <= [width - 1, height - 1])).all(axis=1)
    good = (after <= before * stretch + 1) & (before <= after * stretch + 1) & inside
    return replace(strokes, points=points), np.asarray(good, np.bool_)


def _lengths(points: NDArray[np.float32], counts: NDArray[np.int32]) -> NDArray[np.float32]:
    steps = np.diff(points, axis=1)
    used = np.arange(steps.shape[1]) < counts[:, None] - 1
    return np.asarray(np.where(used, np.sqrt((steps**2).sum(axis=-1)), 0).sum(axis=1), np.float32)


def _room(
    seeds: Seeds, leaving: Flags, candidates: Seeds, spacing: NDArray[np.float32], habits: Habits
) -> tuple[Flags, Flags]:
    """Which of the seeds crowd an older one, and which candidates have room beside those that stay."""
    xy = np.concatenate([seeds.xy, candidates.xy])
    apart = sample(spacing, xy)
    apart[: len(seeds)] *= np.float32(habits.crowd)
    apart[len(seeds) :] *= np.float32(habits.gap)
    skip = np.concatenate([leaving, np.zeros(len(candidates), np.bool_)])
    cell = max(float(apart.max(initial=1.0)), 1.0)
    good = _alone(xy, apart, skip, np.float32(cell), *(int(side / cell) + 2 for side in spacing.shape))
    return ~good[: len(seeds)] & ~leaving, good[len(seeds) :]


@kernel
def _alone(xy: Points, apart: NDArray[np.float32], skip: Flags, cell: np.float32, rows: int, columns: int) -> Flags:
    """In turn, keep each point with no kept one nearer than `apart` of its own; buckets of one cell."""
    head, chain = np.full((rows, columns), -1, np.int32), np.full(len(xy), -1, np.int32)
    good = np.zeros(len(xy), np.bool_)
    for k in range(len(xy)):
        if skip[k]:
            continue
        column, row = int(xy[k, 0] / cell), int(xy[k, 1] / cell)
        free = True
        for i in range(max(row - 1, 0), min(row + 2, rows)):
            for j in range(max(column - 1, 0), min(column + 2, columns)):
                other = head[i, j]
                while other >= 0 and free:
                    dx, dy = xy[k, 0] - xy[other, 0], xy[k, 1] - xy[other, 1]
                    free = dx * dx + dy * dy >= apart[k] * apart[k]
                    other = chain[other]
        if free:
            good[k] = True
            chain[k] = head[row, column]
            head[row, column] = k
    return good
