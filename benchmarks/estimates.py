"""How well does a job's CPU time follow from that of other jobs of its method?

For each method of the registry: jobs of three lengths and sizes are rendered in memory. The CPU time of each is then
estimated from the two others, and without any (the method's own figure). Decoding and encoding are not measured.
CPU time hardly depends on what else runs on the machine.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from benchmarks.clips import clip
from pipeline.methods import methods
from pipeline.methods.base import Method
from pipeline.methods.local import LocalContext, required_inputs, run_plan
from workers.execution.renderer import prepare_process
from workers.model import JobRequest, Json
from workers.projects.estimates import Estimate, MeasuredJob, estimate_from

JOBS: tuple[tuple[tuple[int, int], int], ...] = (((320, 240), 12), ((480, 360), 10), ((640, 480), 8))
"""(width, height) px, and frames."""


@dataclass(frozen=True)
class Row:
    """CPU seconds of one job: measured, estimated from the method's other jobs, and from the method's own figure."""

    method: str
    size: tuple[int, int]
    frames: int
    measured_s: float
    estimated_s: float
    prior_s: float

    @property
    def error(self) -> float:
        """Error of the estimated time, as a share of the measured time."""
        return self.estimated_s / self.measured_s - 1


def measure(names: Sequence[str], times: int = 1) -> Iterator[Row]:
    """Rows of each method of those names, or of all. `times`: multiplies the numbers of frames."""
    jobs = [(size, times * frames) for size, frames in JOBS]
    for name, chosen in methods().items():
        if not names or name in names:
            _cpu_s(chosen, *JOBS[0])  # compiles kernels
            yield from _rows(chosen, jobs)


def _rows(chosen: Method, jobs: Sequence[tuple[tuple[int, int], int]]) -> Iterator[Row]:
    took = [_cpu_s(chosen, size, frames) for size, frames in jobs]
    for index, (size, frames) in enumerate(jobs):
        others = [
            MeasuredJob({}, count, width * height, seconds, seconds, 0)
            for at, (((width, height), count), seconds) in enumerate(zip(jobs, took, strict=True))
            if at != index
        ]
        info: Json = {"frames": frames, "width": size[0], "height": size[1]}
        request = JobRequest(chosen.name, {})
        known, unknown = estimate_from(request, info, others), estimate_from(request, info, [])
        yield Row(chosen.name, size, frames, took[index], _cpu(known), _cpu(unknown))


def _cpu(found: Estimate) -> float:
    assert found.cpu_s is not None
    return found.cpu_s


def _cpu_s(chosen: Method, size: tuple[int, int], frames: int) -> float:
    video = clip(size, frames)
    context = LocalContext(chosen.Params(), video, required_inputs(chosen, video))
    began = time.process_time()
    run_plan(chosen, context)
    return time.process_time() - began


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("methods", nargs="*", help="names of methods; none: all")
    parser.add_argument("--times", type=int, default=1, help="multiplies the numbers of frames: for fast methods")
    options = parser.parse_args(arguments)
    prepare_process()
    print("| method | job | CPU s | estimated | error | without jobs | CPU s a megapixel and frame |")
    print("|---|---|---|---|---|---|---|")
    for row in measure(options.methods, options.times):
        (width, height), work = row.size, row.frames * row.size[0] * row.size[1] / 1e6
        print(
            f"| {row.method} | {width}x{height}, {row.frames} frames | {row.measured_s:.2f} | {row.estimated_s:.1f} "
            f"| {row.error:+.0%} | {row.prior_s:.1f} | {row.measured_s / work:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
