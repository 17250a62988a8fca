"""An exported project as an order of `impasto render`: the same job that the service would run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from impasto.cli.rendering import RenderOrder
from impasto.delivery import OutputTarget
from pipeline.errors import BadInput
from pipeline.video.numbering import numbers_of_runs
from workers.contract.record import Asset
from workers.contract.request import JobRequest, OutputSpec
from workers.projects.archive import open_project
from workers.projects.checking import problems
from workers.projects.document import Document
from workers.projects.faults import refuse_if_any
from workers.projects.materials import Uploaded, write_material
from workers.projects.parsing import parse_document
from workers.projects.submissions import Selection, Submission, submissions
from workers.settings import FarmSettings


def project_order(
    path: Path, scratch: Path, where: OutputTarget, artefacts: Mapping[str, Path | None], overwrite: bool,
    frames: tuple[int, int] | None = None,
) -> RenderOrder:  # fmt: skip
    """The project's one shot as an order; its inputs are written to `scratch`. The quality is the document's.

    Args:
        frames: [first, end) of the shot's video, instead of the shot's range.

    Raises:
        BadProject: the document is invalid, or has problems.
        BadInput: it has several shots.
        UnreadableMedia: the archive is damaged.
    """
    settings = FarmSettings(home=scratch)
    with open_project(path, 4 * settings.max_asset_bytes) as archive:
        document = parse_document(archive.document)
        files = {asset_id: scratch / asset_id for asset_id in document.asset_ids & archive.manifest.assets.keys()}
        for asset_id, file in files.items():
            archive.extract(asset_id, file)
        assets = {
            key: _asset(key, file, archive.manifest.assets[key].filename, settings) for key, file in files.items()
        }
    submission = _submission(document, assets, Selection(frames=frames))
    inputs = {name: _input(name, submission, assets, files, scratch) for name in submission.inputs}
    wished = submission.output
    profile = wished.profile if wished.format == where.format else ""
    output = OutputSpec(where.format, wished.quality, tuple(sorted(artefacts)), profile=profile, alpha=wished.alpha)
    request = JobRequest(
        submission.method, {}, submission.params, submission.seed, output, name=submission.name,
        frames=submission.frames, on_damage=submission.on_damage,
    )  # fmt: skip
    return RenderOrder(request, inputs, where, artefacts, overwrite)


def _submission(document: Document, assets: Mapping[str, Asset], selection: Selection) -> Submission:
    refuse_if_any(problems(document, assets, selection))
    found = submissions(document, selection)
    if len(found) != 1:
        raise BadInput(
            f"The project has {len(found)} shots, and one film is rendered at a time.", field="IN",
            remedy="Export a project with one shot.",
        )  # fmt: skip
    return found[0]


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
    path = scratch / f"input-{name}"
    numbers = numbers_of_runs(assets[video.asset_id].info["numbers"]) if isinstance(video, Uploaded) else []
    write_material(material, path, lambda asset_id: files[asset_id].read_bytes(), numbers)
    return path
