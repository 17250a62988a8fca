"""Cost of the method patches by stage, and the simulated speedup of two workers over one.

The tasks run one after the other in one process on the same decoded frames. The benchmark records CPU seconds, so that
other work on the machine does not count. Two workers are then simulated with the dispatcher's policy: tasks start in
plan order on the first idle worker, and a step starts when the previous step is done. Decoding and encoding are not
measured.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.clips import clip, fit
from benchmarks.timed_plan import TimedContext, makespan, run_timed
from pipeline.methods.base import TaskResult
from pipeline.methods.patches import Patches, PatchesParams
from workers.execution.renderer import prepare_process

SIZES = ((320, 172), (640, 344), (1280, 688))
FRAMES = 48
SOURCE = (1280, 720)


def measure(size: tuple[int, int], frames: int = FRAMES) -> dict[str, Any]:
    """Run the plan; the CPU seconds per frame, the simulated speedup, and the cost of each step and stage."""
    prepare_process()
    source = [fit(frame, size) for frame in clip(SOURCE, frames)]
    run_timed(Patches(), TimedContext(PatchesParams(), source[:6]))  # compile and load
    context = TimedContext(PatchesParams(), source)
    spent = run_timed(Patches(), context)
    one, two = (sum(makespan(tasks, workers) for tasks in spent.values()) for workers in (1, 2))
    kept_bytes = sum(array.nbytes for arrays in context.kept.values() for array in arrays.values())
    return {
        "size": f"{size[0]}x{size[1]}", "one_s": one / frames, "two_s": two / frames, "ratio": one / two,
        "steps": {name: sum(cost for _, cost in tasks) / frames for name, tasks in spent.items()},
        "stages": {name: cost / frames for name, cost in context.stages.items()},
        "artefact_mb": kept_bytes / 1e6 / frames,
        **relaxation(context.results),
    }  # fmt: skip


def relaxation(results: Mapping[str, Mapping[str, TaskResult]]) -> dict[str, Any]:
    """Energy after relaxation relative to before, and iterations, over all patches: pairs of frames, and all frames."""
    pairs, every = defaultdict[str, list[float]](lambda: [0.0, 0.0, 0, 0]), list[TaskResult]()
    for result in results.get("register", {}).values():
        for key, row in result["energies"].items():
            pairs[key] = [a + b for a, b in zip(pairs[key], row, strict=True)]
    every = [result for result in results.get("patch", {}).values() if "iterations" in result]
    lower = [row[1] < row[0] for row in pairs.values()] + [result["after"] < result["before"] for result in every]
    sums = np.array([*pairs.values()]).sum(axis=0) if pairs else np.ones(4)
    return {
        "patches": len(every), "lowered": f"{sum(lower)} of {len(lower)}", "pairs": sums[1] / sums[0],
        "pair_iterations": sums[2] / sums[3], "iterations": float(np.mean([result["iterations"] for result in every])),
        "all": sum(result["after"] for result in every) / max(sum(result["before"] for result in every), 1e-9),
    }  # fmt: skip


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
