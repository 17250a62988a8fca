"""Ribbons: paths along which the pixels of keyframes move through an interval.

Section 4.1 of benard2013stylizing: ribbons connect each pixel to its positions in the neighbouring keyframes, which
extend the search.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from pipeline.synthesis.images import NOWHERE, Offsets
from pipeline.synthesis.operations import FrameState, LoadedStyle, Operations, T
from pipeline.synthesis.sweeps import Animation


def ribbons_to_keys(
    ops: Operations[T], style: LoadedStyle[T], animation: Animation, frames: range, painted: Mapping[int, Offsets]
) -> dict[int, Offsets]:
    """For each frame, the position of each pixel in the keyframe before and in the keyframe after it.

    A partial keyframe replaces the one behind it where it is painted; elsewhere the one behind it is used.

    Args:
        frames: frame numbers of the interval.
        painted: frame number -> offsets of the painted pixels, float32 (h, w, 2), NOWHERE elsewhere.

    Returns:
        Frame number -> offsets, float32 (2, h, w, 2), NOWHERE where no keyframe is reached; empty without keyframes.
    """
    keys = [index for index in frames if index in painted]
    if not keys:
        return {}
    shape = painted[keys[0]].shape
    found = {index: np.empty((2, *shape), np.float32) for index in frames}
    for slot, ahead in ((0, frames), (1, frames[::-1])):
        empty = set(frames)
        for key in (index for index in ahead if index in painted):
            reached = ahead[ahead.index(key) :]
            for index, offsets in _traced(ops, style, animation, reached, painted[key]):
                ribbon = found[index][slot]
                if index in empty:
                    ribbon[...] = offsets
                else:
                    np.copyto(ribbon, offsets, where=offsets > NOWHERE)
            empty.difference_update(reached)
        for index in empty:
            found[index][slot] = NOWHERE
    return found


def _traced(
    ops: Operations[T], style: LoadedStyle[T], animation: Animation, frames: Iterable[int], start: Offsets
) -> Iterator[tuple[int, Offsets]]:
    """Trace the pixels of a keyframe from frame to frame: for each pixel, its position in the keyframe as an offset.

    Positions are translated but not rotated, because they are points and not patches.

    Args:
        frames: frame numbers in order of distance from the keyframe, which is the first.
        start: offsets of the keyframe, float32 (h, w, 2).

    Yields:
        (frame number, offsets).
    """
    plain = replace(style, style=replace(style.style, bins=None, usable=None))
    before: tuple[int, T] | None = None
    for index in frames:
        if before is None:
            found = ops.upload(start)
        else:
            motion = animation.motion(index, before[0])
            state = FrameState((start.shape[1], start.shape[0]), before[1], before[1])
            displacement, visible = ops.upload(motion.displacement), ops.upload(motion.visible)
            found = ops.advect(plain, state, before[1], None, displacement, visible)
        before = index, found
        yield index, ops.fetch(found)
