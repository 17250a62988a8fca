"""Optical flow: time and error of our TV-L1 kernel, OpenCV's DualTVL1 and DIS.

The scene's motion is known. The error is the mean end-point error, px, over pixels that are visible in both frames. All
solvers get the same two frames in one process, and run on one thread, except our TV-L1, which runs on a device.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import cv2
import numpy as np

from pipeline.compute import device
from pipeline.frames import Frame
from pipeline.perception.flow import estimate
from pipeline.scenes import SceneFrame, scene

SIZES = ((352, 288), (1280, 720))
RUNS = 3
Solver = Callable[[Any, Any], Any]
"""Computes the flow between two gray images."""


def main() -> None:
    """Print one table per frame size."""
    cv2.setNumThreads(1)
    print(f"TV-L1 runs on: {device().name}")
    for size in SIZES:
        drawn = scene("harbour", size=size, frames=4)
        rows = list(measure(drawn.frame(1), drawn.image(2)))
        slowest = max(ms for _, ms, _ in rows)
        print(f"{f'{size[0]}x{size[1]}':>22} {'ms':>9} {'times faster':>13} {'error px':>9}")
        for name, ms, error in rows:
            print(f"{name:>22} {ms:9.1f} {slowest / ms:13.1f} {error:9.3f}")


def measure(first: SceneFrame, second: Frame) -> Iterator[tuple[str, float, float]]:
    """(solver, shortest time of `RUNS` runs in ms, mean end-point error in px) for each solver."""
    gray = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (first.image, second)]
    visible = ~first.occluded_next
    for name, solve in solvers().items():
        flow = solve(*gray)
        error = np.linalg.norm(flow - first.velocity_next, axis=-1)[visible].mean()
        yield name, min(_ms(solve, *gray) for _ in range(RUNS)), float(error)


def solvers() -> dict[str, Solver]:
    """Solvers by name."""
    theirs: Any = cv2.optflow.createOptFlow_DualTVL1()
    found: dict[str, Solver] = {"OpenCV DualTVL1": lambda a, b: theirs.calc(a, b, None)}
    for method in ("tvl1", "dis-medium", "dis-fast", "dis-ultrafast"):
        found[method] = partial(estimate, method=method)
    return found


def _ms(solve: Solver, first: Any, second: Any) -> float:
    begin = time.perf_counter()
    solve(first, second)
    return (time.perf_counter() - begin) * 1e3
