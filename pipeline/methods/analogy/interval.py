"""Frames between painted keys, as one task: all levels and sweeps, ribbons, and keys that hold.

Section 4 of benard2013stylizing. The keys are the style as well: each with the frame that it was painted over. Frames
up to a key, from a key on, and between two are intervals that need nothing of each other. A long one is cut to pieces;
each begins with the frame that the piece nearer to the key has ended with, as if that had been painted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from pipeline.methods.analogy.keys import Key
from pipeline.methods.analogy.shots import Shot, Stills
from pipeline.methods.analogy.sources import Pair, Source
from pipeline.methods.base import Bench
from pipeline.synthesis.atlas import Atlas, atlas, coarser
from pipeline.synthesis.images import NOWHERE, Offsets
from pipeline.synthesis.motion import Motion

PIECE = 48
"""Frames of a piece at most, all of which a task holds at one level: the paper paints every 10 to 20."""
PIECE_BYTES = 3 << 30
_BYTES_A_PIXEL = 60
"""Of a frame at the finest level: offsets, pictures, motions both ways, two ribbons."""
_LEAST = 8


def piece_frames(size: tuple[int, int]) -> int:
    """Frames of a piece of this size, (width, height) px: 24 at 1080p."""
    return max(_LEAST, min(PIECE, PIECE_BYTES // (size[0] * size[1] * _BYTES_A_PIXEL)))


@dataclass(frozen=True)
class Piece:
    """Frames [start, stop) to be found, of which [first, last) are emitted.

    Attributes:
        keys: frames whose keys are the style: those at the interval's ends, and partial ones between.
        held: the frame that an earlier piece ends with, -1 = none; `task` has saved it.
    """

    start: int
    stop: int
    first: int
    last: int
    keys: tuple[int, ...]
    held: int = -1
    task: str = ""
    layer: int = -1

    def args(self) -> dict[str, Any]:
        return {"piece": asdict(self)}


def pieces(
    begin: int, end: int, keys: list[tuple[int, bool]], most: int = PIECE, layer: int = -1
) -> Iterator[tuple[str, Piece]]:
    """A shot's frames [begin, end), cut at keys that are painted all over; yields (task key, piece).

    Args:
        most: frames of a piece.
    """
    full = [index for index, whole in keys if whole]
    edges = sorted({begin, *full, end})
    for left, right in pairwise(edges):
        stop = right + 1 if right in full else right
        inside = tuple(index for index, _ in keys if left <= index < stop)
        style = inside or tuple(index for index, _ in keys)
        backward = left not in full and right in full
        for key, piece in _cut(left, right, stop, style, backward, most):
            prefix = f"layer-{layer}-" if layer >= 0 else ""
            yield prefix + key, replace(piece, task=prefix + piece.task if piece.task else "", layer=layer)


def _cut(
    left: int, right: int, stop: int, keys: tuple[int, ...], backward: bool, most: int
) -> Iterator[tuple[str, Piece]]:
    """Pieces of at most so many frames, from the key on. Neighbours share the frame between them."""
    starts = list(range(left, right, most))
    before: tuple[int, str] | None = None
    for start in reversed(starts) if backward else starts:
        inner = min(start + most, right)
        name = f"keyed-{start:07d}"
        lent = before or (-1, "")
        if backward:
            yield name, Piece(start, inner + 1, start, inner, keys, *lent)
            before = start, name
        else:
            whole = stop if inner == right else inner + 1
            yield name, Piece(start, whole, start, inner, keys, *lent)
            before = inner, name


class KeyedShot(Shot):
    """A shot at one level with its keys.

    Args:
        given: frame -> offsets of its painted pixels, at the finest level.
        ribbons: frame -> places in the last and the next key.
        level: this one.
    """

    def __init__(self, stills: Stills, clock: Callable[[str], Any], anywhere: tuple[int, int],
                 given: dict[int, Offsets], level: int) -> None:  # fmt: skip
        super().__init__(stills, clock, anywhere)
        self._given, self._level = given, level
        self.full = sorted(i for i, offsets in given.items() if (offsets[..., 0] > NOWHERE).all())
        self.carried: dict[int, Offsets] = {}
        self._kept: dict[int, tuple[Motion, Motion]] = {}

    def motion(self, index: int, other: int) -> Motion:
        first = min(index, other)
        if first not in self._kept:
            super().motion(index, other)
            self._kept[first] = self._motions.pop(first)
        return self._kept[first][0 if index < other else 1]

    def given(self, index: int) -> Offsets | None:
        outside = super().given(index)
        if index not in self._given:
            return outside
        painted = coarser(self._given[index], self._level)
        return painted if outside is None else np.where(painted > NOWHERE, painted, outside)

    def share(self, index: int, forward: bool) -> float:
        """Section 4.1: the nearer key's sweep is likelier."""
        last = max((i for i in self.full if i <= index), default=None)
        following = min((i for i in self.full if i >= index), default=None)
        if last is None or following is None or last == following:
            return 0.5
        from_last = (following - index) / (following - last)
        return from_last if forward else 1 - from_last

    def ribbons(self, index: int) -> Offsets | None:
        return self.carried.get(index)


@dataclass(frozen=True)
class Painted:
    """A piece's keys as style."""

    pair: Pair
    places: Atlas
    given: dict[int, Offsets]


def painted(bench: Bench, source: Source, piece: Piece, levels: int, pad_px: int, extra: Pair | None) -> Painted:
    """Keys (and a style pair that was given beside them) as one style, and where their pixels lie in it."""
    keys = [source.key(index) for index in piece.keys]
    pairs = [_as_pair(bench, source, key) for key in keys] + ([extra] if extra else [])
    places = atlas([(p.output.shape[1], p.output.shape[0]) for p in pairs], levels, 2 * pad_px)
    usable = places.usable([p.usable for p in pairs])
    colours = np.asarray(places.lay([p.output for p in pairs]), np.uint8)
    guide = np.asarray(places.lay([p.guide for p in pairs]), np.uint8)
    further = None
    if pairs[0].extra is not None:
        further = np.asarray(places.lay([p.extra for p in pairs if p.extra is not None]), np.uint8)
    given = {
        key.index: places.identity(order, key.painted)
        for order, key in enumerate(keys)
        if piece.start <= key.index < piece.stop
    }
    return Painted(Pair(colours, guide, False, further, usable), places, given)


def _as_pair(bench: Bench, source: Source, key: Key) -> Pair:
    still = Stills(source, bench.clock, key.index, key.index + 1, 0, lambda guide: guide)
    guide = still.guides[key.index]
    extra = np.ascontiguousarray(guide[..., 3:]) if guide.shape[2] > 3 else None
    return Pair(key.colours, np.ascontiguousarray(guide[..., :3]), False, extra, key.painted)
