"""`farm.jobs`: submit, show, list, steer and delete jobs; their events; previews of one frame."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Sequence

from pipeline.errors import StorageError
from pipeline.methods import method
from workers.blobs.base import Blobs
from workers.errors import NotFound
from workers.execution.lru_cache import LruCache
from workers.jobs import state_machine as machine
from workers.model import Asset, Event, Job, JobRequest, Json, Page, Submitted
from workers.previews.service import PreviewService
from workers.previews.single import PreviewAsk, PreviewJob
from workers.process.log_context import log_extra
from workers.scheduling.garbage_collector import GarbageCollector
from workers.scheduling.requests import check_request
from workers.store import Store

log = logging.getLogger(__name__)


class FarmJobs:
    """
    Args:
        collector: deletes the blobs of deleted jobs.
        wake: called after every change that may let a task start.
        images: cache of encoded previews.
        previews: makes the previews that are not cached.
    """

    def __init__(
        self,
        store: Store,
        blobs: Blobs,
        collector: GarbageCollector,
        wake: Callable[[], None],
        images: LruCache[bytes],
        previews: PreviewService,
    ) -> None:
        self._store, self._blobs = store, blobs
        self._collector, self._wake = collector, wake
        self._images = images
        self._previews = previews

    def submit(
        self,
        request: JobRequest,
        owner: str = "",
        idempotency_key: str = "",
        admit: Callable[[], None] = lambda: None,
        max_active: int | None = None,
        base_id: str | None = None,
    ) -> Submitted:
        """Validate the request and accept the job durably. The same idempotency key and request return the earlier job.

        Args:
            admit: called before a new job is validated; may raise an error to refuse the job.
            max_active: unfinished jobs that the owner may have, this one included; None: any number.
            base_id: see `workers.store.jobs.Jobs.add`.

        Raises:
            BadParameter: method, parameters or inputs are wrong.
            NotFound: an input's asset does not exist.
            IdempotencyMismatch: the key came with another request.
            QuotaExceeded: the owner has `max_active` unfinished jobs.
            StorageFull: there is no space left.
        """
        if known := self._store.jobs.made_by(request, owner, idempotency_key):
            return known
        admit()
        accepted = check_request(request, self._inputs(request))
        self._blobs.check_free_space()
        job = self._store.jobs.add(accepted, owner, idempotency_key, max_active, base_id)
        log.info("job accepted", extra=log_extra(job=job.id, owner=owner, method=request.method))
        self._wake()
        return job

    def _inputs(self, request: JobRequest) -> dict[str, Asset]:
        return {name: self._input(name, asset_id) for name, asset_id in request.inputs.items()}

    def _input(self, name: str, asset_id: str) -> Asset:
        """The asset; an error names the input that refers to it."""
        try:
            return self._store.assets.get(asset_id)
        except NotFound as error:
            raise NotFound(error.message, field=f"inputs.{name}", value=error.value, remedy=error.remedy) from None

    def get(self, job_id: str) -> Job:
        """Raises NotFound."""
        return self._store.jobs.get(job_id)

    def ahead(self, job_id: str) -> list[Job]:
        """Jobs that are served before this one, see `workers.store.jobs.Jobs.ahead`. Raises NotFound."""
        return self._store.jobs.ahead(job_id)

    def page(
        self,
        state: str | None = None,
        method: str | None = None,
        owner: str | None = None,
        label: tuple[str, str] | None = None,
        cursor: str | None = None,
        limit: int = 50,
        search: str = "",
    ) -> Page:
        """`Job` items, newest first. `state` and `search`: see `Jobs.page` of the store."""
        return self._store.jobs.page(state, method, owner, label, cursor, limit, search)

    def cancel(self, job_id: str) -> Job:
        """Raises Conflict: the job is final."""
        return self._apply(job_id, machine.Cancel())

    def pause(self, job_id: str) -> Job:
        """Start no more tasks; running attempts end. Raises Conflict: the job is neither queued nor running."""
        return self._apply(job_id, machine.Pause())

    def resume(self, job_id: str) -> Job:
        """Raises Conflict: the job is not paused."""
        return self._apply(job_id, machine.Resume())

    def prioritise(self, job_id: str, priority: int | None) -> Job:
        """Another priority for an unfinished job, -100..100, higher first; None: one above all other unfinished jobs.
        Jobs of one priority are served in the order of submission. Raises Conflict: the job has ended."""
        job = self._store.jobs.prioritise(job_id, priority)
        self._wake()
        return job

    def _apply(self, job_id: str, event: machine.Cancel | machine.Pause | machine.Resume) -> Job:
        job = self._store.jobs.command(job_id, event)
        self._wake()
        return job

    def retry(self, job_id: str, max_active: int | None = None) -> Job:
        """Queue again only the tasks that failed or were cancelled.

        Args:
            max_active: unfinished jobs that the owner may have, this one included; None: any number.

        Raises:
            Conflict: the job did neither fail nor was cancelled.
            QuotaExceeded: the owner has `max_active` other unfinished jobs.
        """
        job = self._store.jobs.retry(job_id, max_active)
        self._wake()
        return job

    def delete(self, job_id: str) -> None:
        """Delete the job and its blobs. Raises Conflict: the job is not final."""
        self._store.jobs.remove(job_id)
        try:
            self._collector.job(job_id)
        except StorageError:  # the job is deleted; its blobs are deleted when the blob store answers again
            self._collector.later(job_id)

    def events(self, job_id: str, after: int = 0, limit: int = 500) -> tuple[Sequence[Event], bool]:
        """Events with seq > `after`, and whether some of these have been pruned (history is bounded)."""
        return self._store.events.list(job_id, after, limit)

    def wait_for_event(self, job_id: str, after: int, timeout_s: float) -> bool:
        """Block until the job has an event with seq > `after`; False on time-out."""
        return self._store.events.wait(job_id, after, timeout_s)

    def preview(
        self, request: JobRequest, frame: int, max_side_px: int = 640, design: Json | None = None,
        artefacts_of: str | None = None,
    ) -> bytes:  # fmt: skip
        """One frame (scaled to fit) stylised with the request's parameters; PNG bytes.

        Args:
            design: a design document in place of the request's input of that name.
            artefacts_of: id of a finished job of the same method, whose artefacts the preview uses.
        """
        assets = self._inputs(request)
        params = check_request(request, assets).params
        artefacts = {} if artefacts_of is None else self._artefact_keys(artefacts_of, request.method)
        wanted = json.dumps(
            [request.method, params, request.seed, request.inputs, frame, max_side_px, design, artefacts],
            sort_keys=True,
        )
        documents = {} if design is None else {"design": design}
        job = PreviewJob(request, assets, PreviewAsk(frame, max_side_px, documents, artefacts))
        return self._images.get(wanted, lambda: self._previews.frame(job))

    def _artefact_keys(self, job_id: str, chosen: str) -> dict[str, str]:
        """Blob keys of the artefacts that a job has made, by name."""
        files = {name: self._store.jobs.file(job_id, name) for name in method(chosen).artefacts}
        made = {name: str(row["key"]) for name, row in files.items() if row is not None}
        if not made:
            known = ", ".join(files) or "none"
            remedy = f"Name a finished job that was submitted with an artefact of the method {chosen!r}: {known}."
            raise NotFound("The job has made no artefact.", field="artefacts_of", value=job_id, remedy=remedy)
        return made
