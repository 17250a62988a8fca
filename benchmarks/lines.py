"""How straight the lines of `abstraction` are where the source is straight.

    python -m benchmarks lines                                 clips of architecture at 720 and 1080 lines
    python -m benchmarks.lines CLIP HEIGHT FRAMES              one clip

The source's straight edges are found by OpenCV's line segment detector (vongioi2010lsd), which the method does not use.
Across each edge, once a pixel, the axis of the ink is the middle of the nearest stroke. Figures of an edge, px of the
picture, are printed as their median and 90th percentile over all edges of which ink covers more than half: the rest
are edges beside which another line runs, or that other lines cross.

    distance    root mean square distance of the axis from the edge
    wobble      the same from the straight line that fits the axis best: 0 = ruled, even if it stands beside the edge
    width       standard deviation of the width of the ink along the edge
    inked       share of the length of all edges that has ink
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.clips import MEDIA, fit
from pipeline.frames import Frame
from pipeline.methods.abstraction import AbstractionParams, AbstractionSession
from pipeline.video.reader import VideoReader

CLIPS = (
    ("street_pan_1080p.mp4", 1080), ("street_pan_1080p.mp4", 720), ("seattle_pan_640x360.avi", 720),
    ("bikes_scene_cuts.mp4", 720),
)  # fmt: skip
FRAMES = 12
WARM_FRAMES = 3
"""Frames before the first measured one: lines fade in."""
SHORTEST = 0.06
"""Shortest edge, in heights of the frame."""
REACH = 0.01
"""Distance from an edge in which ink is searched, in heights of the frame."""


@dataclass(frozen=True)
class Straightness:
    """Figures of some frames, see above."""

    distance_px: tuple[float, float]
    wobble_px: tuple[float, float]
    width_px: tuple[float, float]
    inked: float
    edges: int


def straight_edges(gray: NDArray[np.uint8]) -> NDArray[np.float32]:
    """float32 (n, 4): x and y of both ends of the straight edges, px."""
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_ADV).detect(gray)[0]
    edges = np.zeros((0, 4), np.float32) if found is None else found.reshape(-1, 4)
    return np.asarray(edges[np.hypot(*(edges[:, 2:] - edges[:, :2]).T) >= SHORTEST * gray.shape[0]], np.float32)


def ink_profile(ink: NDArray[np.uint8], edge: NDArray[np.float32], reach_px: float) -> NDArray[np.float64]:
    """float64 (n, 2): signed distance of the ink's axis and width of the ink, px, once a pixel along an edge; NaN where
    there is no ink within reach.

    Args:
        ink: uint8 (h, w), 255 = full ink.
    """
    ends = edge.reshape(2, 2).astype(np.float64)
    length = float(np.hypot(*(ends[1] - ends[0])))
    along = (ends[1] - ends[0]) / length
    steps = np.arange(-2 * reach_px, 2 * reach_px + 0.05, 0.1)
    places = ends[0] + np.arange(1, length)[:, None] * along
    grid = places[:, None] + steps[:, None] * np.array([-along[1], along[0]])
    profile = cv2.remap(ink, grid[..., 0].astype(np.float32), grid[..., 1].astype(np.float32), cv2.INTER_LINEAR) >= 128
    return np.array([_nearest_run(row, steps, reach_px) for row in profile]).reshape(-1, 2)


def _nearest_run(row: NDArray[np.bool_], steps: NDArray[np.float64], reach_px: float) -> tuple[float, float]:
    changes = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]]).astype(np.int8)))
    starts, stops = steps[changes[::2]], steps[changes[1::2] - 1]
    near = np.maximum(np.maximum(starts, -stops), 0) <= reach_px
    if not near.any():
        return np.nan, np.nan
    best = np.abs(starts + stops)[near].argmin()
    return (starts[near][best] + stops[near][best]) / 2, stops[near][best] - starts[near][best]


def straightness(frames: Sequence[Frame], inks: Sequence[NDArray[np.uint8]]) -> Straightness:
    """Measure the ink of some frames against the straight edges of their sources."""
    figures, inked, samples = [], 0, 0
    for frame, ink in zip(frames, inks, strict=True):
        for edge in straight_edges(np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)):
            profile = ink_profile(ink, edge, REACH * len(frame))
            drawn = np.flatnonzero(~np.isnan(profile[:, 0]))
            inked, samples = inked + len(drawn), samples + len(profile)
            if 2 * len(drawn) <= len(profile):
                continue
            axis, width = profile[drawn].T
            ruled = np.polyval(np.polyfit(drawn, axis, 1), drawn)
            figures.append([float(np.sqrt(np.mean(part**2))) for part in (axis, axis - ruled, width - width.mean())])
    middle, high = np.percentile(np.array(figures or [[np.nan] * 3]), [50, 90], axis=0).tolist()
    spans = list(zip(middle, high, strict=True))
    return Straightness(spans[0], spans[1], spans[2], inked / max(samples, 1), len(figures))


def paint(path: Path, height: int, count: int) -> tuple[list[Frame], list[NDArray[np.uint8]]]:
    """Source frames of a clip at a height, px, and the ink of its cartoon, both without `WARM_FRAMES`."""
    with VideoReader(path) as reader:
        frames = list(reader.read(0, count + WARM_FRAMES))
    size = (round(height * frames[0].shape[1] / frames[0].shape[0] / 2) * 2, height)
    frames = [fit(frame, size) for frame in frames]
    session = AbstractionSession(AbstractionParams(), size)
    painted = [session.finish(session.analyze(frame)).lines for frame in frames]
    return frames[WARM_FRAMES:], [lines.coverage for lines in painted[WARM_FRAMES:] if lines is not None]


def main(clips: Sequence[tuple[str, int]] = CLIPS, count: int = FRAMES) -> None:
    print(f"{'clip':28}{'height':>8}{'edges':>8}{'distance':>14}{'wobble':>14}{'width':>14}{'inked':>8}")
    for name, height in clips:
        row = straightness(*paint(MEDIA / name, height, count))
        spans = "".join(f"{f'{a:.2f} / {b:.2f}':>14}" for a, b in (row.distance_px, row.wobble_px, row.width_px))
        print(f"{name:28}{height:8}{row.edges:8}{spans}{row.inked:8.2f}")


if __name__ == "__main__":
    main([(sys.argv[1], int(sys.argv[2]))], int(sys.argv[3])) if len(sys.argv) > 3 else main()
