"""`farm.projects`: documents checked and stored, submitted as jobs, exported and imported."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import BadInput
from pipeline.video.numbering import numbers_of_runs
from workers.contract.project import Project, ProjectJob, ProjectVersion
from workers.contract.record import Asset, Job, Page, RunState, Submitted
from workers.contract.request import JobRequest, Json
from workers.errors import Conflict, NotFound
from workers.farm_parts.assets import FarmAssets
from workers.farm_parts.files import FarmFiles
from workers.farm_parts.jobs import FarmJobs
from workers.previews.model import LayerSources
from workers.projects.archive import ProjectArchive, open_project, write_archive
from workers.projects.checking import problems, shot_problems
from workers.projects.document import MAX_DOCUMENT_BYTES, Document
from workers.projects.faults import BadProject, DocumentFault, refuse_if_any
from workers.projects.materials import ImagesByFrame, JsonValue, Material, Uploaded, write_material
from workers.projects.parsing import parse_document
from workers.projects.sources import layer_sources
from workers.projects.submissions import Selection, Submission, submissions
from workers.projects.upgrades import upgraded
from workers.store.projects import Draft, StoredProjects
from workers.store.reuse import Reuse
from workers.strict_json import check_value
from workers.version import version

Sources = tuple[LayerSources, ...]
CONTENT_LABEL = "content"
"""Label of a project's job: see `content_of`."""
_MOST_OF_CONTENT = 20


def content_of(one: Submission) -> str:
    """What a film shows: the content of its submission, and the program that painted it."""
    return f"{one.content}-{version()}"


@dataclass(frozen=True)
class SubmittedShot:
    """A job that a submission created, or found by its idempotency key."""

    job: Submitted
    shot: str
    variant: str | None
    version: int


