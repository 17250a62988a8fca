"""Cost of a painted frame by stage, with one worker and two, and the cost of OpenCV's painting filters.

The tasks of the plan run one after the other in one process on decoded frames. The benchmark records CPU seconds, so
that other work on the machine does not count. It then simulates two workers as in `benchmarks.patches`. Decoding (once
to scan, once to analyse) and encoding are timed separately and divided evenly.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.clips import clip, fit
from benchmarks.timed_plan import TimedContext, makespan, run_timed
from pipeline.frames import Frame
from pipeline.methods.multistyle import Multistyle, MultistyleParams, MultistyleSession
from pipeline.methods.multistyle.params import STYLE_NAMES
from pipeline.video.reader import VideoReader
from pipeline.video.writer import SegmentSpec, segment_writer
from workers.execution.renderer import prepare_process

SIZES = ((320, 240), (640, 480), (1280, 960))
SOURCE = (640, 480)
FRAMES = 96
FEW = 8


def measure(size: tuple[int, int], frames: int = FRAMES, **values: Any) -> dict[str, Any]:
    """Per frame: CPU seconds with one worker, simulated seconds with two, and CPU seconds by stage."""
    prepare_process()
    source = [fit(frame, size) for frame in clip(SOURCE, frames)]
    run_timed(Multistyle(), TimedContext(MultistyleParams(**values), source[:3]))  # compile and load
    context = TimedContext(MultistyleParams(**values), source)
    steps = run_timed(Multistyle(), context)
    coding = _coding([context.emitted[index] for index in sorted(context.emitted)])
    outside = sum(coding.values())
    one, two = (sum(makespan(tasks, workers) for tasks in steps.values()) / frames for workers in (1, 2))
    one, two = one + outside, two + outside / 2
    stages = {name: cost / frames for name, cost in context.stages.items()} | coding
    return {"size": size, "one_s": one, "two_s": two, "ratio": one / two, "stages": stages}


def _coding(painted: list[Frame]) -> dict[str, float]:
    """CPU seconds per frame of encoding, and of decoding twice."""
    count, size = len(painted), (painted[0].shape[1], painted[0].shape[0])
    with tempfile.TemporaryDirectory(prefix="impasto-multistyle-") as folder:
        path = Path(folder) / "clip.mp4"
        start = time.process_time()
        with segment_writer(path, SegmentSpec("mp4", size, Fraction(1, 25), 25)) as writer:
            for index, frame in enumerate(painted):
                writer.write(index, frame, index, index + 1)
        written = time.process_time()
        with VideoReader(path) as reader:
            for _ in reader.read():
                pass
        read = time.process_time()
    return {"encode": (written - start) / count, "decode": 2 * (read - written) / count}


def beside(size: tuple[int, int]) -> dict[str, float]:
    """CPU seconds per frame of the alternatives: painting each frame independently, and OpenCV's filters."""
    frames = [fit(frame, size) for frame in clip(SOURCE, FEW)]
    alone = MultistyleSession(MultistyleParams(temporal="off"), size)
    painters: dict[str, Callable[[Frame], Any]] = {
        "each frame on its own": alone.step, "cv2.stylization": cv2.stylization,
        "cv2.xphoto.oilPainting": lambda frame: cv2.xphoto.oilPainting(frame, 7, 1),
    }  # fmt: skip
    return {name: _cpu(paint, frames) for name, paint in painters.items()}


def _cpu(paint: Callable[[Frame], Any], frames: list[Frame]) -> float:
    paint(frames[0])
    start = time.process_time()
    for frame in frames:
        paint(frame)
    return (time.process_time() - start) / len(frames)


def main() -> None:
    """Print the tables."""
    print(f"{'size':>10} {'CPU s':>7} {'2 workers s':>12} {'ratio':>6} {'us/px':>6}   CPU ms a frame by stage")
    for size in SIZES:
        row = measure(size, FRAMES if size[0] <= 640 else FRAMES // 2)
        per_px = row["one_s"] / np.prod(size) * 1e6
        stages = "  ".join(f"{name} {cost * 1e3:.1f}" for name, cost in row["stages"].items())
        shape = f"{size[0]}x{size[1]}"
        print(f"{shape:>10} {row['one_s']:7.3f} {row['two_s']:12.3f} {row['ratio']:6.2f} {per_px:6.3f}   {stages}")
    print("640x480 by style, CPU s a frame, two workers s: ", end="")
    rows = ((name, measure(SOURCE, FRAMES // 2, style=name)) for name in STYLE_NAMES)
    print(", ".join(f"{name} {row['one_s']:.3f} {row['two_s']:.3f}" for name, row in rows))
    print("640x480 otherwise, CPU s a frame: ", end="")
    print(", ".join(f"{name} {cost:.3f}" for name, cost in beside(SOURCE).items()))


if __name__ == "__main__":
    main()
