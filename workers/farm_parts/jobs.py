"""`farm.jobs`: submit, show, list, steer and delete jobs; their events; previews of one frame."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from functools import cache
from types import MappingProxyType
from typing import Literal, cast

from pydantic import JsonValue

from pipeline.errors import BadParameter, StorageError
from pipeline.methods import method
from workers.blobs.base import Blobs
from workers.contract.record import AnyOwner, Asset, Event, Job, Page, Submitted, asset_key
from workers.contract.request import EXPORT_LABEL, JobRequest, Json
from workers.errors import NotFound
from workers.execution.lru_cache import LruCache
from workers.jobs import estimates
from workers.jobs import state_machine as machine
from workers.jobs.estimates import SAMPLES, Estimate, MeasuredJob, MeasuredPreview, measured
from workers.previews.model import video_key
from workers.previews.service import PreviewService
from workers.previews.single import PreviewAsk, PreviewJob
from workers.process.log_context import log_extra
from workers.scheduling.check_request import check_request
from workers.scheduling.garbage_collector import GarbageCollector
from workers.store import Store
from workers.store.bulk import Refused
from workers.store.queue_position import MethodAhead

log = logging.getLogger(__name__)

Command = Literal["cancel", "pause", "resume", "delete"]
"""Commands that may be given to several jobs at once."""

SAMPLES_S = 30.0
"""Time for which the finished jobs on which estimates are based are kept in memory, seconds."""
_SAMPLED_METHODS = 64


class FarmJobs:
    """
    Args:
        collector: deletes the blobs of deleted jobs.
        wake: called after every change that may let a task start.
        images: cache of encoded previews.
        previews: makes the previews that are not cached.
        slots: number of tasks of one processor that run at once.
    """

    def __init__(
        self,
        store: Store,
        blobs: Blobs,
        collector: GarbageCollector,
        wake: Callable[[], None],
        images: LruCache[bytes],
        previews: PreviewService,
        slots: int,
    ) -> None:
        self._store, self._blobs = store, blobs
        self._collector, self._wake = collector, wake
        self._images = images
        self._previews, self._slots = previews, slots
        self._samples: LruCache[list[MeasuredJob]] = LruCache(_SAMPLED_METHODS)

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
            NotFound: the owner does not have an input's asset.
            IdempotencyMismatch: the key came with another request.
            QuotaExceeded: the owner has `max_active` unfinished jobs.
            StorageFull: there is no space left.
        """
        if known := self._store.jobs.made_by(request, owner, idempotency_key):
            return known
        admit()
        accepted = check_request(request, self._inputs(request, owner), self._document)
        self._blobs.check_free_space()
        job = self._store.jobs.add(accepted, owner, idempotency_key, max_active, base_id)
        log.info("job accepted", extra=log_extra(job=job.id, owner=owner, method=request.method))
        self._wake()
        return job

    def _document(self, asset: Asset) -> JsonValue:
        """The document of a JSON asset. Raises ValueError."""
        return cast("JsonValue", json.loads(self._blobs.get(asset_key(asset.id))))

    def _inputs(self, request: JobRequest, owner: str | AnyOwner) -> dict[str, Asset]:
        """The inputs that `owner` has: as an asset, or in an export as the film of a job of theirs."""
        holders = [owner]
        with suppress(NotFound):
            exported = self._store.jobs.get(request.labels.get(EXPORT_LABEL, ""))
            holders += [exported.id] * (exported.owner == owner)
        return {name: self._input(name, asset_id, holders) for name, asset_id in request.inputs.items()}

    def _input(self, name: str, asset_id: str, owners: Sequence[str | AnyOwner]) -> Asset:
        """The asset of the first of these owners that has it; an error names the input that refers to it."""
        for owner in owners:
            with suppress(NotFound):
                return self._store.assets.get(asset_id, owner)
        raise NotFound(
            "Asset not found among those of the job's owner.",
            field=f"inputs.{name}",
            value=asset_id,
            remedy="Upload it first.",
        )

    def get(self, job_id: str) -> Job:
        """Raises NotFound."""
        return self._store.jobs.get(job_id)

    def ahead(self, job_id: str) -> list[MethodAhead]:
        """Jobs that are served before this one, by method, see `workers.store.queue_position`. Raises NotFound."""
        return self._store.jobs.ahead(job_id)

    def labelled(self, name: str, values: Collection[str]) -> set[str]:
        """Those of the values that jobs have as a label of this name."""
        return self._store.jobs.labelled(name, values)

    def by_state(self) -> dict[str, int]:
        """Number of jobs of all owners by state."""
        return self._store.statistics.jobs_by_state()

    def estimate(self, request: JobRequest, owner: str | AnyOwner) -> Estimate:
        """The cost of a job with assets of `owner`, from previews of its film, and from the newest finished jobs of its
        methods: read at most every `SAMPLES_S` seconds."""
        info = self._info(request, owner)
        return estimates.estimate(request, info, self._measured, self._previewed, self._slots)

    def _previewed(self, request: JobRequest) -> list[MeasuredPreview]:
        video = asset_key(request.inputs.get("video", ""))
        return self._previews.costs.of(request.method, video_key(video, request.source))

    def _info(self, request: JobRequest, owner: str | AnyOwner) -> Json | None:
        try:
            return self._store.assets.get(request.inputs["video"], owner).info
        except (KeyError, NotFound):
            return None

    def _measured(self, method: str) -> list[MeasuredJob]:
        def read() -> list[MeasuredJob]:
            finished = self._store.jobs.page(state="succeeded", method=method, limit=SAMPLES).items
            find = cache(self._store.assets.get)
            found = (measured(job, find) for job in finished)
            return [each for each in found if each is not None]

        return self._samples.get((method, time.monotonic() // SAMPLES_S), read)

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
            NotFound: its owner no longer has the asset of an input.
            QuotaExceeded: the owner has `max_active` other unfinished jobs.
        """
        known = self._store.jobs.get(job_id)
        self._inputs(known.request, known.owner)
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

    def command_many(self, job_ids: Collection[str], command: Command) -> Refused:
        """Cancel, pause, resume or delete several jobs in one transaction; returns those for which it was refused. The
        blobs of deleted jobs are deleted in the background."""
        if command == "delete":
            refused = self._store.bulk.remove(job_ids)
            for job_id in job_ids:
                if job_id not in refused:
                    self._collector.later(job_id)
            return refused
        events: dict[str, machine.Cancel | machine.Pause | machine.Resume] = {
            "cancel": machine.Cancel(), "pause": machine.Pause(), "resume": machine.Resume(),
        }  # fmt: skip
        refused = self._store.bulk.command(job_ids, events[command])
        self._wake()
        return refused

    def events(self, job_id: str, after: int = 0, limit: int = 500) -> tuple[Sequence[Event], bool]:
        """Events with seq > `after`, and whether some of these have been pruned (history is bounded)."""
        return self._store.events.list(job_id, after, limit)

    def wait_for_event(self, job_id: str, after: int, timeout_s: float) -> bool:
        """Block until the job has an event with seq > `after`; False on time-out."""
        return self._store.events.wait(job_id, after, timeout_s)

    def listening(self, job_id: str, on_news: Callable[[], None]) -> AbstractContextManager[None]:
        """Call `on_news`, in any thread, after each new event of the job, and its deletion, while the block runs."""
        return self._store.events.listening(job_id, on_news)

    def preview(
        self, request: JobRequest, owner: str | AnyOwner, frame: int, max_side_px: int = 640,
        documents: Mapping[str, Json] = MappingProxyType({}), artefacts_of: str | None = None, waiting: str = "",
    ) -> bytes:  # fmt: skip
        """One frame (scaled to fit) stylised with the request's parameters; PNG bytes.

        Args:
            owner: the owner of the inputs.
            documents: JSON documents by input, in place of the request's.
            artefacts_of: id of a finished job of the same method, whose artefacts the preview uses.
            waiting: the owner who waits for it; see `PreviewService`.
        """
        assets = self._inputs(request, owner)
        params = check_request(request, assets).params
        _check_documents(request.method, documents)
        artefacts = {} if artefacts_of is None else self._artefact_keys(artefacts_of, request.method)
        wanted = json.dumps(
            [
                request.method,
                params,
                request.seed,
                request.inputs,
                request.source.as_json(),
                frame,
                max_side_px,
                dict(documents),
                artefacts,
            ],
            sort_keys=True,
        )
        job = PreviewJob(request, assets, PreviewAsk(frame, max_side_px, documents, artefacts))
        return self._images.get(wanted, lambda: self._previews.frame(job, waiting))

    def _artefact_keys(self, job_id: str, chosen: str) -> dict[str, str]:
        """Blob keys of the artefacts that a job has made, by name."""
        files = {name: self._store.jobs.file(job_id, name) for name in method(chosen).artefacts}
        made = {name: str(row["key"]) for name, row in files.items() if row is not None}
        if not made:
            known = ", ".join(files) or "none"
            remedy = f"Name a finished job that was submitted with an artefact of the method {chosen!r}: {known}."
            raise NotFound("The job has made no artefact.", field="artefacts_of", value=job_id, remedy=remedy)
        return made


def _check_documents(chosen: str, documents: Mapping[str, Json]) -> None:
    """Raises BadParameter: the method has no such JSON input."""
    known = [spec.name for spec in method(chosen).inputs if spec.kind == "json"]
    for name in documents:
        if name not in known:
            remedy = f"Use one of: {', '.join(known) or 'none'}."
            message = f"The method {chosen!r} has no such JSON input."
            raise BadParameter(message, field=f"documents.{name}", value=name, remedy=remedy)
