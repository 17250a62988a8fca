"""The matte of an object that is clicked: its outline in one frame, followed through the frames before and after it.

From frame to frame, the mask is moved along the optical flow, and decided again where that is uncertain, see
`foreground.propagate_foreground` (bai2009snapcut). This is done at a reduced size; `LabelMattes` makes of it a soft
matte at the frame's size.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import ceil
from typing import Any, NamedTuple, Protocol, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.perception.cuts import is_cut, thumbnail
from pipeline.perception.flow.dis import dis
from pipeline.perception.flow.gray import to_gray
from pipeline.perception.flow.reliability import looks_alike, visible
from pipeline.perception.flow.warp import positions
from pipeline.perception.object_mask import Box, clicked_pixels, object_mask, without_object
from pipeline.perception.shrink import shrink, size_within
from pipeline.regions.foreground import propagate_foreground
from pipeline.regions.mattes import LabelMattes
from pipeline.regions.random_walk import motion_edges

SIDE_PX = 320
"""Longer side of the frames in which an object is found and followed."""
COLOUR_UNIT = 12.0
"""Colour difference, gray levels, that separates two pixels as much as a difference of their motion of 1 px."""
ALIKE = 12.0
"""Largest difference of brightness, gray levels, of a pixel to its past that the flow has found."""
BAND_PX = 4
"""How far from its moved outline an object's outline may be, px of the frames in which it is followed: elsewhere
colours that are like the object's would join it."""
BACK_FRAMES = 8
"""Frames that are read together where an object is followed backwards."""


Stroke = tuple[tuple[float, float, float], ...]
"""A painted line: points as shares of the frame's sides, each with the width there as a share of the frame's width."""


@dataclass(frozen=True)
class ObjectMark:
    """A click on an object of a frame, or a box around it (`object_mask`); or, with a `stroke`, what is painted.

    `erase`: it is not part of the matte.
    """

    frame: int
    box: Box | None = None
    erase: bool = False
    stroke: Stroke = ()


class ObjectMatte(NamedTuple):
    """The matte of one frame."""

    frame: int
    key: Hashable
    """Equal for equal mattes of the frame."""
    alpha: Callable[[], Plane]
    """Makes the matte: float32 (height, width), 0..1."""


Read = Callable[[int, int], Iterator[Frame]]
"""Frames [start, stop) of the video at full size."""
T = TypeVar("T")


class Memory(Protocol):
    """Keeps what was found of a video, for the next call."""

    def peek(self, key: Hashable) -> Any:
        """The value that is kept for the key; None: there is none."""

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """The value that is kept for the key. If there is none, call `make` and keep its value."""


class NoMemory:
    """Keeps nothing."""

    def peek(self, key: Hashable) -> Any:
        return None

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        return make()


NO_MEMORY = NoMemory()


def follow_marks(
    marks: Sequence[ObjectMark], frames: tuple[int, int], read: Read, shown: int = -1, memory: Memory = NO_MEMORY
) -> Iterator[ObjectMatte]:
    """The mattes of frames [first, end), each once.

    An object is followed forwards from its mark, and up to the first mark of the shot also backwards. A mark on a later
    frame adds to what has been followed so far, or takes away from it. A cut ends an object; where nothing is marked
    between two cuts, the matte is 0.

    Args:
        marks: in the order in which they were made.
        shown: the frame whose matte comes first, if it is known without following an object to it.
        memory: for frames of this video. It changes no matte.
    """
    follower = _Follower(tuple(mark for mark in marks if frames[0] <= mark.frame < frames[1]), read, memory)
    at_once = follower.at_once(shown) if frames[0] <= shown < frames[1] else None
    if at_once is not None:
        yield at_once
    yield from (matte for matte in follower.follow(frames) if at_once is None or matte.frame != shown)


class _Reduced(NamedTuple):
    """What the next frame needs of a frame."""

    full_size: tuple[int, ...]
    """Height and width of the frame, px."""
    thumbnail: Plane
    small: Frame
    """The frame at the size in which an object is followed."""


