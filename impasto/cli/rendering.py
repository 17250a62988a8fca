"""The work of `impasto render`: check the order, run one job in a private farm, deliver its files, sum up times."""

from __future__ import annotations

import dataclasses
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from impasto.cli import private_farm
from impasto.cli.console import Show
from impasto.cli.estimating import remember
from impasto.cli.input_files import InputFile, gather
from impasto.cli.private_farm import Workspace, forget, key_of, sweep, workspace
from impasto.delivery import (
    OutputTarget,
    beside,
    check_new,
    check_space,
    check_still,
    deliver,
    output_faults,
    same_file,
)
from pipeline.errors import BadInput, together
from pipeline.formats import IN_FILM, OUTPUTS
from pipeline.methods import method, parse_params
from pipeline.methods.base import Method, Params, missing_inputs
from pipeline.passes.made import PASSES
from pipeline.video.media import MediaInfo
from pipeline.video.probe import probe, probe_guarded
from pipeline.video.sequence_options import USUAL, SequenceOptions
from workers.contract.record import Job, TaskView
from workers.contract.request import JobRequest, Json
from workers.execution.renderer import prepare_process
from workers.execution.warm_up import begin_warm_up
from workers.farm import Farm
from workers.jobs.frame_window import stream_info
from workers.jobs.job_warnings import note_warning
from workers.scheduling.outputs import pass_faults
from workers.version import version


@dataclass(frozen=True)
class RenderOrder:
    """A render as the command line gives it: the request without asset ids, input paths, and output paths."""

    request: JobRequest
    paths: Mapping[str, Path]
    where: OutputTarget
    artefacts: Mapping[str, Path | None]
    """Artefact -> its output path; None: beside the result."""
    overwrite: bool = False
    """Whether existing outputs may be replaced."""
    sequence: SequenceOptions = USUAL
    """Options for reading IN, if it is a sequence of images."""
    passes_to: OutputTarget | None = None
    """Path of the passes, if the request has any; None: beside the result."""

    def check(self) -> None:
        """Refuse an invalid order, before any file is read. Raises: BadParameter, BadInput."""
        chosen = method(self.request.method)
        params = parse_params(chosen, self.request.params)
        _check_inputs(chosen, params, self.paths)
        if faults := pass_faults(chosen, params, self.request.output):
            raise together(faults)
        for name in self.artefacts:
            if name not in chosen.artefacts:
                raise BadInput(
                    f"The method {chosen.name!r} makes no artefact {name!r}.",
                    field="--artefact",
                    value=name,
                    remedy=f"It can make: {', '.join(chosen.artefacts) or 'none'}.",
                )
        self._check_outputs_differ()

    def _check_outputs_differ(self) -> None:
        """Check that no output is an input or another output, also through links."""
        taken = {"the output": self.where.path} | {f"the input {name!r}": path for name, path in self.paths.items()}
        _refuse_equal("--output", self.where.path, {k: v for k, v in taken.items() if k != "the output"})
        for name, path in self.artefacts.items():
            if path is not None:
                _refuse_equal(f"--artefact {name}", path.absolute(), taken)
                taken[f"the artefact {name!r}"] = path.absolute()
        if self.passes_to is not None:
            _refuse_equal("--passes-to", self.passes_to.path, taken)

    def existing(self) -> list[Path]:
        """Output files that exist. Artefacts without a path count by their stem: their extension is known later."""
        found = [self.where.path, *(path.absolute() for path in self.artefacts.values() if path)]
        found += [] if self.passes_to is None else [self.passes_to.path]
        stem = self.where.path.stem
        unnamed = [name for name, path in self.artefacts.items() if path is None]
        wanted = self.request.output
        if wanted.passes and wanted.passes_format != IN_FILM and self.passes_to is None:
            unnamed.append(PASSES)
        for name in unnamed:
            found += self.where.path.parent.glob(f"{stem}-{name}.*")
        return [path for path in found if path.exists() and not _is_empty_folder(path)]