class Projects:
    """Projects of a farm. Thread-safe.

    Args:
        store: keeps the projects.
        assets, jobs, files: of the same farm.
        reuse: finds the jobs whose results a new job may use, if they ended at most `reuse_s` ago.
        scratch: a folder for files while they are made; None: the system's.
    """

    def __init__(
        self,
        store: StoredProjects,
        assets: FarmAssets,
        jobs: FarmJobs,
        files: FarmFiles,
        reuse: Reuse,
        reuse_s: float,
        scratch: Path | None = None,
    ) -> None:
        self._reuse, self._reuse_s = reuse, reuse_s
        self._store, self._assets, self._jobs, self._files, self._scratch = store, assets, jobs, files, scratch

    # -- documents

    def create(self, document: Json, owner: str, author: str = "", max_bytes: int | None = None) -> Project:
        """A new project. `max_bytes`: that the versions of all projects of the owner may take; None: any number.

        Raises:
            BadProject: structure.
            QuotaExceeded, StorageFull.
        """
        return self._store.create(self._draft(document, author or owner), owner, max_bytes)

    def get(self, project_id: str) -> Project:
        """The project, deleted or not. Raises NotFound."""
        return self._store.get(project_id)

    def page(self, owner: str | None = None, deleted: bool = False, cursor: str | None = None, limit: int = 50) -> Page:
        """Project items, the most recently changed first."""
        return self._store.page(owner, deleted, cursor, limit)

    def document(self, project_id: str, version: int | None = None) -> tuple[ProjectVersion, Json]:
        """A version (None: the newest) and its document, in the present schema. Raises NotFound."""
        kept, value = self._store.document(project_id, version)
        return kept, upgraded(value)

    def save(
        self, project_id: str, expected: int, document: Json, author: str, max_bytes: int | None = None
    ) -> Project:
        """Store the document as the version after `expected`. `max_bytes`: as for `create`. Raises BadProject,
        VersionMismatch, NotFound, QuotaExceeded, StorageFull."""
        return self._store.save(project_id, expected, self._draft(document, author), max_bytes)

    def _draft(self, document: Json, author: str) -> Draft:
        draft = _draft(document, author)
        self._assets.check_free_space(len(draft.packed))
        return draft

    def versions(self, project_id: str, cursor: str | None = None, limit: int = 50) -> Page:
        """ProjectVersion items, newest first."""
        return self._store.versions(project_id, cursor, limit)

    def label(self, project_id: str, version: int, label: str) -> ProjectVersion:
        """Name a version; named versions are kept. Raises NotFound."""
        return self._store.label(project_id, version, label)

    def delete(self, project_id: str) -> Project:
        """Mark it as deleted; it can be restored for some time."""
        return self._store.delete(project_id)

    def remove(self, project_id: str) -> None:
        """Remove a deleted project with all its versions."""
        self._store.remove(project_id)

    def restore(self, project_id: str) -> Project:
        """Undo a deletion. Raises NotFound once the project has been deleted permanently."""
        return self._store.restore(project_id)

    def share_epoch(self, project_id: str) -> int:
        """The share epoch; links signed with an earlier epoch are invalid."""
        return self._store.share_epoch(project_id)

    def end_shares(self, project_id: str) -> None:
        """Invalidate every link of the project."""
        self._store.end_shares(project_id)

    # -- jobs

    def problems(self, document: Document, owner: str, selection: Selection = Selection()) -> list[DocumentFault]:
        """The problems that keep the selected shots from being rendered."""
        return problems(document, self.assets(document.asset_ids, owner), selection)

    def assets(self, asset_ids: Iterable[str], owner: str) -> dict[str, Asset]:
        """id -> asset, for those of the assets that the owner has."""
        return self._assets.owned(asset_ids, owner)

    def submit(
        self,
        project_id: str,
        selection: Selection = Selection(),
        version: int | None = None,
        idempotency_key: str = "",
        max_active: int | None = None,
        changed: bool = False,
    ) -> list[SubmittedShot]:
        """Submit the selected shots, owned by the project's owner.

        Args:
            version: None: the newest.
            changed: whether a shot with a film, finished or in work, of exactly this content is not submitted again.
            idempotency_key: the same key and selection return the same jobs.
            max_active: unfinished jobs that the owner may have; None: any number.

        Raises:
            BadProject: the document has problems.
        """
        project = self.get(project_id)
        kept, value = self.document(project_id, version)
        document = parse_document(value)
        refuse_if_any(self.problems(document, project.owner, selection))
        made = []
        for one in submissions(document, selection):
            known = self.film_of(project_id, project.owner, one) if changed else None
            if known is not None and one.output.asks_no_more_than(known.request.output):
                made.append(SubmittedShot(Submitted(**vars(known), new=False), one.shot, one.variant, kept.version))
                continue
            key = idempotency_key and f"{idempotency_key}/{one.shot}/{one.variant or ''}"
            labels = {"project": project_id, "shot": one.shot, CONTENT_LABEL: content_of(one)}
            labels |= {"variant": one.variant} if one.variant else {}
            request = self.request(one, project.owner, labels)
            base = self._base(project_id, one)
            job = self._jobs.submit(request, project.owner, key, max_active=max_active, base_id=base)
            made.append(SubmittedShot(job, one.shot, one.variant, kept.version))
        noted = [ProjectJob(each.job.id, each.shot, each.variant, each.version, each.job.created_at) for each in made]
        self._store.add_jobs(project_id, {one.job_id: one for one in noted}.values())  # equal shots have one film
        return made

    def films(self, project_id: str, version: int | None = None) -> tuple[int, Document, list[tuple[str, Job | None]]]:
        """The film of a version (None: the newest): its number, the document, and for each shot in order its id and the
        job that paints what it shows, finished or in work; None: there is none.

        Raises:
            BadProject: the document has problems.
        """
        project = self.get(project_id)
        kept, value = self.document(project_id, version)
        document = parse_document(value)
        refuse_if_any(self.problems(document, project.owner))
        made = [(one.shot, self.film_of(project_id, project.owner, one)) for one in submissions(document)]
        return kept.version, document, made

    def film_of(self, project_id: str, owner: str, one: Submission) -> Job | None:
        """The newest job of the project with exactly this content that has not failed; a finished one comes first."""
        made = self._jobs.page(owner=owner, label=(CONTENT_LABEL, content_of(one)), limit=_MOST_OF_CONTENT).items
        own = [job for job in made if job.request.labels.get("project") == project_id]
        alive = [job for job in own if job.state not in (RunState.FAILED, RunState.CANCELLED)]
        return min(alive, key=lambda job: job.state is not RunState.SUCCEEDED, default=None)

    def _base(self, project_id: str, one: Submission) -> str | None:
        """Id of the newest finished job of the same shot, whose results are reused if nothing has changed; empty: none
        exists; None: results are not reused."""
        if self._reuse_s <= 0:
            return None
        return self._reuse.base(project_id, one.shot, one.variant, one.method, one.frames, self._reuse_s) or ""

    def request(self, submission: Submission, owner: str, labels: dict[str, str] | None = None) -> JobRequest:
        """Submit a job, with its inputs converted to assets of `owner`."""
        video = submission.inputs.get("video")
        info = self._assets.get(video.asset_id, owner).info if isinstance(video, Uploaded) else {}
        numbers = numbers_of_runs(info.get("numbers", ()))
        ids = {name: self._asset_id(material, owner, numbers) for name, material in submission.inputs.items()}
        return submission.request(ids, labels or {})

    def _asset_id(self, material: Material, owner: str, numbers: Sequence[int]) -> str:
        if isinstance(material, Uploaded):
            return material.asset_id  # `FarmJobs.submit` refuses it if it is not the owner's
        return self._made(material, owner, numbers).id

    def _made(self, material: ImagesByFrame | JsonValue, owner: str, numbers: Sequence[int]) -> Asset:
        with tempfile.TemporaryDirectory(prefix="impasto-", dir=self._scratch) as folder:
            path = Path(folder) / "material"
            name = write_material(material, path, lambda asset_id: b"".join(self._bytes(asset_id, owner)), numbers)
            return self._assets.add(path, name, owner)

    def _bytes(self, asset_id: str, owner: str) -> Iterator[bytes]:
        return self._files.read(self._assets.file(asset_id, owner))

    def jobs(self, project_id: str) -> list[tuple[ProjectJob, Job | None]]:
        """Jobs of the project, newest first; None for one that was deleted."""
        return [(noted, self._job(noted.job_id)) for noted in self._store.jobs(project_id)]

    def _job(self, job_id: str) -> Job | None:
        try:
            return self._jobs.get(job_id)
        except NotFound:
            return None

    # -- previews

    def layer_sources(self, project: Project, value: Json, shot_id: str, layer_id: str | None) -> Sources:
        """The layers that previews of a shot show: one layer, or all visible ones.

        Args:
            value: a document of the project, which may be unsaved.

        Raises:
            BadProject: the document is invalid, or the layers have problems.
            NotFound: there is no such shot or layer.
        """
        document = parse_document(value)
        shot = _one(document.shots, shot_id, "shot")
        chosen = [layer for layer in shot.layers if layer.visible]
        if layer_id is not None:
            chosen = [_one(shot.layers, layer_id, "layer").model_copy(update={"visible": True})]
        shown = shot.model_copy(update={"layers": tuple(chosen), "range": None})
        places = [index for index, layer in enumerate(shot.layers) if any(layer.id == own.id for own in chosen)]
        assets = self.assets(document.asset_ids, project.owner)
        refuse_if_any(shot_problems(document, assets, shown, document.shots.index(shot), places))
        return tuple(layer_sources(document, shown, layer, assets) for layer in chosen)

    # -- archives

    def export(self, project_id: str, path: Path, version: int | None = None) -> None:
        """Write the project with its assets to a zip file at `path`."""
        project = self.get(project_id)
        _, value = self.document(project_id, version)
        assets = self.assets(parse_document(value).asset_ids, project.owner)
        write_archive(path, value, assets, lambda asset_id: self._bytes(asset_id, project.owner))

    def load(
        self,
        path: Path,
        owner: str,
        limit_bytes: int,
        admit: Callable[[int], None] = lambda size: None,
        max_bytes: int | None = None,
    ) -> Project:
        """A new project of `owner` from an exported zip file.

        Args:
            limit_bytes: maximum size of the unpacked archive.
            admit: called with the size of each new asset before it is unpacked; may raise an error to refuse it.
            max_bytes: as for `create`.

        Raises:
            UnreadableMedia: the archive is invalid.
            BadProject: its document is invalid.
        """
        with open_project(path, limit_bytes) as archive, ExitStack() as undo:
            document = parse_document(archive.document)
            for asset_id in sorted(document.asset_ids & archive.manifest.assets.keys()):
                if self._unpack(archive, asset_id, owner, admit):
                    undo.callback(self._give_up, asset_id, owner)
            made = self.create(archive.document, owner, max_bytes=max_bytes)
            undo.pop_all()
            return made

    def _unpack(self, archive: ProjectArchive, asset_id: str, owner: str, admit: Callable[[int], None]) -> bool:
        """Add an asset of the archive; returns whether the owner did not have it before."""
        new = not self.assets([asset_id], owner)
        if new:
            admit(archive.size_bytes(asset_id))
        with tempfile.TemporaryDirectory(prefix="impasto-", dir=self._scratch) as folder:
            path = Path(folder) / "asset"
            filename = archive.extract(asset_id, path)
            self._assets.add(path, filename, owner)  # also a known one, whose bytes may be lost
        return new

    def _give_up(self, asset_id: str, owner: str) -> None:
        """Delete an asset of a refused import, unless it is in use by now."""
        with suppress(NotFound, Conflict):
            self._assets.delete(asset_id, owner)


def _one(items: Iterable[Any], wanted: str, field: str) -> Any:
    for item in items:
        if item.id == wanted:
            return item
    raise NotFound(
        f"The project has no {field} of this name.", field=field, value=wanted, remedy=f"Name a {field} of it."
    )


def _draft(value: Json, author: str) -> Draft:
    check_value(value)
    value = upgraded(value)
    document = parse_document(value)
    draft = Draft(value, document.name, document.asset_ids, author)
    if draft.size_bytes > MAX_DOCUMENT_BYTES:
        raise BadInput(
            f"A document has at most {MAX_DOCUMENT_BYTES} bytes.", field="document", value=draft.size_bytes,
            remedy="Upload strokes and pictures as assets.",
        )  # fmt: skip
    return draft


__all__ = ["BadProject", "Projects", "SubmittedShot"]