class _Motion(NamedTuple):
    """How pixels of a frame have moved from its neighbour."""

    flow: Flow
    sure: Mask
    """Pixels whose surface is also visible in the neighbour: bool (h, w)."""


class _Follower:
    """Follows the marked objects of one video."""

    def __init__(self, marks: tuple[ObjectMark, ...], read: Read, memory: Memory) -> None:
        self._marks, self._read, self._memory = marks, read, memory

    def at_once(self, number: int) -> ObjectMatte | None:
        """The matte of a frame, if the one of the frame before is known, or if no mark is on an earlier frame."""
        own = self._own(number)
        earlier = self._until(number - 1)
        before = self._memory.peek(("mask", number - 1, earlier))
        if not own or (earlier and before is None):
            return None
        reduced = {n: self._memory.peek(("reduced", n)) for n in (number - 1, number)}
        (frame,) = self._read(number, number + 1)
        now = reduced[number] or self._reduced(number, frame)
        if not earlier:
            return self._forwards(number, frame, now, None, None)
        if reduced[number - 1] is None or is_cut(reduced[number - 1].thumbnail, now.thumbnail):
            return None
        return self._forwards(number, frame, now, before, reduced[number - 1])

    def follow(self, frames: tuple[int, int]) -> Iterator[ObjectMatte]:
        """The mattes of frames [first, end), each once."""
        earlier: list[int] = []
        mask: Mask | None = None
        before: _Reduced | None = None
        for number, frame in enumerate(self._read(*frames), frames[0]):
            now = self._reduced(number, frame)
            if before is not None and is_cut(before.thumbnail, now.thumbnail):
                yield from self._nothing(earlier, before.full_size)
                earlier, mask = [], None
            if mask is None and not self._own(number):
                earlier.append(number)
            else:
                yield self._forwards(number, frame, now, mask, before)
                mask = self._mask(number, now, mask, before)
                yield from self._backwards(number, mask, now, earlier)
                earlier = []
            before = now
        if before is not None:
            yield from self._nothing(earlier, before.full_size)

    def _own(self, number: int) -> tuple[ObjectMark, ...]:
        return tuple(mark for mark in self._marks if mark.frame == number)

    def _until(self, number: int) -> tuple[ObjectMark, ...]:
        return tuple(mark for mark in self._marks if mark.frame <= number)

    def _reduced(self, number: int, frame: Frame) -> _Reduced:
        def reduce() -> _Reduced:
            small = shrink(frame, size_within((frame.shape[1], frame.shape[0]), SIDE_PX))
            return _Reduced(frame.shape[:2], thumbnail(frame), small)

        return self._memory.get(("reduced", number), reduce)

    def _forwards(
        self, number: int, frame: Frame, now: _Reduced, before: Mask | None, there: _Reduced | None
    ) -> ObjectMatte:
        mask = self._mask(number, now, before, there)
        return ObjectMatte(number, ("forwards", number, self._until(number)), partial(_matte, mask, frame))

    def _mask(self, number: int, now: _Reduced, before: Mask | None, there: _Reduced | None) -> Mask:
        """The mask of a frame from that of the frame before and its own marks: bool (h, w)."""

        def make() -> Mask:
            moved = np.zeros(now.small.shape[:2], bool)
            if before is not None and there is not None:
                moved = _carried(before, self._motion(number, -1, now.small, there.small), now.small)
            return _marked(now.small, moved, self._own(number))

        return self._memory.get(("mask", number, self._until(number)), make)

    def _motion(self, number: int, by: int, here: Frame, there: Frame) -> _Motion:
        return self._memory.get(("motion", number, by), lambda: _find_motion(here, there))

    def _backwards(self, marked: int, mask: Mask, after: _Reduced, numbers: Sequence[int]) -> Iterator[ObjectMatte]:
        """The object followed from a frame to those before it, which are consecutive, if there are any."""
        if not numbers:
            return
        for stop in range(numbers[-1] + 1, numbers[0], -BACK_FRAMES):
            start = max(stop - BACK_FRAMES, numbers[0])
            for number, frame in reversed(list(enumerate(self._read(start, stop), start))):
                now = self._reduced(number, frame)
                key = ("backwards", number, self._own(marked))
                mask = self._memory.get(key, partial(self._carried_back, number, mask, now, after))
                after = now
                yield ObjectMatte(number, key, partial(_matte, mask, frame))

    def _carried_back(self, number: int, mask: Mask, now: _Reduced, after: _Reduced) -> Mask:
        return _carried(mask, self._motion(number, 1, now.small, after.small), now.small)

    def _nothing(self, numbers: Sequence[int], size: tuple[int, ...]) -> Iterator[ObjectMatte]:
        """Mattes of 0. `size`: height and width, px."""
        yield from (ObjectMatte(number, "nothing", partial(_black, size)) for number in numbers)


