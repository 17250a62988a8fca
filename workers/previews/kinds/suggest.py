"""Suggests frames for painted keys: after cuts, and where much of the picture is hidden, misfits or is new since the
last key."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.perception.cuts import is_cut, thumbnail
from pipeline.perception.flow import estimate
from pipeline.perception.flow.gray import to_gray
from pipeline.perception.flow.reliability import visible
from pipeline.perception.flow.warp import warp_back
from workers.previews.context import PreviewContext
from workers.previews.model import Record

SIDE_PX = 160
MISFIT_LEVELS = 24.0
"""Gray levels by which a frame differs from the one before, moved along the motion, for a pixel to count as misfit."""
NEAREST = 4
"""Suggested keys are at least this many frames apart, unless there is a cut."""
PIECE = 32


def suggest(context: PreviewContext) -> Iterator[Record]:
    """Scores of every frame of a range, then the frames with the highest accumulated change."""
    key = context.query.layers[0].video
    total = context.frames.info(key).frames
    start, stop = context.options.get("frames") or (0, total)
    start, stop = min(start, total - 1), min(stop, total)
    scores, before = [(0.0, 0.0, 1.0)], context.frames.frame(key, start, SIDE_PX)
    for first in range(start + 1, stop, PIECE):
        for frame in context.frames.frames(key, first, min(first + PIECE, stop), SIDE_PX):
            context.check()
            scores.append(_scores(before, frame))
            before = frame
        yield Record({"type": "progress", "done": round(len(scores) / (stop - start), 3), "note": "Comparing frames"})
    columns = np.round(np.array(scores).T, 4)
    names = ("occlusion", "misfit", "novelty")
    yield Record({"type": "scores", "frames": [start, stop]} | dict(zip(names, columns.tolist(), strict=True)))
    yield Record({"type": "keys", "frames": [start + k for k in chosen(columns, context.options["count"])]})


def _scores(before: Frame, now: Frame) -> tuple[float, float, float]:
    """Share of pixels that are hidden, that misfit where they are not, and whether a shot begins (0 or 1)."""
    if is_cut(thumbnail(before), thumbnail(now)):
        return 0.0, 0.0, 1.0
    a, b = to_gray(before), to_gray(now)
    back, forth = estimate(b, a, "dis-fast"), estimate(a, b, "dis-fast")
    matched = visible(back, forth)
    apart = np.abs(warp_back(a, back).astype(np.float32) - b.astype(np.float32)) > MISFIT_LEVELS
    return float(1 - matched.mean()), float((apart & matched).mean()), 0.0


def chosen(scores: NDArray[np.float64], count: int) -> Sequence[int]:
    """At most `count` frames: the first of each shot, then frames that divide the accumulated change evenly.

    Args:
        scores: (3, frames): hidden, misfit, new.
    """
    change = scores[0] + scores[1]
    cuts = np.flatnonzero(scores[2] > 0).tolist()
    picked = set(cuts[:count])
    total, left = float(change.sum()), count - len(picked)
    if left > 0 and total > 0:
        reached = np.cumsum(change) / total
        for k in range(1, left + 1):
            frame = int(np.searchsorted(reached, k / (left + 1)))
            if all(abs(frame - other) >= NEAREST for other in picked) and frame < scores.shape[1]:
                picked.add(frame)
    return sorted(picked)
