"""Selects the frame pairs, and the part of them, that a quality report measures, to limit its cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.frames import Frame

SHARE = 0.04
"""Share of the render's expected processor time that the report may take."""
RENDER_S = 1.0
"""Processor time of a render that does not depend on its length, s."""
PAIR_S, PAIR_S_PER_MEGAPIXEL = 0.04, 0.07
"""Processor time of one pair, s, without a search for faces: measured, as the next two, see docs/quality.md."""
FACES_S = 0.19
"""Processor time of one search for faces, at a width of at most 640 px, s."""
FIRST_FRAME_S_PER_MEGAPIXEL = 0.7
"""Additional processor time of a method for the first frame of a video, compared with a later frame, s."""
MOST_PAIRS = 60
MOST_BYTES = 64 << 20
"""Limit of the source frames that a job keeps in memory for its report."""
ALONE_EVERY, MOST_ALONE = 150, 3
"""Interval, in frames, of the pairs that are also painted frame by frame, and their maximum number."""
TILE_PX = (320, 180)
"""(width, height) of the part of each pair that is compared at full resolution."""
FACES_EVERY = 6
"""Interval of the sampled pairs in which faces are searched."""
_STEPS = 0.7548776662466927, 0.5698402909980532
"""Steps of the sequence of places, which covers the square evenly (the R2 sequence): inverses of the powers of the
root of x^3 = x + 1."""


def sampled_pairs(frames: int, count: int) -> list[int]:
    """Second frames of at most `count` pairs (t - 1, t), evenly spread over a video of `frames` frames."""
    pairs = max(0, frames - 1)
    number = min(pairs, count)
    return sorted({1 + (2 * i + 1) * pairs // (2 * number) for i in range(number)})


@dataclass(frozen=True)
class SampleSize:
    """Number of measurements in the report of a job.

    Attributes:
        pairs: pairs of frames, at least 1.
        alone: of these, pairs that are also painted frame by frame.
        faces: whether faces are searched, in one of `FACES_EVERY` pairs.
    """

    pairs: int
    alone: int
    faces: bool


def affordable_sample(
    frames: int, size: tuple[int, int], cpu_s_per_megapixel: float, stand_alone: bool = True
) -> SampleSize:
    """Number of measurements of a job's report. One pair is always measured; then, as far as `SHARE` of the
    render's time pays for them, faces are searched, pairs are painted frame by frame, and further pairs are measured.

    It depends on the video and the method only, so that equal jobs have equal reports.

    Args:
        size: (width, height), px.
        cpu_s_per_megapixel: processor time of the method a frame and megapixel, s.
        stand_alone: whether frames of this job can be painted without the others.
    """
    megapixels = size[0] * size[1] / 1e6
    pair_s = PAIR_S + PAIR_S_PER_MEGAPIXEL * megapixels
    alone_s = 2 * (FIRST_FRAME_S_PER_MEGAPIXEL + cpu_s_per_megapixel) * megapixels
    left_s = SHARE * (RENDER_S + cpu_s_per_megapixel * megapixels * frames) - pair_s
    faces = left_s >= FACES_S
    left_s -= FACES_S * faces
    alone = max(0, min(frames // ALONE_EVERY, MOST_ALONE, int(left_s / alone_s))) if stand_alone else 0
    left_s -= alone * alone_s
    affordable = 1 + left_s / (pair_s + faces * FACES_S / FACES_EVERY)
    kept = MOST_BYTES / (6e6 * max(megapixels, 1e-6))
    pairs = max(1, int(min(affordable, kept, MOST_PAIRS)))
    return SampleSize(pairs, min(alone, pairs), faces)


def job_pairs(frames: int, sheet: Sequence[int], count: int) -> list[int]:
    """Second frames of a job's pairs. As far as they suffice, they are frames that the contact sheet decodes anyway.

    Args:
        sheet: frames of the contact sheet, ascending.
    """
    if count > len(sheet):
        return sampled_pairs(frames, count)
    chosen = {max(1, sheet[(2 * i + 1) * len(sheet) // (2 * count)]) for i in range(count)}
    return sorted(frame for frame in chosen if frame < frames)


def tile(frame: Frame, ordinal: int) -> Frame:
    """The part of a frame that the sample with this number compares: at most 320 x 180 px, at a place that goes through
    the picture evenly from sample to sample."""
    (height, width), (across, down) = frame.shape[:2], TILE_PX
    x, y = ((0.5 + ordinal * step) % 1 for step in _STEPS)
    left, top = int(x * max(0, width - across)), int(y * max(0, height - down))
    part: Frame = frame[top : top + down, left : left + across].copy()
    return part
