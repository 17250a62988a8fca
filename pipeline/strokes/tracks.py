"""Stroke tracks: strokes advected by the flow, added where paint is missing, removed where crowded or hidden.

A track is a seed with its place, its id (which determines jitter, bristles and painting order) and its colour, which
follows the picture gradually. The stroke is traced anew through the seed in each frame. Strokes appear and disappear
gradually by their `presence`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.frames import Flow, Frame, Mask
from pipeline.kernels.jit import kernel
from pipeline.strokes.brush import Strokes, colours_at
from pipeline.strokes.seeds import Points, Seeds, StyleField, nearest, sample

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class StrokeTracks:
    """Strokes of one layer in one frame, oldest first.

    Attributes:
        seeds: current places, and ids.
        targets: float32 (n, 3), RGB 0..255, current target colours.
        presence: float32 (n,), 0..1: fading state, 1 = fully visible.
        leaving: bool (n,): the stroke fades out and will be removed.
        initial: float32 (n, 3), RGB 0..255, target colours at creation. The painting order depends on these, because
            it must not change during a stroke's lifetime.
    """

    seeds: Seeds
    targets: NDArray[np.float32]
    presence: NDArray[np.float32]
    leaving: Flags
    initial: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.seeds)

    def __getitem__(self, keep: Flags) -> StrokeTracks:
        if keep.all():
            return self
        kept = np.flatnonzero(keep)
        return StrokeTracks(
            self.seeds[kept], self.targets.take(kept, axis=0), self.presence.take(kept), self.leaving.take(kept),
            self.initial.take(kept, axis=0),
        )  # fmt: skip

    def state(self) -> State:
        """The tracks as arrays by name, for storage."""
        return {
            "xy": self.seeds.xy, "ids": self.seeds.ids, "targets": self.targets, "presence": self.presence,
            "leaving": self.leaving, "initial": self.initial,
        }  # fmt: skip

    @classmethod
    def from_state(cls, state: Arrays) -> StrokeTracks:
        """Restore what `state` returned."""
        seeds = Seeds(state["xy"], state["ids"].astype(np.uint64))
        return cls(seeds, state["targets"], state["presence"], state["leaving"].astype(np.bool_), state["initial"])


@dataclass(frozen=True)
class LifecycleParams:
    """Parameters of the addition, recolouring and removal of strokes.

    Attributes:
        gap: smallest distance of a new stroke from any other, in spacings.
        crowd: distance below which the younger of two strokes is removed, in spacings; less than `gap`.
        fade: change of presence a frame, 0..1.
        follow: fraction of the colour difference to the picture by which a stroke changes per frame, 0..1. It rises to
            1 at a difference of `break_off`, because a stroke of a wrong colour covers nothing and blocks new strokes.
        break_off: colour difference (RGB distance) above which a stroke is removed: it is on another surface.
    """

    gap: float = 0.7
    crowd: float = 0.3
    fade: float = 0.25
    follow: float = 0.2
    break_off: float = 90.0


def start_tracks(
    seeds: Seeds, reference: Frame, spacing_px: StyleField, params: LifecycleParams | None = None,
    shape: tuple[int, ...] | None = None,
) -> StrokeTracks:  # fmt: skip
    """Create the tracks of a shot's first frame: fully visible, without crowded seeds, colours from the reference.

    For `shape` see `update`.
    """
    shape, none = shape or reference.shape, np.zeros(len(seeds), np.bool_)
    crowded, _ = _crowding(seeds, none, seeds[none], spacing_px, params or LifecycleParams(), shape)
    return _new_tracks(seeds[~crowded], colours_at(seeds[~crowded], reference, shape), 1.0)


def _new_tracks(seeds: Seeds, colours: NDArray[np.float32], presence: float | NDArray[np.float32]) -> StrokeTracks:
    n = len(seeds)
    return StrokeTracks(seeds, colours, np.full(n, presence, np.float32), np.zeros(n, np.bool_), colours)


def advect(
    tracks: StrokeTracks, flow: Flow, hidden: Mask | None = None, shape: tuple[int, ...] | None = None
) -> StrokeTracks:
    """Move tracks along the flow; those that leave the picture are removed, those that become hidden start to fade.

    Args:
        flow: float32 (h', w', 2), from the previous frame to this one, px of the frame.
        hidden: bool (h, w), pixels of the previous frame that are not visible in this one.
        shape: (height, width, ...) of the frame, if the flow is on a coarser grid.
    """
    height, width = (shape or flow.shape)[:2]
    xy = np.empty_like(tracks.seeds.xy)
    scale = np.float32(flow.shape[1] / width), np.float32(flow.shape[0] / height)
    _advected(tracks.seeds.xy, flow, scale, xy)
    leaving = tracks.leaving
    if hidden is not None:
        x, y = nearest(tracks.seeds.xy, hidden.shape)
        leaving = leaving | hidden[y, x]
    inside = (xy[:, 0] >= 0) & (xy[:, 1] >= 0) & (xy[:, 0] <= width - 1) & (xy[:, 1] <= height - 1)
    return replace(tracks, seeds=Seeds(xy, tracks.seeds.ids), leaving=leaving)[inside]


@kernel
def _advected(xy: Points, flow: Flow, scale: tuple[np.float32, np.float32], out: Points) -> None:
    """Fill `out` with the points moved along the flow, interpolated bilinearly; `scale`: cells of the flow per px."""
    height, width = flow.shape[:2]
    one, half = np.float32(1), np.float32(0.5)
    shift_x, shift_y = half * scale[0] - half, half * scale[1] - half
    for k in range(len(xy)):
        x = min(max(xy[k, 0] * scale[0] + shift_x, np.float32(0)), np.float32(width - 1))
        y = min(max(xy[k, 1] * scale[1] + shift_y, np.float32(0)), np.float32(height - 1))
        left, top = min(int(x), max(width - 2, 0)), min(int(y), max(height - 2, 0))
        right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
        a, b = x - np.float32(left), y - np.float32(top)
        for c in range(2):
            above = flow[top, left, c] * (one - a) + flow[top, right, c] * a
            below = flow[bottom, left, c] * (one - a) + flow[bottom, right, c] * a
            out[k, c] = xy[k, c] + (above * (one - b) + below * b)


def update(
    tracks: StrokeTracks, candidates: Seeds, reference: Frame, spacing_px: StyleField, *,
    params: LifecycleParams | None = None, wanted: Flags | None = None, revealed: Mask | None = None,
    shape: tuple[int, ...] | None = None,
) -> StrokeTracks:  # fmt: skip
    """Update advected tracks to the current frame: colours, presence, removal of crowded strokes, new strokes.

    Args:
        candidates: seeds of this frame (`place` with `birth` = frame number); each is used where it fits.
        reference: uint8 (h, w, 3), what the layer paints.
        wanted: bool (n,), for the existing tracks; False = the picture no longer needs the stroke.
        revealed: bool (h, w), pixels that have just become visible: new strokes are fully visible there at once, old
            ones take the new colour or are removed at once.
        shape: (height, width, ...) of the frame in whose px the seeds are, if the arrays are on coarser grids over it.

    Source: hays2004image, section 5. Departure: colours change gradually too, and removed strokes fade in place.
    """
    params = params or LifecycleParams()
    shape = shape or reference.shape
    now = colours_at(tracks.seeds, reference, shape)
    change = np.sqrt(((now - tracks.targets) ** 2).sum(axis=1))
    leaving = tracks.leaving | (change > params.break_off)
    if wanted is not None:
        leaving = leaving | ~wanted
    at_once = _flags_at(revealed, tracks.seeds, shape)
    share = _colour_share(change, at_once, params)
    targets = np.where(leaving[:, None], tracks.targets, tracks.targets + share * (now - tracks.targets))
    crowded, fits = _crowding(tracks.seeds, leaving, candidates, spacing_px, params, shape)
    leaving = leaving | crowded
    step = np.where(leaving, np.float32(-params.fade), np.float32(params.fade))
    presence = np.clip(tracks.presence + step, 0, 1).astype(np.float32)
    presence[at_once & leaving] = 0
    kept = StrokeTracks(tracks.seeds, targets.astype(np.float32), presence, leaving, tracks.initial)[presence > 0]
    new = candidates[fits]
    presence = np.full(len(new), params.fade, np.float32)
    presence[_flags_at(revealed, new, shape)] = 1
    return _concatenate(kept, _new_tracks(new, colours_at(new, reference, shape), presence))


def _flags_at(mask: Mask | None, seeds: Seeds, shape: tuple[int, ...]) -> Flags:
    """Values of a mask at seeds, in px of a frame of `shape`: bool (n,); False without a mask."""
    if mask is None:
        return np.zeros(len(seeds), np.bool_)
    x, y = nearest(seeds.xy, mask.shape, shape)
    return np.asarray(mask[y, x], np.bool_)


def _colour_share(change: NDArray[np.float32], at_once: Flags, params: LifecycleParams) -> NDArray[np.float32]:
    """Share of the colour difference to the picture by which strokes change, 0..1: float32 (n, 1).

    Args:
        change: RGB distance to the picture, (n,).
        at_once: strokes that change completely.
    """
    far = np.minimum(change / np.float32(params.break_off), 1)
    share = (np.float32(params.follow) + np.float32(1 - params.follow) * far * far)[:, None]
    share[at_once] = 1
    return np.asarray(share, np.float32)


def _concatenate(old: StrokeTracks, new: StrokeTracks) -> StrokeTracks:
    seeds = Seeds(np.concatenate([old.seeds.xy, new.seeds.xy]), np.concatenate([old.seeds.ids, new.seeds.ids]))
    return StrokeTracks(
        seeds,
        np.concatenate([old.targets, new.targets]),
        np.concatenate([old.presence, new.presence]),
        np.concatenate([old.leaving, new.leaving]),
        np.concatenate([old.initial, new.initial]),
    )


def fade(strokes: Strokes, presence: NDArray[np.float32]) -> Strokes:
    """Make strokes narrower and fainter by their presence, float32 (n,) in 0..1."""
    ease = presence * presence * (3 - 2 * presence)
    return replace(
        strokes,
        opacity=strokes.opacity * ease,
        radius_px=strokes.radius_px * (np.float32(0.4) + np.float32(0.6) * ease),
    )


def _crowding(
    seeds: Seeds, leaving: Flags, candidates: Seeds, spacing_px: StyleField, params: LifecycleParams,
    shape: tuple[int, ...],
) -> tuple[Flags, Flags]:  # fmt: skip
    """Flags of the seeds that crowd an older one, and of the candidates that fit between those that stay."""
    xy = np.concatenate([seeds.xy, candidates.xy])
    apart = sample(spacing_px, xy, shape)
    apart[: len(seeds)] *= np.float32(params.crowd)
    apart[len(seeds) :] *= np.float32(params.gap)
    skip = np.concatenate([leaving, np.zeros(len(candidates), np.bool_)])
    cell = max(float(apart.max(initial=1.0)), 1.0)
    good = _poisson_filter(xy, apart, skip, np.float32(cell), *(int(side / cell) + 2 for side in shape[:2]))
    return ~good[: len(seeds)] & ~leaving, good[len(seeds) :]


@kernel
def _poisson_filter(
    xy: Points, apart: NDArray[np.float32], skip: Flags, cell: np.float32, rows: int, columns: int
) -> Flags:
    """Keep each point, in order, that has no kept point nearer than its own `apart`. Points are binned into cells."""
    head, chain = np.full(rows * columns, -1, np.int32), np.full(len(xy), -1, np.int32)
    places = xy.reshape(-1)  # a flat array with unsigned indices: signed ones are tested for being negative
    good = np.zeros(len(xy), np.bool_)
    for k in range(len(xy)):
        if skip[k]:
            continue
        x, y = places[np.uintp(2 * k)], places[np.uintp(2 * k + 1)]
        column, row = int(x / cell), int(y / cell)
        least = apart[k] * apart[k]
        free = True
        for i in range(max(row - 1, 0), min(row + 2, rows)):
            for j in range(max(column - 1, 0), min(column + 2, columns)):
                other = head[np.uintp(i * columns + j)]
                while other >= 0 and free:
                    dx, dy = x - places[np.uintp(2 * other)], y - places[np.uintp(2 * other + 1)]
                    free = dx * dx + dy * dy >= least
                    other = chain[np.uintp(other)]
        if free:
            good[k] = True
            chain[k] = head[row * columns + column]
            head[row * columns + column] = k
    return good