def _refuse_equal(field: str, path: Path, others: Mapping[str, Path]) -> None:
    for what, other in others.items():
        if same_file(path, other):
            raise BadInput(
                f"{field} is {what}: it would be overwritten.", field=field, value=path, remedy="Name another file."
            )


def _is_empty_folder(path: Path) -> bool:
    return path.is_dir() and not any(path.iterdir())


def _check_inputs(chosen: Method, params: Params, paths: Mapping[str, Path]) -> None:
    known = {spec.name: spec for spec in chosen.inputs_of(params)}
    for name in paths:
        if name not in known:
            raise BadInput(
                f"The method {chosen.name!r} takes no input {name!r}.",
                field="--input",
                value=name,
                remedy=f"It takes: {', '.join(known)}.",
            )
    for spec, why in missing_inputs(known.values(), paths):
        raise BadInput(f"{why} {spec.help}", field="--input", remedy=f"Add --input {spec.name}=PATH.")


def run(order: RenderOrder, workers: int | None, home: Path, show: Show) -> Json:
    """Render in this command's own workspace and return the summary that `--json` prints.

    Args:
        workers: tasks at once; None: as many as the machine has processors and memory for.

    Raises: BadInput (an input or output cannot be used), Interrupted, JobFailed, Conflict (the same render is running).
    """
    began = time.monotonic()
    _warm_up(order.request)
    sweep(home)
    with tempfile.TemporaryDirectory(prefix="impasto-") as scratch:
        files = gathered(order, Path(scratch))
        probed = probe_guarded(files["video"].path)
        video = dataclasses.replace(probed, **_chosen(probed, order.request))
        _check_result_fits(order, video)
        key = key_of(_facts(order, files))
        with workspace(home, key) as place:
            check_consent(order, place)
            with private_farm.opened(place.folder, workers or 0) as farm:
                job = private_farm.follow(farm, private_farm.submit(farm, order.request, files, key, probed).id, show)
                remember(home, order.request, video, job)
                place.consent()  # existing outputs are our own from here on
                summary = _deliver(farm, job, order, files)
            forget(place.folder)
    wall_s = time.monotonic() - began
    return summary | {"wall_seconds": round(wall_s, 4), "wall_fps": round(summary["frames"] / wall_s, 3)}


def _chosen(video: MediaInfo, request: JobRequest) -> Json:
    """Facts of the video stream that is read. Raises BadParameter."""
    number = request.source.picture
    return {} if number is None else stream_info(video.as_json(), number)


def _check_result_fits(order: RenderOrder, video: MediaInfo) -> None:
    """Refuse an output that cannot hold the frames of the video."""
    first, end = order.request.frames or (0, video.frames)
    check_still(order.where, end - first)
    profile = OUTPUTS[order.where.format].profile(order.request.output.profile)
    check_space(order.where, dataclasses.replace(video, frames=end - first), profile)


def check_consent(order: RenderOrder, place: Workspace) -> None:
    """Refuse to replace files, unless this command or the interrupted one that it resumes may."""
    if order.overwrite:
        place.consent()
    elif not place.consented:
        for existing in order.existing():
            check_new(existing, overwrite=False)


def _warm_up(request: JobRequest) -> None:
    prepare_process()  # with short turns, a thread that loads kernels delays this one little
    chosen = method(request.method)
    begin_warm_up(chosen, parse_params(chosen, request.params))


def gathered(order: RenderOrder, scratch: Path) -> dict[str, InputFile]:
    """Each input of the order as one file."""
    chosen = method(order.request.method)
    numbered = {spec.name for spec in chosen.inputs_of(parse_params(chosen, order.request.params))
                if spec.kind == "images"}  # fmt: skip
    return {
        name: gather("IN", path, scratch, order.sequence) if name == "video"
        else gather(f"--input {name}", path, scratch, numbered=name in numbered)
        for name, path in order.paths.items()
    }  # fmt: skip


def _facts(order: RenderOrder, files: Mapping[str, InputFile]) -> Json:
    """Fields that identify a command. The number of workers is not one of them: it may change between attempts."""
    return {
        "version": version(),
        "request": dataclasses.asdict(order.request),
        "inputs": {name: file.sha256 for name, file in files.items()},
        "output": order.where.path,
    }


