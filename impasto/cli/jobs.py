"""Commands about jobs at a service: `impasto submit`, `jobs`, `watch`, `get`, `cancel`, `retry`."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from impasto.cli.console import emit, out, print_status, print_table, print_warnings, progress, table
from impasto.cli.option_classes import takes_options
from impasto.cli.options import (
    AlphaOption,
    ColourInOption,
    ColourOutOption,
    ColourViewOption,
    DamageOption,
    DamagePolicy,
    FieldOrder,
    FieldsOption,
    FormatOption,
    FpsOption,
    FramesOption,
    InputOption,
    JsonFlag,
    KeyOption,
    LayerOption,
    MethodOption,
    MissingOption,
    OpacityChoice,
    OverwriteFlag,
    ParamOption,
    PassesFormatOption,
    PassesOption,
    PictureOption,
    PremultipliedOption,
    ProfileOption,
    QualityOption,
    QuietFlag,
    SeedOption,
    ServerOption,
    SoundOption,
    VectorsOption,
    ViewOption,
    client_of,
    frames_of,
    inputs_of,
    labels_of,
    params_of,
    passes_of,
    sequence_of,
    source_of,
)
from pipeline.errors import BadInput
from pipeline.method_names import DEFAULT
from pipeline.video.media import SourceOptions
from workers.contract.request import Json
from workers.errors import NotFound

if TYPE_CHECKING:
    from impasto_client import Client
    from impasto_client.models import Job, JobOptions
    from pipeline.video.sequence_options import SequenceOptions


SUBMIT_EPILOG = """[bold]Examples[/bold]

job=$(impasto submit clip.mp4 --param lines=off)

impasto watch "$job" && impasto get "$job" -o cartoon.mp4

impasto submit clip.mp4 --webhook https://example.org/hook --label shot=12 --json
"""


@dataclass(frozen=True, kw_only=True)
class SubmitOptions:
    """Options of `impasto submit`."""

    source: Annotated[Path, typer.Argument(metavar="IN", help="A video, an image, a folder, or name.####.png.")]
    method: MethodOption = DEFAULT
    param: ParamOption = None
    extra: InputOption = None
    output_format: FormatOption = "mp4"
    profile: ProfileOption = ""
    alpha: AlphaOption = OpacityChoice.AUTO
    premultiplied: PremultipliedOption = False
    colour_in: ColourInOption = ""
    colour_view: ColourViewOption = ""
    colour_out: ColourOutOption = ""
    artefact: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Also make an artefact.")] = None
    passes: PassesOption = ""
    passes_format: PassesFormatOption = ""
    quality: QualityOption = 20
    report: Annotated[bool, typer.Option("--report", help="Measure the result: flicker, sharpness, faces.")] = False
    seed: SeedOption = 0
    frames: FramesOption = ""
    name: Annotated[str, typer.Option(help="Name of the job; default: the name of IN.")] = ""
    label: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="A label for searching; repeatable.")
    ] = None
    on_damage: DamageOption = DamagePolicy.WARN
    video_stream: PictureOption = None
    sound_track: SoundOption = None
    fields: FieldsOption = FieldOrder.AUTO
    missing: MissingOption = None
    fps: FpsOption = None
    layer: LayerOption = None
    view: ViewOption = None
    vectors: VectorsOption = None
    priority: Annotated[int, typer.Option(min=-100, max=100, help="Priority; higher runs first.")] = 0
    webhook: Annotated[str, typer.Option(metavar="URL", help="URL that receives a message when the job ends.")] = ""
    idempotency_key: Annotated[
        str, typer.Option(help="Repeating a request with the same key returns the same job.")
    ] = ""
    server: ServerOption = None
    api_key: KeyOption = None
    as_json: JsonFlag = False


@takes_options(SubmitOptions)
def submit(options: SubmitOptions) -> None:
    """Upload IN and submit a job to a service. Prints the job's id."""
    from impasto.cli.input_files import upload

    paths = {"video": options.source, **inputs_of(options.extra or [])}
    sequence = sequence_of(options.missing, options.fps, options.layer, options.view, options.vectors)
    given, more = params_of(options.param or []), _job_options(options, sequence)
    with client_of(options.server, options.api_key) as client:
        job = client.submit(
            options.method,
            upload(client, paths, sequence=sequence),
            given,
            idempotency_key=options.idempotency_key,
            **more,
        )
    _print_submitted(job, options.as_json)


