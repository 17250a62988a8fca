"""Time per frame of each method of the registry, at its default parameters.

The table has one row for each method, including methods of other packages. All render the same frames in memory and
take turns, so that a busy machine slows all of them. Decoding and encoding are not measured. The first turn compiles
kernels and is not counted.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from benchmarks.clips import clip
from pipeline.frames import Frame
from pipeline.methods import methods
from pipeline.methods.base import Method
from pipeline.methods.local import LocalContext, required_inputs, run_plan
from workers.execution.renderer import prepare_process

TURNS = 3


@dataclass(frozen=True)
class Row:
    """Medians over the turns, ms per frame: wall time, and CPU time of all threads."""

    method: str
    wall_ms: float
    cpu_ms: float


def measure(frames: Sequence[Frame], turns: int = TURNS) -> Iterator[Row]:
    """A row for each method.

    Args:
        turns: counted turns, after one that is not counted.
    """
    prepare_process()
    taken = [{name: _turn(method, frames) for name, method in methods().items()} for _ in range(turns + 1)][1:]
    for name in methods():
        wall, cpu = (statistics.median(turn[name][column] for turn in taken) for column in range(2))
        yield Row(name, wall, cpu)


def _turn(method: Method, frames: Sequence[Frame]) -> tuple[float, float]:
    """(wall ms, CPU ms) per frame."""
    context = LocalContext(method.Params(), frames, required_inputs(method, frames))
    wall, cpu = time.perf_counter(), time.process_time()
    run_plan(method, context)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return 1e3 * wall / len(frames), 1e3 * cpu / len(frames)


def table(rows: Sequence[Row]) -> str:
    """The rows as a Markdown table; the last column is relative to the fastest method."""
    fastest = min(row.cpu_ms for row in rows)
    text = ["| method | wall, ms a frame | CPU, ms a frame | CPU, ratio |", "|---|---|---|---|"]
    text += [f"| {row.method} | {row.wall_ms:.1f} | {row.cpu_ms:.1f} | {row.cpu_ms / fastest:.1f} |" for row in rows]
    return "\n".join(text)


def main(arguments: Sequence[str] = ()) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.methods", description=__doc__)
    parser.add_argument("--size", default="352x288", help="WIDTHxHEIGHT, px")
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--turns", type=int, default=TURNS)
    given = parser.parse_args(arguments)
    width, height = map(int, given.size.split("x"))
    print(table(list(measure(clip((width, height), given.frames), given.turns))))


if __name__ == "__main__":
    main(sys.argv[1:])
