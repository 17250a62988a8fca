"""The matte of an object that is clicked: its outline in one frame, followed through the frames before and after it.

From frame to frame, the mask is moved along the optical flow, and decided again where that is uncertain, see
`foreground.propagate_foreground` (bai2009snapcut). This is done at a reduced size; `LabelMattes` makes of it a soft
matte at the frame's size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Mask, Plane
from pipeline.perception.cuts import is_cut, thumbnail
from pipeline.perception.flow.dis import dis
from pipeline.perception.flow.gray import to_gray
from pipeline.perception.flow.reliability import looks_alike, visible
from pipeline.perception.flow.warp import positions
from pipeline.perception.object_mask import Box, object_mask
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


@dataclass(frozen=True)
class ObjectMark:
    """A click on an object of a frame, or a box around it (`object_mask`). `erase`: it is not part of the matte."""

    frame: int
    box: Box
    erase: bool = False


Read = Callable[[int, int], Iterator[Frame]]
"""Frames [start, stop) of the video at full size."""


def follow_marks(marks: Sequence[ObjectMark], frames: tuple[int, int], read: Read) -> Iterator[tuple[int, Plane]]:
    """(frame, matte) of frames [first, end): float32 (height, width), 0..1.

    An object is followed forwards from its mark, and up to the first mark of the shot also backwards. A mark on a later
    frame adds to what has been followed so far, or takes away from it. A cut ends an object; where nothing is marked
    between two cuts, the matte is 0.

    Args:
        marks: in the order in which they were made.
    """
    earlier: list[int] = []
    mask: Mask | None = None
    before: _Reduced | None = None
    for number, frame in enumerate(read(*frames), frames[0]):
        now = _Reduced(frame.shape[:2], thumbnail(frame), _small(frame))
        if before is not None and is_cut(before.thumbnail, now.thumbnail):
            yield from _nothing(earlier, before.full_size)
            earlier, mask = [], None
        own = [mark for mark in marks if mark.frame == number]
        if mask is None and not own:
            earlier.append(number)
        else:
            moved = np.zeros(now.small.shape[:2], bool)
            if mask is not None and before is not None:
                moved = _carried(mask, before.small, now.small)
            mask = _marked(now.small, moved, own)
            yield number, _matte(mask, frame)
            yield from _backwards(mask, frame, earlier, read)
            earlier = []
        before = now
    if before is not None:
        yield from _nothing(earlier, before.full_size)


class _Reduced(NamedTuple):
    """What the next frame needs of a frame."""

    full_size: tuple[int, ...]
    """Height and width of the frame, px."""
    thumbnail: Plane
    small: Frame
    """The frame at the size in which an object is followed."""


def _nothing(numbers: Sequence[int], size: tuple[int, ...]) -> Iterator[tuple[int, Plane]]:
    """Mattes of 0. `size`: height and width, px."""
    yield from ((number, np.zeros(size, np.float32)) for number in numbers)


def _backwards(mask: Mask, frame: Frame, numbers: Sequence[int], read: Read) -> Iterator[tuple[int, Plane]]:
    """The object followed from a frame to those before it, which are consecutive, if there are any."""
    after = _small(frame)
    if not numbers:
        return
    for stop in range(numbers[-1] + 1, numbers[0], -BACK_FRAMES):
        start = max(stop - BACK_FRAMES, numbers[0])
        for number, one in reversed(list(enumerate(read(start, stop), start))):
            small = _small(one)
            mask = _carried(mask, after, small)
            after = small
            yield number, _matte(mask, one)


def _small(frame: Frame) -> Frame:
    height, width = frame.shape[:2]
    return shrink(frame, size_within((width, height), SIDE_PX))


def _marked(small: Frame, mask: Mask, marks: Iterable[ObjectMark]) -> Mask:
    """The mask with the marked objects of its frame, or without them."""
    for mark in marks:
        found = object_mask(small, mark.box)
        mask = mask & ~found if mark.erase else mask | found
    return mask


def _carried(mask: Mask, there: Frame, here: Frame) -> Mask:
    """A frame's mask from that of a neighbour: bool (h, w).

    Args:
        mask: of the neighbour.
        there, here: the neighbour and the frame, uint8 (h, w, 3).
    """
    grays = to_gray(here), to_gray(there)
    flow, back = dis(*grays, "medium"), dis(*grays[::-1], "medium")
    x, y = positions(flow)
    labels = cv2.remap(mask.astype(np.uint8), x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    sure = visible(flow, back) & looks_alike(*grays, flow, ALIKE)
    weights = np.where(sure, np.float32(1), np.float32(0.05))
    choices: NDArray[np.int32] = labels.astype(np.int32) + 1
    found = propagate_foreground(choices[None], weights[None], here, motion_edges(None, flow, here, COLOUR_UNIT))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * BAND_PX + 1, 2 * BAND_PX + 1))
    least, most = cv2.erode(labels, disc) > 0, cv2.dilate(labels, disc) > 0
    return np.asarray(least | (found & most))


def _matte(mask: Mask, frame: Frame) -> Plane:
    height, width = frame.shape[:2]
    whole = slice(0, height), slice(0, width)
    return LabelMattes(mask.astype(np.int32), frame).alpha(1, whole)
