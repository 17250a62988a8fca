"""Frame time of the whole abstraction pipeline relative to `cv2.stylization`.

Both run in one process on the same decoded frames and take turns, so that a noisy machine slows both: a block of our
frames, then a few frames of OpenCV's filter. Decoding and encoding are not measured. Our pipeline runs as in a task,
with the analysis in a separate thread; OpenCV's filter uses OpenCV's own threads.
"""

from __future__ import annotations

import statistics
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import cv2

from benchmarks.clips import clip
from pipeline.frames import Frame
from pipeline.methods.abstraction import AbstractionParams, AbstractionSession
from pipeline.methods.abstraction.session import PipelinedRunner
from workers.execution.renderer import prepare_process

BLOCK = 120
"""Frames per block. The first and last frames of a block overlap no others, which distorts only short blocks."""
THEIRS = 3
SIZES = ((352, 288), (640, 480), (1280, 720))


@dataclass
class Stopwatch:
    """CPU seconds of each stage, over threads."""

    stages: dict[str, float] = field(default_factory=lambda: defaultdict(float))

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        start = time.thread_time()
        yield
        self.stages[stage] += time.thread_time() - start


@dataclass(frozen=True)
class Row:
    """Medians for one frame size: ms per frame of both programs, their ratio, and CPU ms per frame by stage."""

    size: str
    ours_ms: float
    stylization_ms: float
    ratio: float
    cpu_ms: dict[str, float]


def ours(session: AbstractionSession, frames: list[Frame]) -> float:
    """Wall time of our pipeline, seconds per frame."""
    with PipelinedRunner(session) as runner:
        start = time.perf_counter()
        for _ in runner.run(frames):
            pass
        return (time.perf_counter() - start) / len(frames)


def theirs(frames: list[Frame], threads: int) -> float:
    """Wall time of `cv2.stylization` with OpenCV's own threads, seconds per frame."""
    cv2.setNumThreads(threads)
    start = time.perf_counter()
    for frame in frames:
        cv2.stylization(frame)
    elapsed = time.perf_counter() - start
    cv2.setNumThreads(1)
    return elapsed / len(frames)


def measure(size: tuple[int, int], blocks: int = 3) -> Row:
    """Measure one frame size: medians over `blocks` turns, after a first turn that warms up both programs."""
    threads = cv2.getNumberOfCPUs()
    prepare_process()
    frames = clip(size, BLOCK * (blocks + 1))
    session = AbstractionSession(AbstractionParams(), size)
    pairs = []
    for start in range(0, len(frames), BLOCK):
        block = frames[start : start + BLOCK]
        pairs.append((ours(session, block), theirs(block[:THEIRS], threads)))
    pairs = pairs[1:]
    return Row(
        size=f"{size[0]}x{size[1]}",
        ours_ms=statistics.median(a for a, _ in pairs) * 1e3,
        stylization_ms=statistics.median(b for _, b in pairs) * 1e3,
        ratio=statistics.median(b / a for a, b in pairs),
        cpu_ms=cpu_ms(frames[:BLOCK], size),
    )


def cpu_ms(frames: list[Frame], size: tuple[int, int]) -> dict[str, float]:
    """CPU milliseconds per frame of each stage, measured in a separate run, because reading the clocks takes time."""
    stopwatch = Stopwatch()
    session = AbstractionSession(AbstractionParams(), size, clock=stopwatch)
    ours(session, frames[: BLOCK // 4])
    stopwatch.stages.clear()
    timed = frames[BLOCK // 4 :]
    ours(session, timed)
    return {stage: seconds / len(timed) * 1e3 for stage, seconds in stopwatch.stages.items()}


def main() -> None:
    """Print the table."""
    print(f"{'size':>10} {'ours ms':>9} {'stylization ms':>15} {'ratio':>7}   CPU ms a frame by stage")
    for size in SIZES:
        row = measure(size)
        stages = "  ".join(f"{name} {ms:.2f}" for name, ms in row.cpu_ms.items())
        print(f"{row.size:>10} {row.ours_ms:9.2f} {row.stylization_ms:15.1f} {row.ratio:7.1f}   {stages}")
