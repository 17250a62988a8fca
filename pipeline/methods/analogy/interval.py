"""Intervals between painted keyframes: how a shot is split into tasks, and the keyframes as its style.

Section 4 of benard2013stylizing. Keyframes are hard constraints, so frames before the first key, between two keys and
after the last key are independent. Each keyframe, paired with the frame that it was painted over, is also a style
example. A long interval is split further: each part starts from the last frame of the part before it, which is treated
as if it had been painted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from pipeline.frames import Flow, Plane
from pipeline.methods.analogy.keyframes import Keyframe
from pipeline.methods.analogy.level_frames import Boil, LevelAnimation, LevelFrames
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.sources import Source, StylePair
from pipeline.methods.base import TaskContext
from pipeline.synthesis.atlas import Atlas, atlas, downscaled_offsets
from pipeline.synthesis.images import NOWHERE, Offsets
from pipeline.synthesis.motion import Motion

MAX_INTERVAL_FRAMES = 48
"""Maximum number of frames of an interval; a task holds all of them at one level. The paper has a key every 10 to
20."""
MAX_INTERVAL_BYTES = 3 << 30
_BYTES_A_PIXEL = 60
"""Memory of one frame at the finest level: offsets, pictures, motion in both directions, two ribbons."""
_LEAST = 8
NO_LINE_PX = 1e4
"""Distance to the lines of a style that has none, px."""


def interval_frames(size: tuple[int, int]) -> int:
    """Maximum number of frames of an interval at a frame size (width, height) px: 24 at 1080p."""
    return max(_LEAST, min(MAX_INTERVAL_FRAMES, MAX_INTERVAL_BYTES // (size[0] * size[1] * _BYTES_A_PIXEL)))


@dataclass(frozen=True)
class KeyInterval:
    """Frames [start, stop) to synthesise, of which [first, last) are emitted.

    Attributes:
        keys: frame numbers of the keyframes that are the style: those at the ends, and partial ones in between.
        held: a frame that an earlier task has already solved and that is fixed here; -1 = none.
        task: the task that has saved that frame.
        layer: -1 = the whole picture.
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
        return {"interval": asdict(self)}


def split_intervals(
    begin: int, end: int, keys: list[tuple[int, bool]], most: int = MAX_INTERVAL_FRAMES, layer: int = -1
) -> Iterator[tuple[str, KeyInterval]]:
    """Split the frames [begin, end) of a shot at its full keyframes; yields (task key, interval).

    Args:
        keys: (frame number, whether the keyframe is painted everywhere).
        most: maximum number of frames of an interval.
    """
    full = [index for index, whole in keys if whole]
    edges = sorted({begin, *full, end})
    for left, right in pairwise(edges):
        stop = right + 1 if right in full else right
        inside = tuple(index for index, _ in keys if left <= index < stop)
        style = inside or tuple(index for index, _ in keys)
        backward = left not in full and right in full
        for key, interval in _cut(left, right, stop, style, backward, most):
            prefix = f"layer-{layer}-" if layer >= 0 else ""
            yield prefix + key, replace(interval, task=prefix + interval.task if interval.task else "", layer=layer)


def _cut(
    left: int, right: int, stop: int, keys: tuple[int, ...], backward: bool, most: int
) -> Iterator[tuple[str, KeyInterval]]:
    """Split one interval into parts of at most `most` frames, starting at its key. Neighbouring parts share a frame."""
    starts = list(range(left, right, most))
    before: tuple[int, str] | None = None
    for start in reversed(starts) if backward else starts:
        inner = min(start + most, right)
        name = f"keyed-{start:07d}"
        lent = before or (-1, "")
        if backward:
            yield name, KeyInterval(start, inner + 1, start, inner, keys, *lent)
            before = start, name
        else:
            whole = stop if inner == right else inner + 1
            yield name, KeyInterval(start, whole, start, inner, keys, *lent)
            before = inner, name


