"""Cost of painting patches by stage, and the speedup of two workers over one.

Every task runs alone, in one process, on the same decoded frames; its CPU seconds are taken, so that other work on the
machine does not count. Two workers are then simulated: tasks in plan order, each to the worker that is free first, the
next step when the one before is done, as the dispatcher does. Decoding and encoding are outside.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.clips import clip, fit
from pipeline.frames import Frame
from pipeline.methods.base import Arrays, PlanContext, Task, TaskResult, VideoInfo
from pipeline.methods.patches import Patches, PatchesParams
from workers.execution.renderer import prepare_process

SIZES = ((320, 172), (640, 344), (1280, 688))
FRAMES = 48
SOURCE = (1280, 720)


@dataclass
class Table:
    """A context in memory that counts CPU seconds by stage."""

    params: PatchesParams
    clip: list[Frame]
    seed: int = 0
    stages: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    kept: dict[tuple[str, str], Arrays] = field(default_factory=dict)
    results: dict[str, dict[str, TaskResult]] = field(default_factory=dict)
    spent: dict[str, list[tuple[Task, float]]] = field(default_factory=dict)
    emitted: dict[int, Frame] = field(default_factory=dict)
    step: str = ""
    artefact_mb: float = 0.0

    @property
    def size(self) -> tuple[int, int]:
        return self.clip[0].shape[1], self.clip[0].shape[0]

    @property
    def video(self) -> VideoInfo:
        return VideoInfo(*self.size, len(self.clip), 25.0, len(self.clip) / 25)

    def frames(self, name: str = "video", start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        return iter(self.clip[start:stop])

    def has(self, name: str) -> bool:
        return False

    def wants(self, artefact: str) -> bool:
        return False

    def save(self, name: str, arrays: Arrays) -> None:
        self.kept[self.step, name] = dict(arrays)
        self.artefact_mb += sum(np.asarray(array).nbytes for array in arrays.values()) / 1e6

    def load(self, step: str, name: str) -> dict[str, Any]:
        return dict(self.kept[step, name])

    def emit(self, index: int, frame: Frame) -> None:
        self.emitted[index] = frame

    def progress(self, done: float) -> None:
        pass

    @contextmanager
    def clock(self, stage: str) -> Iterator[None]:
        start = time.thread_time()
        yield
        self.stages[stage] += time.thread_time() - start


def measure(size: tuple[int, int], frames: int = FRAMES) -> dict[str, Any]:
    """CPU seconds of every task, and what follows from them."""
    prepare_process()
    source = [fit(frame, size) for frame in clip(SOURCE, frames)]
    run(Table(PatchesParams(), source[:6]))  # compile and load
    table = Table(PatchesParams(), source)
    run(table)
    one, two = (sum(makespan(tasks, workers) for tasks in table.spent.values()) for workers in (1, 2))
    return {
        "size": f"{size[0]}x{size[1]}", "one_s": one / frames, "two_s": two / frames, "ratio": one / two,
        "steps": {name: sum(cost for _, cost in tasks) / frames for name, tasks in table.spent.items()},
        "stages": {name: cost / frames for name, cost in table.stages.items()},
        "artefact_mb": table.artefact_mb / frames,
        **relaxation(table),
    }  # fmt: skip


def run(table: Table) -> None:
    """The method's whole plan; the table keeps what it finds, paints and costs."""
    for step in Patches.steps:
        tasks = step.plan(PlanContext(table.params, table.seed, table.video, frozenset(), table.results))
        table.step, table.spent[step.name] = step.name, []
        for task in tasks:
            start = time.thread_time()
            result = step.run(task, table)  # type: ignore[arg-type]
            table.spent[step.name].append((task, time.thread_time() - start))
            table.results.setdefault(step.name, {})[task.key] = result


def relaxation(table: Table) -> dict[str, Any]:
    """Of all patches: by how much energy falls from frame to frame and over all frames, and in how many iterations."""
    pairs, every = defaultdict[str, list[float]](lambda: [0.0, 0.0, 0, 0]), list[TaskResult]()
    for result in table.results.get("register", {}).values():
        for key, row in result["energies"].items():
            pairs[key] = [a + b for a, b in zip(pairs[key], row, strict=True)]
    every = [result for result in table.results.get("patch", {}).values() if "iterations" in result]
    lower = [row[1] < row[0] for row in pairs.values()] + [result["after"] < result["before"] for result in every]
    sums = np.array([*pairs.values()]).sum(axis=0) if pairs else np.ones(4)
    return {
        "patches": len(every), "lowered": f"{sum(lower)} of {len(lower)}", "pairs": sums[1] / sums[0],
        "pair_iterations": sums[2] / sums[3], "iterations": float(np.mean([result["iterations"] for result in every])),
        "all": sum(result["after"] for result in every) / max(sum(result["before"] for result in every), 1e-9),
    }  # fmt: skip


def makespan(tasks: list[tuple[Task, float]], workers: int) -> float:
    """How long a step takes: each task, in plan order, begins when a worker is free and what it follows is done."""
    free, done = [0.0] * workers, dict[str, float]()
    waiting = list(tasks)
    while waiting:
        ready = [max([0.0, *(done[key] for key in task.after)]) if set(task.after) <= set(done) else np.inf
                 for task, _ in waiting]  # fmt: skip
        place = min(range(len(waiting)), key=lambda k: (max(ready[k], min(free)), k))
        task, cost = waiting.pop(place)
        worker = free.index(min(free))
        free[worker] = done[task.key] = max(free[worker], ready[place]) + cost
    return max([0.0, *done.values()])


def main() -> None:
    """Print the table."""
    print(f"{'size':>10} {'CPU s a frame':>14} {'2 workers':>10} {'ratio':>6} {'kept MB':>8}   CPU ms a frame by step")
    for size in SIZES:
        row = measure(size, FRAMES if size[0] <= 640 else FRAMES // 2)
        steps = "  ".join(f"{name} {cost * 1e3:.0f}" for name, cost in row["steps"].items() if cost)
        figures = f"{row['one_s']:14.3f} {row['two_s']:10.3f} {row['ratio']:6.2f} {row['artefact_mb']:8.2f}"
        print(f"{row['size']:>10} {figures}   {steps}")
        print(f"{'':>10} " + "  ".join(f"{name} {cost * 1e3:.1f}" for name, cost in row["stages"].items()))
        print(
            f"{'':>10} {row['patches']} patches; energy lowered in {row['lowered']} relaxations; between frames to "
            f"{row['pairs']:.2f} in {row['pair_iterations']:.1f} iterations, over all to {row['all']:.2f} in "
            f"{row['iterations']:.1f}"
        )
