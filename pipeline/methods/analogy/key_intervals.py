"""Intervals between the keyframes of a shot: how its frames are divided among them.

Intervals (section 4 of benard2013stylizing): keyframes are hard constraints, so frames before the first key, between
two keys and after the last key are independent. A long interval is divided into parts, from its keyframes to its
middle: each part starts from the last frame of the part nearer to the keyframe, which is fixed like a keyframe. The
interval before a keyframe that is painted in parts fills it, and the interval after it starts from the filled frame.

A keyframe whose reach is limited (`key_settings`) divides an interval, too: frames that one of both keyframes reaches
are a part with that keyframe alone; the part with both continues from them. Frames that none reaches are in no
interval, see `gaps`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from types import MappingProxyType

from pipeline.methods.analogy.key_settings import PLAIN, Settings

MAX_INTERVAL_FRAMES = 48
"""Maximum number of frames of an interval; a task holds all of them at one level. The paper has a key every 10 to
20."""
_MIN_INTERVAL_FRAMES = 8
MAX_INTERVAL_BYTES = 3 << 30
MAX_STYLE_PX = 1 << 26
"""Maximum number of pixels of the keyframes that are the style of an interval, if they are painted in parts."""
_MAX_SIDE_KEYS = 6
_INTERVAL_FRAME_BYTES = 60
"""Memory of one frame of an interval at the finest level, bytes per pixel: offsets, pictures, motion in both
directions, two ribbons."""


@dataclass(frozen=True)
class KeyInterval:
    """Frames [start, stop) to synthesise, of which [first, last) are emitted.

    Attributes:
        keys: frame numbers of the keyframes that are the style: those at the ends, and those that paint what these
            leave unpainted.
        fixed: (frame, first frame of the interval that has synthesised it) of frames that are fixed like keyframes.
        layer: number of the layer; -1 = the whole picture.
        weights: of the keyframes before and after it.
    """

    start: int
    stop: int
    first: int
    last: int
    keys: tuple[int, ...]
    fixed: tuple[tuple[int, int], ...] = ()
    layer: int = -1
    weights: tuple[float, float] = (1.0, 1.0)

    @property
    def border(self) -> int:
        """Last frame that the keyframe before it determines more than the one after it."""
        return self.start + _part_of(self.stop - 1 - self.start, self.weights)


def interval_frames(size: tuple[int, int]) -> int:
    """Maximum number of frames of an interval at a frame size (width, height) px: 24 at 1080p."""
    fitting = MAX_INTERVAL_BYTES // (size[0] * size[1] * _INTERVAL_FRAME_BYTES)
    return max(_MIN_INTERVAL_FRAMES, min(MAX_INTERVAL_FRAMES, fitting))


def key_limit(size: tuple[int, int]) -> int:
    """Maximum number of keyframes on each side of an interval that are its style, at a frame size (width, height)."""
    return max(1, min(_MAX_SIDE_KEYS, MAX_STYLE_PX // (2 * size[0] * size[1])))


def split_intervals(
    begin: int,
    end: int,
    keys: list[tuple[int, bool]],
    most: int = MAX_INTERVAL_FRAMES,
    sources: Mapping[int, tuple[Sequence[int], Sequence[int]]] = MappingProxyType({}),
    unit: int = 1,
    settings: Settings = MappingProxyType({}),
    share: bool = True,
) -> Iterator[tuple[str, KeyInterval]]:
    """Split the frames [begin, end) of a shot at its keyframes; yields (task key, interval).

    Args:
        keys: (frame number, whether the keyframe is painted everywhere).
        most: maximum number of frames of an interval.
        sources: keyframes that are the style before and after a keyframe, see `key_sources`; itself if not given.
        unit: number of frames that show one painting; parts begin at multiples of it from the keyframe.
        settings: reach and weight of the keyframes.
        share: whether parts continue from their neighbours; else no frame is fixed but the keyframes.
    """
    full, most = dict(keys), most // unit * unit
    # A keyframe that is the last frame belongs to the interval before it, since a task of its own takes half a second.
    ending = end - 1 if end - 1 in full and end - 1 > begin else end
    filled_by: int | None = None
    """First frame of the part before, whose last frame is the keyframe from which the next interval starts."""
    for left, right in pairwise(sorted({begin, *full, ending})):
        keyed, next_filled_by = (left in full, right in full), None
        ahead, behind = _limits(left, right, keyed, settings)
        both = settings.get(left, PLAIN).weight, settings.get(right, PLAIN).weight
        style = (
            _reaching(sources.get(left, ((left,), ()))[0], left, ahead - 1, settings) if keyed[0] else (),
            _reaching(sources.get(right, ((), (right,)))[1], right, behind, settings) if keyed[1] else (),
        )
        for piece in _pieces(left, right, keyed, (ahead, behind), most, share):
            names = tuple(sorted({index for side, used in zip(style, piece.by, strict=True) if used for index in side}))
            weights = both if all(piece.by) else (1.0, 1.0)
            for part in _interval_parts(piece, names, most, unit, weights):
                fixed = part.fixed if share else ()
                if share and part.start == left and filled_by is not None and not full[left]:
                    fixed = ((left, filled_by), *fixed)
                own = right if piece.by[1] and part.last == right else None
                last = end if part.last == ending and (own is not None or ending not in full) else part.last
                next_filled_by = part.start if own is not None else next_filled_by
                yield interval_key(part.start), replace(part, last=last, fixed=fixed)
        if right == ending and keyed[1] and behind == right:
            yield interval_key(right), KeyInterval(right, end, right, end, tuple(style[1]))
        filled_by = next_filled_by


def gaps(begin: int, end: int, keys: Sequence[int], settings: Settings) -> list[tuple[int, int]]:
    """The runs of frames [first, end) of a shot that none of its keyframes reaches; `keys` has at least one."""
    found = []
    for left, right in pairwise(sorted({begin, *keys, end})):
        ahead, behind = _limits(left, right, (left in keys, right in keys), settings)
        if ahead < behind:
            found.append((ahead, behind))
    return found


def _limits(left: int, right: int, keyed: tuple[bool, bool], settings: Settings) -> tuple[int, int]:
    """The frame after the last one that the keyframe `left` reaches, and the first one that the keyframe `right` does,
    within [left, right); no frame if `keyed` says that there is no keyframe."""
    after, before = settings.get(left, PLAIN).after, settings.get(right, PLAIN).before
    ahead = left if not keyed[0] else right if after is None else min(right, left + after + 1)
    first = left + keyed[0]
    behind = right if not keyed[1] else first if before is None else max(first, right - before)
    return ahead, behind


def _reaching(names: Sequence[int], own: int, frame: int, settings: Settings) -> Sequence[int]:
    """The keyframe `own`, and those of `names` that reach the frame, too."""
    return [index for index in names if index == own or settings.get(index, PLAIN).reaches(frame - index)]


@dataclass(frozen=True)
class _Piece:
    """Frames [left, right) between two keyframes that the same of both reach.

    Attributes:
        stop: right + 1 if the frame `right` is a keyframe, or is shared with another piece, else `right`.
        by: whether the keyframe before, and the one after, reach it.
        fixed: ends that it shares with other pieces: frame -> first frame of the part that has synthesised it.
    """

    left: int
    right: int
    stop: int
    by: tuple[bool, bool]
    fixed: Mapping[int, int] = field(default_factory=dict)


def _pieces(
    left: int, right: int, keyed: tuple[bool, bool], limits: tuple[int, int], most: int, share: bool
) -> Iterator[_Piece]:
    """The pieces between two keyframes in the order of their dependencies: with one keyframe, then with both.

    Args:
        limits: see `_limits`.
        most: maximum number of frames of a part.
        share: whether pieces share a frame with their neighbours, from which they continue.
    """
    ahead, behind = limits
    if not all(keyed) or ahead <= behind:
        if keyed[0]:
            yield _Piece(left, ahead, ahead, (True, False))
        if keyed[1] and behind < right:
            yield _Piece(behind, right, right + 1, (False, True))
        return
    start = left if behind == left + 1 else behind - share
    fixed = {}
    if start > left:
        yield _Piece(left, start, start + share, (True, False))
        fixed[start] = left + (start - left - 1) // most * most
    if ahead < right:
        yield _Piece(ahead, right, right + 1, (False, True))
        fixed[ahead] = ahead
    stop = ahead + (share or ahead == right)
    yield _Piece(start, ahead, stop, (True, True), fixed if share else {})


def _part_of(frames: int, weights: tuple[float, float]) -> int:
    """The number of frames, of those between two keyframes, that the first one determines."""
    return int(frames * (weights[0] / sum(weights)))


def interval_key(start: int, layer: int = -1) -> str:
    """Key of the task that synthesises the interval from frame `start` on."""
    return f"layer-{layer}-keyed-{start:07d}" if layer >= 0 else f"keyed-{start:07d}"


def _interval_parts(
    piece: _Piece, keys: tuple[int, ...], most: int, unit: int, weights: tuple[float, float]
) -> Iterator[KeyInterval]:
    """Divide one piece into parts of at most `most` frames, in the order of their dependencies.

    Neighbouring parts share a frame, which the part nearer to a keyframe synthesises. Between two keyframes, parts
    continue from both of them, and the part in the middle, of `most` frames, leads from one side to the other.

    Args:
        keys: the keyframes that are its style.
        unit: see `split_intervals`.
        weights: of the keyframes at its ends.
    """
    left, right, outer = piece.left, piece.right, piece.fixed
    forward_end, backward_begin = right, right
    if right - left > most and all(piece.by):
        forward_end = left + _part_of(right - left - most + 1, weights) // unit * unit
        backward_begin = forward_end + most
    elif piece.by == (False, True):
        forward_end = backward_begin = left

    def part(start: int, inner: int, fixed: dict[int, int]) -> KeyInterval:
        """The part that emits [start, inner); `fixed`: frame -> first frame of the part that has synthesised it."""
        fixed = {frame: by for frame, by in outer.items() if frame in (start, inner)} | fixed
        stop = piece.stop if inner == right else inner + 1
        return KeyInterval(start, stop, start, inner, keys, tuple(fixed.items()), weights=weights)

    before, after = left, right
    for start in range(left, forward_end, most):
        inner = min(start + most, forward_end)
        yield part(start, inner, {start: before} if start > left else {})
        before = start
    for start in reversed(range(backward_begin, right, most)):
        inner = min(start + most, right)
        yield part(start, inner, {inner: after} if inner < right else {})
        after = start
    if forward_end < backward_begin:
        middle = {forward_end: before} if forward_end > left else {}
        middle |= {backward_begin: after} if backward_begin < right else {}
        yield part(forward_end, backward_begin, middle)
