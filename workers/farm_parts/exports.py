"""`farm.exports`: a finished film in other formats. An export is a job of the platform's method `convert`.

The film becomes an asset that belongs to the finished job, not to its owner: it counts for no quota, appears in no
listing, and is deleted with the job.
"""

from __future__ import annotations

from collections.abc import Collection

from pipeline.formats import OUTPUTS
from workers.contract.record import Job, RunState
from workers.contract.request import EXPORT_LABEL, MAX_NAME, JobRequest, OutputSpec
from workers.errors import Conflict, NotFound
from workers.farm_parts.assets import FarmAssets
from workers.farm_parts.files import FarmFiles
from workers.farm_parts.jobs import FarmJobs

CONVERT, FILM = "convert", "film"
SOURCES = tuple(form.name for form in OUTPUTS.values() if not form.lossy)
"""Formats of films that can be exported; others have lost too much quality."""
_MOST = 50


class FarmExports:
    """Makes, lists and deletes exports of jobs."""

    def __init__(self, jobs: FarmJobs, assets: FarmAssets, files: FarmFiles) -> None:
        self._jobs, self._assets, self._files = jobs, assets, files

    def make(self, job_id: str, output: OutputSpec, max_active: int | None = None) -> Job:
        """The export in this format: the existing one, unless it has failed, otherwise a new one.

        Args:
            max_active: unfinished jobs that the owner may have; None: any number.

        Raises:
            Conflict: the job has not succeeded, or its film cannot be exported.
            NotFound: the job, or the source video of its film, no longer exists.
            QuotaExceeded, StorageFull.
        """
        job = self._jobs.get(job_id)
        _check(job)
        for known in self.of(job_id):
            if known.request.output == output:
                if known.state not in (RunState.FAILED, RunState.CANCELLED):
                    return known
                self._jobs.delete(known.id)
        return self._jobs.submit(self._request(job, output), job.owner, max_active=max_active)

    def _request(self, job: Job, output: OutputSpec) -> JobRequest:
        stored = self._files.get(job.id, "result")
        with self._files.local(stored) as path:
            film = self._assets.add(path, stored.filename, owner=job.id)
        return JobRequest(
            CONVERT,
            {"video": job.request.inputs["video"], FILM: film.id},
            output=output,
            name=job.request.name[:MAX_NAME],
            labels={EXPORT_LABEL: job.id},
            frames=job.request.frames,
        )

    def of(self, job_id: str) -> list[Job]:
        """Exports of a job, newest first; not those that another owner labels so. Raises NotFound."""
        owner = self._jobs.get(job_id).owner
        return list(self._jobs.page(method=CONVERT, owner=owner, label=(EXPORT_LABEL, job_id), limit=_MOST).items)

    def having(self, job_ids: Collection[str]) -> set[str]:
        """Those of the jobs that have exports, or the asset of a film that was exported."""
        return self._jobs.labelled(EXPORT_LABEL, job_ids) | self._assets.owners(job_ids)

    def delete(self, job_id: str) -> None:
        """Delete a job's exports and the asset of its film. Raises Conflict: one of them is not finished."""
        made = self.of(job_id)
        for export in made:
            if not export.state.final:
                raise Conflict(
                    "The film is being exported.", field="job_id", value=job_id,
                    remedy=f"Wait for the job {export.id}, or cancel it.",
                )  # fmt: skip
        for export in made:
            self._jobs.delete(export.id)
        for film in self._assets.page(owner=job_id).items:
            self._assets.delete(film.id, job_id)


def _check(job: Job) -> None:
    if EXPORT_LABEL in job.request.labels:
        raise Conflict("An export is not exported again.", field="job_id", value=job.id, remedy="Export its original.")
    if job.state is not RunState.SUCCEEDED:
        raise Conflict(
            f"The job is {job.state}: it has no film to export.", field="job_id", value=job.id,
            remedy="Wait until it has succeeded.",
        )  # fmt: skip
    if job.request.output.format not in SOURCES:
        raise Conflict(
            f"A film in the format {job.request.output.format!r} cannot be exported.", field="job_id", value=job.id,
            remedy=f"Render it as one of: {', '.join(SOURCES)}.",
        )  # fmt: skip
    if "video" not in job.request.inputs:
        raise NotFound("The job has no source video.", field="job_id", value=job.id)