class KeyedAnimation(LevelAnimation):
    """The frames of an interval at one level, with their keyframes.

    Args:
        given: frame number -> offsets of its painted pixels, at the finest level.
        velocities: as `estimated_velocities` returns them.
    """

    def __init__(
        self, level_frames: LevelFrames, clock: Callable[[str], Any], anywhere: tuple[int, int],
        given: dict[int, Offsets], velocities: Mapping[int, tuple[Flow, Flow]], boil: Boil | None = None,
    ) -> None:  # fmt: skip
        super().__init__(level_frames, clock, anywhere, velocities, boil)
        self._given, self._level = given, level_frames.level
        self.full = sorted(i for i, offsets in given.items() if (offsets[..., 0] > NOWHERE).all())
        self.carried: dict[int, Offsets] = {}
        self._kept: dict[int, tuple[Motion, Motion]] = {}

    def motion(self, index: int, other: int) -> Motion:
        first = min(index, other)
        if first not in self._kept:
            super().motion(index, other)
            self._kept[first] = self._motions.pop(first)
        return self._kept[first][0 if index < other else 1]

    def fixed_offsets(self, index: int) -> Offsets | None:
        outside = super().fixed_offsets(index)
        if index not in self._given:
            return outside
        painted = downscaled_offsets(self._given[index], self._level)
        return painted if outside is None else np.where(painted > NOWHERE, painted, outside)

    def share(self, index: int, forward: bool) -> float:
        """Probability of the neighbour's offset in the random merge (section 4.1): biased towards the nearer key."""
        last = max((i for i in self.full if i <= index), default=None)
        following = min((i for i in self.full if i >= index), default=None)
        if last is None or following is None or last == following:
            return 0.5
        from_last = (following - index) / (following - last)
        return from_last if forward else 1 - from_last

    def ribbons(self, index: int) -> Offsets | None:
        return self.carried.get(index)


@dataclass(frozen=True)
class KeyframeStyle:
    """The keyframes of an interval as one style image.

    Attributes:
        places: where each keyframe lies in the style image.
        given: frame number -> offsets that reproduce the keyframe.
    """

    pair: StylePair
    places: Atlas
    given: dict[int, Offsets]


def keyframe_style(
    context: TaskContext[AnalogyParams],
    source: Source,
    interval: KeyInterval,
    levels: int,
    pad_px: int,
    extra: StylePair | None,
) -> KeyframeStyle:
    """Pack the keyframes of an interval, and a style pair if there is one, into one style image."""
    keys = [source.key(index) for index in interval.keys]
    pairs = [_as_pair(context, source, key) for key in keys] + ([extra] if extra else [])
    places = atlas([(p.output.shape[1], p.output.shape[0]) for p in pairs], levels, 2 * pad_px)
    usable = places.usable([p.usable for p in pairs])
    colours = np.asarray(places.lay([p.output for p in pairs]), np.uint8)
    guide = np.asarray(places.lay([p.guide for p in pairs]), np.uint8)
    further = None
    if pairs[0].extra is not None:
        further = np.asarray(places.lay([p.extra for p in pairs if p.extra is not None]), np.uint8)
    lines = _style_lines(places, pairs)
    given = {
        key.index: places.identity(order, key.painted)
        for order, key in enumerate(keys)
        if interval.start <= key.index < interval.stop
    }
    return KeyframeStyle(StylePair(colours, guide, False, further, usable, lines), places, given)


def _as_pair(context: TaskContext[AnalogyParams], source: Source, key: Keyframe) -> StylePair:
    still = LevelFrames(source, context.clock, key.index, key.index + 1, 0, lambda guide: guide)
    guide = still.guides[key.index]
    extra = np.ascontiguousarray(guide[..., 3:]) if guide.shape[2] > 3 else None
    lines = still.distances.get(key.index)
    return StylePair(key.colours, np.ascontiguousarray(guide[..., :3]), False, extra, key.painted, lines)


def _style_lines(places: Atlas, pairs: list[StylePair]) -> Plane | None:
    """Distances to the lines of all pairs; a pair without lines is far from any line. None = no pair has lines."""
    if all(pair.lines is None for pair in pairs):
        return None
    far = [np.full(pair.output.shape[:2], NO_LINE_PX, np.float32) for pair in pairs]
    return np.asarray(
        places.lay([plane if pair.lines is None else pair.lines for pair, plane in zip(pairs, far, strict=True)]),
        np.float32,
    )