def _job_options(options: SubmitOptions, sequence: SequenceOptions) -> JobOptions:
    from impasto.cli.input_files import plain

    output = {"format": options.output_format, "quality": options.quality, **_encoding(options)}
    frames = frames_of(options.frames, options.source, sequence)
    found = {
        "seed": options.seed,
        "output": output | {"artefacts": options.artefact or [], "report": options.report},
        "name": options.name or plain(options.source.name),
        "labels": labels_of(options.label or []),
        "priority": options.priority,
        "webhook": options.webhook,
        "on_damage": options.on_damage.value,
        **({} if frames is None else {"frames": frames}),
        **_source(options),
    }
    return cast("JobOptions", found)


def _encoding(options: SubmitOptions) -> Json:
    """Profile, opacity, colour space and passes, if given: services of earlier versions do not know the fields."""
    given: Json = {"profile": options.profile, "alpha": options.alpha.value, "colour": options.colour_out}
    given |= {"passes": passes_of(options.passes), "passes_format": options.passes_format}
    return {name: value for name, value in given.items() if value not in ("", "auto", ())}


def _source(options: SubmitOptions) -> Json:
    """How the video is read, if not in the usual way: services of earlier versions do not know the field."""
    source = source_of(options)
    return {} if source == SourceOptions() else {"source": source.as_json()}


def _print_submitted(job: Job, as_json: bool) -> None:
    if as_json:
        emit(job)
        return
    out.print(job["id"], markup=False)
    print_status(f"{job['state']}; follow it with: impasto watch {job['id']}")


GET_EPILOG = """[bold]Examples[/bold]

impasto get job_01J... -o cartoon.mp4

impasto get job_01J... -o frames/            the frames of a "png" job, numbered

impasto get job_01J... --file sheet -o sheet.jpg
"""
SEARCHED_JOBS = 1000
"""Newest jobs among which an abbreviated id is looked up."""

JobArgument = Annotated[str, typer.Argument(metavar="JOB", help="A job's id, or a unique beginning of it.")]


