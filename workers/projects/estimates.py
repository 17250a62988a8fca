"""How long a job will take: from finished jobs of the same method on this farm, by frames and pixels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from pipeline.methods.layers import LAYERS
from workers.errors import NotFound
from workers.jobs.frame_window import window_info
from workers.model import Asset, Job, JobRequest

SAMPLES = 20
"""Finished jobs that are looked at, the newest first."""
ALIKE = 8.0
"""Jobs whose frames have this many times more or fewer pixels tell nothing."""


@dataclass(frozen=True)
class Estimate:
    """Wall time of a job once it has begun.

    Attributes:
        frames: that it paints; None: unknown.
        seconds: None: no finished job tells.
        samples: jobs that `seconds` is from.
    """

    frames: int | None
    seconds: float | None
    samples: int


def parts(request: JobRequest) -> list[JobRequest]:
    """The requests whose times add up to that of this one: its layers', if it has several."""
    if request.method != LAYERS:
        return [request]
    rows = request.params["layers"]
    return [JobRequest(row["method"], request.inputs, row["params"], frames=request.frames) for row in rows]


def summed(estimates: Sequence[Estimate]) -> Estimate:
    """The estimate of a job from those of its parts; unknown if one is."""
    seconds = [found.seconds for found in estimates if found.seconds is not None]
    known = len(seconds) == len(estimates)
    return Estimate(estimates[0].frames, sum(seconds) if known else None, min(found.samples for found in estimates))


def estimate(request: JobRequest, finished: Iterable[Job], find: Callable[[str], Asset]) -> Estimate:
    """The median time a frame and pixel of similar jobs, times the frames and pixels of this one.

    Args:
        finished: jobs of the same method that succeeded, the newest first.
        find: the asset of an id. Raises NotFound.
    """
    frames, pixels = _size(request, find)
    if frames is None or not pixels:
        return Estimate(frames, None, 0)
    rates = []
    for job in finished:
        count, own = _size(job.request, find)
        if count and own and 1 / ALIKE <= own / pixels <= ALIKE and job.started_at and job.finished_at:
            rates.append((job.finished_at - job.started_at) / (count * own))
    return Estimate(frames, round(median(rates) * frames * pixels, 1) if rates else None, len(rates))


def _size(request: JobRequest, find: Callable[[str], Asset]) -> tuple[int | None, int]:
    """Frames, and pixels of a frame, of a job's video."""
    try:
        info = window_info(find(request.inputs["video"]).info, request.frames)
    except (KeyError, NotFound):
        return None, 0
    return int(info.get("frames", 0)) or None, int(info.get("width", 0)) * int(info.get("height", 0))
