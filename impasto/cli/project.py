"""An exported project as orders of `impasto render`: the same jobs that the service would run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from impasto.cli.rendering import RenderOrder
from impasto.delivery import OutputTarget
from impasto.ranges import Span, facts_of
from pipeline.errors import BadInput, BadParameter
from pipeline.formats import output_format
from pipeline.formats.base import Profile
from pipeline.video.numbering import numbers_of_runs
from workers.contract.record import Asset
from workers.contract.request import JobRequest, OutputSpec
from workers.projects.archive import open_project
from workers.projects.checking import problems
from workers.projects.document import Document, Shot
from workers.projects.faults import refuse_if_any
from workers.projects.joining import ShotClip, joining_notes, joins, loses
from workers.projects.materials import Uploaded, write_material
from workers.projects.parsing import parse_document
from workers.projects.submissions import Selection, Submission, submissions
from workers.settings import FarmSettings


@dataclass(frozen=True)
class FilmOrder:
    """A project as orders: one for each shot, in order. Shots that show the same have equal orders."""

    shots: tuple[RenderOrder, ...]
    contents: tuple[str, ...]
    """Digest of what determines the film of each shot."""
    where: OutputTarget
    quality: int
    profile: str
    """Encoding of the film, if the shots must be encoded again to be joined."""
    overwrite: bool
    notes: tuple[str, ...]
    """Messages to the user, for example that shots of another size get black borders."""

    def check(self) -> None:
        """Refuse an invalid order. Raises: BadParameter, BadInput."""
        for shot in self.shots:
            shot.check()


def project_orders(
    path: Path, scratch: Path, where: OutputTarget, artefacts: Mapping[str, Path | None], overwrite: bool,
    span: Span | None = None, shot: int | None = None, wanted: OutputSpec = OutputSpec(),
) -> FilmOrder:  # fmt: skip
    """The project's shots as orders whose inputs are written to `scratch`. The quality is the document's.

    Args:
        span: frames of the shot's video, instead of the shot's range.
        shot: number of the only shot to render, from 1; None: all.
        wanted: its passes, if it has any, replace those of the document.

    Raises:
        BadProject: the document is invalid, or has problems.
        BadInput: there is no such shot, or an option or the output is for one shot and there are several.
        UnreadableMedia: the archive is damaged.
    """
    settings = FarmSettings(home=scratch)
    with open_project(path, 4 * settings.max_asset_bytes) as archive:
        document = parse_document(archive.document)
        chosen = _chosen(document, shot)
        files = {asset_id: scratch / asset_id for asset_id in document.asset_ids & archive.manifest.assets.keys()}
        for asset_id, file in files.items():
            archive.extract(asset_id, file)
        assets = {
            key: _asset(key, file, archive.manifest.assets[key].filename, settings) for key, file in files.items()
        }
    video = files.get(document.assets[chosen[0].video].id)  # a missing one is a problem of the document
    frames = None if span is None or video is None else span.resolve(facts_of(video), "--frames")
    passes = {"passes": wanted.passes, "passes_format": wanted.passes_format} if wanted.passes else {}
    output = document.output.model_copy(update=passes)
    selection = Selection(shots=[one.id for one in chosen], frames=frames, output=output)
    refuse_if_any(problems(document, assets, selection))
    made = submissions(document, selection)
    if len(made) > 1:
        alone = {"--frames": frames is not None, "--artefact": bool(artefacts), "--passes": bool(output.passes)}
        _check_film(where, alone, len(made))
    clips = [ShotClip.of(number, one, document, assets) for number, one in enumerate(chosen, start=1)]
    profile = document.output.profile if document.output.format == where.format else ""
    return FilmOrder(
        tuple(_order(one, assets, files, scratch, (where, artefacts, overwrite)) for one in made),
        tuple(one.content for one in made), where, document.output.quality, profile, overwrite,
        _notes(clips, output_format(where.format).profile(profile)),
    )  # fmt: skip


def _notes(clips: Sequence[ShotClip], profile: Profile) -> tuple[str, ...]:
    """Sentences on how clips that differ are joined. Raises BadParameter: this profile cannot join them."""
    notes = joining_notes(clips, profile)
    if notes and loses(profile):
        raise BadParameter(
            " ".join(notes), field="output.profile", value=profile.title,
            remedy="Name a film of 8 bits without opacity, such as film.mp4, or add --shot N.",
        )  # fmt: skip
    return notes


def _chosen(document: Document, number: int | None) -> list[Shot]:
    shots = list(document.shots)
    if number is None:
        return shots
    if number > len(shots):
        raise BadInput(
            "The project has no such shot.", field="--shot", value=number,
            remedy=f"It has {len(shots)} shots: {', '.join(one.name or one.id for one in shots)[:200]}.",
        )  # fmt: skip
    return [shots[number - 1]]


def _check_film(where: OutputTarget, alone: Mapping[str, bool], shots: int) -> None:
    """Refuse what only works for one shot. `alone`: such options, and whether they are given."""
    for option, given in alone.items():
        if given:
            raise BadInput(
                f"{option} is for one shot, and the project has {shots}.", field=option, remedy="Add --shot N."
            )
    form = output_format(where.format)
    if not joins(form):
        raise BadInput(
            f"Films of several shots cannot be joined as {form.title}.", field="--output", value=where.path,
            remedy="Name a video file such as film.mp4, or add --shot N.",
        )  # fmt: skip


def _order(
    submission: Submission, assets: Mapping[str, Asset], files: Mapping[str, Path], scratch: Path,
    output: tuple[OutputTarget, Mapping[str, Path | None], bool],
) -> RenderOrder:  # fmt: skip
    where, artefacts, overwrite = output
    inputs = {name: _input(name, submission, assets, files, scratch) for name in submission.inputs}
    wished = submission.output
    profile = wished.profile if wished.format == where.format else ""
    spec = replace(wished, format=where.format, artefacts=tuple(sorted(artefacts)), profile=profile, report=False)
    request = JobRequest(
        submission.method, {}, submission.params, submission.seed, spec, name=submission.name,
        frames=submission.frames, on_damage=submission.on_damage, source=submission.source,
    )  # fmt: skip
    return RenderOrder(request, inputs, where, artefacts, overwrite)


def _asset(asset_id: str, file: Path, filename: str, settings: FarmSettings) -> Asset:
    from pipeline.video.probe import probe_guarded

    info = probe_guarded(file, settings.limits)
    sha256 = asset_id.removeprefix("ast_")
    return Asset(asset_id, sha256, file.stat().st_size, filename, info.media_type, info.kind, info.as_json(), 0.0)


def _input(
    name: str, submission: Submission, assets: Mapping[str, Asset], files: Mapping[str, Path], scratch: Path
) -> Path:
    material, video = submission.inputs[name], submission.inputs["video"]
    if isinstance(material, Uploaded):
        return files[material.asset_id]
    path = scratch / f"input-{submission.shot}-{name}"
    numbers = numbers_of_runs(assets[video.asset_id].info["numbers"]) if isinstance(video, Uploaded) else []
    write_material(material, path, lambda asset_id: files[asset_id].read_bytes(), numbers)
    return path