def _marked(small: Frame, mask: Mask, marks: Iterable[ObjectMark]) -> Mask:
    """The mask with the marked objects of its frame, or without them. What was marked before on the frame stays."""
    kept, erased = np.zeros((2, *mask.shape), bool)
    for mark in marks:
        if mark.box is None:
            pixels = painted_pixels(mask.shape, mark.stroke)
            mask = mask & ~pixels if mark.erase else mask | pixels
        else:
            pixels = clicked_pixels(small, mark.box)
            if mark.erase:
                mask = without_object(small, mask, mark.box, kept & ~pixels)
            else:
                mask = mask | object_mask(small, mark.box, erased & ~pixels, mask)
        kept, erased = (kept & ~pixels, erased | pixels) if mark.erase else (kept | pixels, erased & ~pixels)
    return mask


def painted_pixels(size: tuple[int, ...], stroke: Stroke) -> Mask:
    """Pixels that a stroke covers: bool (h, w). `size`: height and width, px."""
    height, width = size
    pixels = np.zeros((height, width), np.uint8)
    points = [(x * width - 0.5, y * height - 0.5, max(1.0, share * width)) for x, y, share in stroke]
    for (x, y, one), (to_x, to_y, other) in zip(points, [*points[1:], points[-1]], strict=True):
        steps = max(1, ceil(2 * max(abs(to_x - x), abs(to_y - y))))
        for t in np.linspace(0, 1, steps + 1):
            centre = round(16 * (x + t * (to_x - x))), round(16 * (y + t * (to_y - y)))
            cv2.circle(pixels, centre, round(8 * (one + t * (other - one))), 1, -1, cv2.LINE_8, 4)
    return pixels > 0


def _find_motion(here: Frame, there: Frame) -> _Motion:
    """Motion of a frame from its neighbour: uint8 (h, w, 3) both."""
    grays = to_gray(here), to_gray(there)
    flow, back = dis(*grays, "medium"), dis(*grays[::-1], "medium")
    return _Motion(flow, visible(flow, back) & looks_alike(*grays, flow, ALIKE))


def _carried(mask: Mask, motion: _Motion, here: Frame) -> Mask:
    """A frame's mask from that of a neighbour: bool (h, w).

    Args:
        mask: of the neighbour.
        motion: of the frame from the neighbour.
        here: the frame, uint8 (h, w, 3).
    """
    x, y = positions(motion.flow)
    labels = cv2.remap(mask.astype(np.uint8), x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    weights = np.where(motion.sure, np.float32(1), np.float32(0.05))
    choices: NDArray[np.int32] = labels.astype(np.int32) + 1
    edges = motion_edges(None, motion.flow, here, COLOUR_UNIT)
    found = propagate_foreground(choices[None], weights[None], here, edges)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * BAND_PX + 1, 2 * BAND_PX + 1))
    least, most = cv2.erode(labels, disc) > 0, cv2.dilate(labels, disc) > 0
    return np.asarray(least | (found & most))


def _black(size: tuple[int, ...]) -> Plane:
    return np.zeros(size, np.float32)


def _matte(mask: Mask, frame: Frame) -> Plane:
    height, width = frame.shape[:2]
    whole = slice(0, height), slice(0, width)
    return LabelMattes(mask.astype(np.int32), frame).alpha(1, whole)
