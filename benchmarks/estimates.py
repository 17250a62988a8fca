"""Accuracy of CPU time estimates that are made from other jobs of the same method.

For each method of the registry, jobs of three lengths and frame sizes are rendered in memory. The CPU time of each job
is then estimated from the two others, and from the method's own figure alone. Decoding and encoding are not measured.
CPU time hardly depends on the load of the machine.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from benchmarks.clips import MEDIA, clip, fit
from pipeline.frames import Frame
from pipeline.methods import methods
from pipeline.methods.base import Method
from pipeline.methods.local import LocalContext, required_inputs, run_plan
from pipeline.video.reader import VideoReader
from workers.contract.request import JobRequest, Json
from workers.execution.renderer import prepare_process
from workers.jobs.estimates import Estimate, MeasuredJob, estimate_from

Job = tuple[tuple[int, int], int]
"""(width, height) px, and frames."""
JOBS: tuple[Job, ...] = (((320, 240), 12), ((480, 360), 10), ((640, 480), 8))


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


def measure(names: Sequence[str], jobs: Sequence[Job] = JOBS, media: str = "") -> Iterator[Row]:
    """Rows of the named methods, or of all. `media`: a file of the media folder; by default, a clip for each size."""
    for name, chosen in methods().items():
        if not names or name in names:
            _cpu_s(chosen, frames_of(media, *jobs[0]))  # compiles kernels
            yield from _rows(chosen, jobs, media)


def frames_of(media: str, size: tuple[int, int], count: int) -> list[Frame]:
    """The first frames of a file of the media folder; if `media` is empty, of the clip for this size."""
    if not media:
        return clip(size, count)
    with VideoReader(MEDIA / media) as reader:
        return [fit(frame, size) for frame in reader.read(0, count)]


def _rows(chosen: Method, jobs: Sequence[Job], media: str) -> Iterator[Row]:
    took = [_cpu_s(chosen, frames_of(media, size, frames)) for size, frames in jobs]
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


def _cpu_s(chosen: Method, video: list[Frame]) -> float:
    context = LocalContext(chosen.Params(), video, required_inputs(chosen, video))
    began = time.process_time()
    run_plan(chosen, context)
    return time.process_time() - began


def _job(text: str) -> Job:
    width, height, frames = (int(part) for part in text.split("x"))
    return (width, height), frames


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("methods", nargs="*", help="names of methods; all methods if omitted")
    parser.add_argument("--times", type=int, default=1, help="factor on the numbers of frames, for fast methods")
    parser.add_argument(
        "--media", default="", metavar="FILE", help="a file of the media folder, instead of the usual clips"
    )
    parser.add_argument("--jobs", nargs="+", type=_job, default=list(JOBS), metavar="WIDTHxHEIGHTxFRAMES")
    options = parser.parse_args(arguments)
    jobs = [(size, options.times * frames) for size, frames in options.jobs]
    prepare_process()
    print("| method | job | CPU s | estimated | error | without jobs | CPU s a megapixel and frame |")
    print("|---|---|---|---|---|---|---|")
    for row in measure(options.methods, jobs, options.media):
        (width, height), work = row.size, row.frames * row.size[0] * row.size[1] / 1e6
        print(
            f"| {row.method} | {width}x{height}, {row.frames} frames | {row.measured_s:.2f} | {row.estimated_s:.1f} "
            f"| {row.error:+.0%} | {row.prior_s:.1f} | {row.measured_s / work:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