def jobs(
    state: Annotated[str | None, typer.Option(help="queued, running, paused, succeeded, failed or cancelled.")] = None,
    method: Annotated[str | None, typer.Option("--method", "-m", help="Only jobs of this method.")] = None,
    label: Annotated[str | None, typer.Option(metavar="NAME=VALUE", help="Only jobs with this label.")] = None,
    limit: Annotated[int, typer.Option(min=1, max=200, help="Maximum number of jobs to list.")] = 20,
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """List the newest jobs of a service."""
    wanted = None if label is None else next(f"{name}:{value}" for name, value in labels_of([label]).items())
    with client_of(server, api_key) as client:
        found = client.jobs(state=state, method=method, label=wanted, limit=limit)
    if as_json:
        emit(found)
        return
    rows = table("job", "name", "method", "state", "done", "submitted")
    for job in found:
        submitted = datetime.fromtimestamp(job["created_at"]).astimezone().strftime("%Y-%m-%d %H:%M")
        request = job["request"]
        rows.add_row(job["id"], request["name"], request["method"], job["state"], f"{job['progress']:.0%}", submitted)
    print_table(rows)


def watch(
    job: JobArgument,
    server: ServerOption = None,
    api_key: KeyOption = None,
    quiet: QuietFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Show a job's progress until it ends. Ctrl-C stops watching, not the job.

    The exit status is 0 if the job succeeded, 1 if it failed or was cancelled.
    """
    from impasto_client.problems import job_failed

    with client_of(server, api_key) as client, progress(quiet) as show:
        for latest in client.watch(find_id(client, job)):
            show(latest)
    print_warnings(latest.get("warnings", ()))
    if latest["state"] != "succeeded":
        raise job_failed(latest)
    if as_json:
        emit(latest)
    else:
        print_status(f"succeeded; fetch it with: impasto get {latest['id']} -o cartoon.mp4")


_JPEG = ("poster", "sheet", "preview")
"""Files of jobs that are images."""


def get(
    job: JobArgument,
    output: Annotated[str, typer.Option("--output", "-o", metavar="OUT", help="A file, or a folder: DIR/.")],
    file: Annotated[str, typer.Option(help="result, poster, sheet, preview, or an artefact.")] = "result",
    overwrite: OverwriteFlag = False,
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Download a job's result. OUT appears whole or not at all; a broken download is resumed."""
    from impasto.delivery import OutputTarget, check_new, deliver, target

    with client_of(server, api_key) as client:
        job_id = find_id(client, job)
        if file == "result":
            where = target(output, form=client.job(job_id)["request"]["output"]["format"])
        else:
            where = OutputTarget(Path(output).expanduser().absolute(), "", "file")
            if file in _JPEG and where.path.suffix.lower() not in (".jpg", ".jpeg"):
                raise BadInput(f"{file!r} is a JPEG image.", field="--output", value=output, remedy="Name it NAME.jpg.")
        check_new(where.path, overwrite)
        with tempfile.TemporaryDirectory(prefix="impasto-") as scratch:
            deliver(client.download(job_id, Path(scratch) / "file", file), where)
    if as_json:
        emit({"job": job_id, "file": file, "output": str(where.path)})
    else:
        out.print(str(where.path), markup=False)


def cancel(job: JobArgument, server: ServerOption = None, api_key: KeyOption = None, as_json: JsonFlag = False) -> None:
    """Cancel a job. Finished tasks are kept: `impasto retry` resumes it."""
    with client_of(server, api_key) as client:
        cancelled = client.cancel(find_id(client, job))
    _print(cancelled, as_json, "")


def retry(job: JobArgument, server: ServerOption = None, api_key: KeyOption = None, as_json: JsonFlag = False) -> None:
    """Run the failed and cancelled tasks of a job again; succeeded tasks are kept."""
    with client_of(server, api_key) as client:
        again = client.retry(find_id(client, job))
    _print(again, as_json, f"; follow it with: impasto watch {again['id']}")


def pause(job: JobArgument, server: ServerOption = None, api_key: KeyOption = None, as_json: JsonFlag = False) -> None:
    """Start no further tasks of a job. Running ones finish: `impasto resume` continues it."""
    with client_of(server, api_key) as client:
        paused = client.pause(find_id(client, job))
    _print(paused, as_json, f"; continue it with: impasto resume {paused['id']}")


def resume(job: JobArgument, server: ServerOption = None, api_key: KeyOption = None, as_json: JsonFlag = False) -> None:
    """Continue a paused job."""
    with client_of(server, api_key) as client:
        resumed = client.resume(find_id(client, job))
    _print(resumed, as_json, f"; follow it with: impasto watch {resumed['id']}")


def priority(
    job: JobArgument,
    priority: Annotated[
        int | None, typer.Argument(min=-100, max=100, help="Higher runs first; none: above all other unfinished jobs.")
    ] = None,
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Change the priority of a job (needs an admin key). Tasks that run are not stopped."""
    with client_of(server, api_key) as client:
        changed = client.ops.prioritise(find_id(client, job), priority)
    _print(changed, as_json, f"; its priority is {changed['request']['priority']}")


def _print(job: Job, as_json: bool, hint: str) -> None:
    if as_json:
        emit(job)
    else:
        print_status(f"{job['id']}: {job['state']}{hint}")


def find_id(client: Client, text: str) -> str:
    """The whole id of the job that `text` is, or begins. The prefix "job_" may be left out.

    Raises: NotFound, BadInput (several jobs begin with it).
    """
    try:
        return str(client.job(text)["id"])
    except NotFound:
        pass
    prefix = text if text.startswith("job_") else f"job_{text}"
    return _only(text, [job["id"] for job in client.newest_jobs(SEARCHED_JOBS) if job["id"].startswith(prefix)])


def _only(text: str, ids: list[str]) -> str:
    if not ids:
        raise NotFound("Job not found.", field="JOB", value=text, remedy="List them with `impasto jobs`.")
    if len(ids) > 1:
        raise BadInput(
            f"{len(ids)} jobs begin with that.",
            field="JOB",
            value=text,
            remedy=f"Give more of the id: {', '.join(ids[:4])}{', ...' if len(ids) > 4 else ''}",
        )
    return ids[0]


COMMANDS: tuple[tuple[Callable[..., None], str], ...] = (
    (watch, ""),
    (get, GET_EPILOG),
    (cancel, ""),
    (retry, ""),
    (pause, ""),
    (resume, ""),
    (priority, ""),
    (jobs, ""),
)
"""The commands in the order of `impasto --help`, each with the examples that follow its help text."""
