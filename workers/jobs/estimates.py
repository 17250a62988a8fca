"""Estimates of a job's cost from finished jobs of the same method on this farm, by frames and pixels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import log, sqrt

from pipeline.errors import BadParameter
from pipeline.formats import output_format
from pipeline.methods import method, parse_params
from pipeline.methods.base import PROCESS_BYTES, PlanContext
from pipeline.methods.layers import LAYERS
from workers.contract.record import Asset, Job
from workers.contract.request import JobRequest, Json
from workers.errors import NotFound
from workers.jobs.cost_fit import TaskAmount, fitted
from workers.jobs.frame_window import video_info, window_info
from workers.jobs.wall_time import OneByOne, processors_used

SAMPLES = 20
"""Maximum number of finished jobs that are considered, the newest first."""
NEAREST = 5
"""Maximum number of these jobs that are used: those with the most similar frame size and length."""
ALIKE_PIXELS, ALIKE_WORK = 8.0, 16.0
"""Jobs whose frames have more than this many times more or fewer pixels, or that have more than this many times more or
less work (frames times pixels), are not used: the time of a small job is mostly start-up."""
STARTED_S = 1.0
"""CPU seconds of a job that do not depend on its length, if no job was measured: plans, opening of files, the last
step."""
BYTES_PER_PIXEL_SAVED = 1.0
"""Bytes per pixel and frame of the states that tasks save for other tasks."""


@dataclass(frozen=True)
class Estimate:
    """Estimated cost of a job once it has begun.

    Attributes:
        frames: number of frames that it paints; None: unknown.
        seconds: wall time; None: unknown.
        samples: number of finished jobs, or of previews of the same film, on which the figures are based; 0: the
            method's own figures, measured on one core.
        cpu_s: CPU time of all tasks, seconds.
        memory_bytes: largest memory of a task's process.
        disk_bytes: largest size of its files while it runs.
    """

    frames: int | None
    seconds: float | None
    samples: int
    cpu_s: float | None = None
    memory_bytes: int | None = None
    disk_bytes: int | None = None


@dataclass(frozen=True)
class MeasuredJob:
    """Measured cost of a finished job. `cpu_s` and `peak_bytes` are 0 where they were not measured."""

    params: Json
    """Parameters as given in the request."""
    frames: int
    pixels: int
    """Pixels of a frame."""
    seconds: float
    cpu_s: float
    peak_bytes: int


@dataclass(frozen=True)
class MeasuredPreview(MeasuredJob):
    """Cost of the tasks of a whole film at the size of a preview, from those that have run, one after another."""

    one_by_one: OneByOne


def estimate(
    request: JobRequest, info: Json | None, history: Callable[[str], Sequence[MeasuredJob]],
    previewed: Callable[[JobRequest], Sequence[MeasuredPreview]] = lambda request: (), slots: int = 1,
) -> Estimate:  # fmt: skip
    """The estimate of a job; of several layers, the sum of those of its layers. Arguments: see `estimate_from`.

    Args:
        history: returns measured jobs of a method.
        previewed: returns costs of previews of the film of a request, by its method.
    """
    return _summed([estimate_from(one, info, history(one.method), previewed(one), slots) for one in _parts(request)])


def _parts(request: JobRequest) -> list[JobRequest]:
    """The requests whose times add up to the time of this one: one for each layer, if it has several."""
    if request.method != LAYERS:
        return [request]
    return [replace(request, method=row["method"], params=row["params"]) for row in request.params["layers"]]


def _summed(estimates: Sequence[Estimate]) -> Estimate:
    """The estimate of a job from the estimates of its parts; unknown if one of them is unknown."""
    first = estimates[0]
    return Estimate(
        first.frames, _total([e.seconds for e in estimates]), min(e.samples for e in estimates),
        _total([e.cpu_s for e in estimates]),
        max((e.memory_bytes for e in estimates if e.memory_bytes is not None), default=None),
        max((e.disk_bytes for e in estimates if e.disk_bytes is not None), default=None),
    )  # fmt: skip


def _total(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) if len(known) == len(values) else None


def estimate_from(
    request: JobRequest, info: Json | None, history: Sequence[MeasuredJob],
    previewed: Sequence[MeasuredPreview] = (), slots: int = 1,
) -> Estimate:  # fmt: skip
    """Times from a preview of the film with the same parameters, else by the model of `cost_fit`, fitted to the most
    similar jobs.

    Jobs with the same parameters are preferred, then those of similar length and frame size. Without any, the figures
    are the method's own (`Method.cpu_s_per_megapixel`, `Method.resources`).

    Args:
        info: facts of the job's video; None: unknown.
        history: measured jobs of the same method, the newest first.
        previewed: costs of the same film at the size of a preview, with any parameters.
        slots: number of tasks of one processor that run at once.
    """
    if info is None:
        return Estimate(None, None, 0)
    info = window_info(info, request.frames, request.source)
    frames, pixels = _size(info)
    if frames is None or not pixels:
        return Estimate(frames, None, 0)
    work = frames * pixels
    disk = round(
        work
        * (
            2 * output_format(request.output.format).profile(request.output.profile).bytes_per_pixel
            + BYTES_PER_PIXEL_SAVED
        )
    )
    nearest = _nearest(request, frames, pixels, history)
    memory = max((each.peak_bytes for each in nearest), default=0) or _declared_memory(request, info)
    if (shown := _shown(request, previewed)) is not None:
        seconds, cpu_s = _of_preview(shown, request, info, slots)
        return Estimate(frames, round(seconds, 1), 1, round(cpu_s, 2), memory, disk)
    if not nearest:
        cpu_s = round(STARTED_S + method(request.method).cpu_s_per_megapixel * work / 1e6, 2)
        return Estimate(frames, cpu_s, 0, cpu_s, memory, disk)
    asked = TaskAmount(frames, pixels)
    growth = method(request.method).cpu_growth
    seconds = fitted([(TaskAmount(each.frames, each.pixels), each.seconds) for each in nearest], growth).of(asked)
    cpu = [(TaskAmount(each.frames, each.pixels), each.cpu_s) for each in nearest if each.cpu_s]
    known_cpu_s = round(fitted(cpu, growth).of(asked), 2) if cpu else None
    return Estimate(frames, round(seconds, 1), len(nearest), known_cpu_s, memory, disk)


def _shown(request: JobRequest, previewed: Sequence[MeasuredPreview]) -> MeasuredPreview | None:
    """The preview with the parameters of the request."""
    chosen = method(request.method)
    wanted = parse_params(chosen, request.params)
    return next((one for one in previewed if parse_params(chosen, one.params) == wanted), None)


def _of_preview(shown: MeasuredPreview, request: JobRequest, info: Json, slots: int) -> tuple[float, float]:
    """(wall, CPU) seconds of a job from its preview."""
    chosen, size = method(request.method), (int(info["width"]), int(info["height"]))
    params, scale = parse_params(chosen, request.params), sqrt(shown.pixels / (size[0] * size[1]))
    small = round(size[0] * scale), round(size[1] * scale)
    factor = int(info["frames"]) / shown.frames
    factor *= chosen.relative_cost(params, size) / chosen.relative_cost(params, small)
    used = processors_used(shown.cpu_s / shown.seconds, shown.one_by_one, slots, chosen.task_cpus)
    return STARTED_S + shown.cpu_s * factor / used, shown.cpu_s * factor


def _nearest(request: JobRequest, frames: int, pixels: int, history: Sequence[MeasuredJob]) -> list[MeasuredJob]:
    """The most similar jobs: with the same parameters if there is one, then by frames and pixels."""

    def distance(job: MeasuredJob) -> float:
        return abs(log(job.frames / frames)) + abs(log(job.pixels / pixels))

    def is_alike(job: MeasuredJob) -> bool:
        sizes = (job.pixels / pixels, ALIKE_PIXELS), (job.frames * job.pixels / (frames * pixels), ALIKE_WORK)
        return all(1 / most <= ratio <= most for ratio, most in sizes)

    alike = [job for job in history if is_alike(job)]
    same = [job for job in alike if job.params == request.params]
    return sorted(same or alike, key=distance)[:NEAREST]


def measured(job: Job, find: Callable[[str, str], Asset]) -> MeasuredJob | None:
    """The cost of a job that succeeded; None if its size is unknown, or if it reused results.

    Args:
        find: returns the asset of an id and an owner. Raises NotFound.
    """
    try:
        info = find(job.request.inputs["video"], job.owner).info
        frames, pixels = _size(window_info(info, job.request.frames, job.request.source))
    except (KeyError, NotFound, BadParameter):
        return None
    if not frames or not pixels or not job.started_at or not job.finished_at:
        return None
    if any(step.reused for step in job.steps):
        return None  # it computed only the tasks whose inputs had changed
    return MeasuredJob(
        job.request.params, frames, pixels, job.finished_at - job.started_at, sum(step.cpu_s for step in job.steps),
        max((step.peak_bytes for step in job.steps), default=0),
    )  # fmt: skip


def _declared_memory(request: JobRequest, info: Json) -> int:
    """Largest memory that the method declares for a task of the job."""
    chosen = method(request.method)
    params = parse_params(chosen, request.params)
    context = PlanContext(
        params, request.seed, video_info(info), frozenset(request.inputs), deep=request.output.encoding.is_deep
    )
    declared = [chosen.resources(step.name, context) for step in chosen.steps_of(params)]
    return max((found.memory_bytes for found in declared if found is not None), default=0) or PROCESS_BYTES


def _size(info: Json) -> tuple[int | None, int]:
    """Frames, and pixels of a frame, of a video."""
    return int(info.get("frames", 0)) or None, int(info.get("width", 0)) * int(info.get("height", 0))