def _deliver(farm: Farm, job: Job, order: RenderOrder, files: Mapping[str, InputFile]) -> Json:
    """Write artefacts, then the result: if the result is there, everything is."""
    artefacts = _deliver_artefacts(farm, job, order)
    with farm.files.local(farm.files.get(job.id, "result")) as file:
        info = probe(file)
        with output_faults("--output", order.where.path):
            deliver(file, order.where)
    notes = [note_warning(name, note) for name, file in files.items() for note in file.notes]
    timing = Timing.of(job, private_farm.tasks(farm, job.id))
    return {
        "frames": info.frames,
        "width": info.width,
        "height": info.height,
        "seconds": round(timing.seconds, 4),
        "fps": round(info.frames / timing.seconds, 3) if timing.seconds else 0.0,
        "steps": rounded(timing.steps),
        "stages": rounded(timing.stages),
        "output": str(order.where.path),
        "artefacts": artefacts,
        "job": job.id,
        "warnings": [dataclasses.asdict(warning) for warning in (*notes, *job.warnings)],
    }


def _deliver_artefacts(farm: Farm, job: Job, order: RenderOrder) -> dict[str, str]:
    placed: dict[str, str] = {}
    for name, path in order.artefacts.items():
        if name not in job.results:
            continue  # the job's warnings name it
        served = farm.files.get(job.id, name)
        at = path.absolute() if path else beside(order.where, served.filename)
        with output_faults(f"--artefact {name}", at):
            deliver(farm.files.read(served), OutputTarget(at, "", "file"))
        placed[name] = str(at)
    if order.request.output.passes and PASSES in job.results:
        served = farm.files.get(job.id, PASSES)
        where = order.passes_to or OutputTarget(beside(order.where, served.filename), "", "file")
        with output_faults("--passes-to", where.path):
            deliver(farm.files.read(served), where)
        placed[PASSES] = str(where.path)
    return placed


PLATFORM_STEP = "assemble"
METHOD_STAGE = "method"


@dataclass(frozen=True)
class Timing:
    """Seconds of a job: in total, by step, by stage."""

    seconds: float
    steps: dict[str, float]
    stages: dict[str, float]
    """Summed over all tasks of all steps, "decode" and "encode" among them; overlaps are NOT taken out."""

    @staticmethod
    def of(job: Job, tasks: Iterable[TaskView]) -> Timing:
        share = overlap(_spans(tasks))
        steps = {
            step.name: step.stages.get(METHOD_STAGE, step.seconds) * share
            for step in job.steps
            if step.name != PLATFORM_STEP
        }
        return Timing(sum(steps.values()), steps, _stages(job))


def overlap(spans: Sequence[tuple[float, float]]) -> float:
    """Wall time covered by `spans` over the sum of their lengths: 1 one after another, 1/n for n at once."""
    total = sum(stop - start for start, stop in spans)
    covered, reached = 0.0, float("-inf")
    for start, stop in sorted(spans):
        covered += max(0.0, stop - max(start, reached))
        reached = max(reached, stop)
    return covered / total if total > 0 else 1.0


def _spans(tasks: Iterable[TaskView]) -> list[tuple[float, float]]:
    """Start and end of the attempt that counted, for every finished task of the method."""
    last = [task.attempts[-1] for task in tasks if task.step != PLATFORM_STEP and task.attempts]
    return [span for span in map(_span, last) if span]


def _span(attempt: Json) -> tuple[float, float] | None:
    start, stop = attempt.get("started_at"), attempt.get("finished_at")
    return (start, stop) if start is not None and stop is not None else None


def _stages(job: Job) -> dict[str, float]:
    found: dict[str, float] = {}
    for step in job.steps:
        for stage, seconds in step.stages.items():
            found[stage] = found.get(stage, 0.0) + seconds
    return found


def rounded(values: dict[str, float]) -> Json:
    return {name: round(value, 4) for name, value in values.items()}
