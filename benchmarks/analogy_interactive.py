"""Latency of interactive propagation: ms from an edit of a keyframe to its four repainted neighbours, over 50 edits.

`python -m benchmarks.analogy_interactive`. 480x270, two frames on each side of the key; an edit is a disc of colour.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import cv2
import numpy as np

from pipeline.frames import Frame
from pipeline.methods.analogy.propagation import Propagator
from pipeline.methods.analogy.style_images import paint_in_strokes
from pipeline.scenes import scene

SIZE = (480, 270)
EDITS = 50
KEY, AROUND = 5, 2


def frames() -> Sequence[Frame]:
    made = scene("harbour", SIZE, frames=12)
    return [made.image(index) for index in range(11)]


def edited(image: Frame, rng: np.random.Generator) -> Frame:
    """The painting with one more disc of 6 to 30 px radius."""
    out = image.copy()
    centre = (int(rng.integers(SIZE[0])), int(rng.integers(SIZE[1])))
    cv2.circle(out, centre, int(rng.integers(6, 30)), [int(c) for c in rng.integers(0, 256, 3)], -1)
    return out


def measure(local: bool) -> list[float]:
    """Seconds per edit. `local`: reuse earlier results; otherwise each edit reuses the optical flow only."""
    shot, rng = frames(), np.random.default_rng(1)
    image = paint_in_strokes(shot[KEY])
    propagator = Propagator(shot)
    propagator.prepare(KEY, AROUND)
    list(propagator.repaint(KEY, image, AROUND))
    found = []
    for _ in range(EDITS):
        image = edited(image, rng) if local else np.ascontiguousarray(255 - image)
        start = time.perf_counter()
        list(propagator.repaint(KEY, image, AROUND))
        found.append(time.perf_counter() - start)
    return found


def main() -> None:
    """Print median and 95th percentile."""
    for local in (True, False):
        ms = np.array(measure(local)) * 1000
        kind = "local edits" if local else "whole key changed"
        print(f"  {kind}: median {np.median(ms):.0f} ms, 95th percentile {np.percentile(ms, 95):.0f} ms")


if __name__ == "__main__":
    main()
