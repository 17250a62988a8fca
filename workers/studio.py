"""The farm itself: a store (the truth), blobs and a pool (the muscle), tied together by a dispatcher."""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import shutil
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

from pipeline.errors import ImpastoError, StorageError
from pipeline.video.probe import probe_guarded
from workers import jobs as machine
from workers.about import about
from workers.blobs.base import Blobs
from workers.blobs.opened import open_blobs
from workers.checks import Checks
from workers.dispatcher import Dispatcher
from workers.errors import Conflict, NotFound
from workers.farm import Farm, Keys, Page, Served, Webhooks
from workers.fleet import Enrolment, Fleet, Place
from workers.jobs import Limits
from workers.life import Life
from workers.live.live import Live
from workers.live.local_seats import LocalSeats
from workers.live.painter import LivePainter
from workers.live.seats import Seats
from workers.model import Asset, Event, Job, JobRequest, Json, Submitted, TaskView
from workers.orders import asset_key
from workers.originals import Originals
from workers.pool import Pool
from workers.preview import PreviewAsk, Previews
from workers.recent import Recent
from workers.requests import check_request
from workers.served import served_asset, served_file
from workers.settings import FarmSettings
from workers.store import Policy, Store
from workers.tidy import Tidier
from workers.versions import version

log = logging.getLogger(__name__)

_CHUNK = 1 << 20
_PICTURES_KEPT = 128


class Studio:
    """Implements `Farm` over a store, blobs and a pool.

    Args:
        settings: where things are kept, and limits.
        pool: what runs attempts; None accepts and shows only.
        seats: where live sessions are painted; None: on threads of this process.

    Raises:
        StorageError: the database or the folder of blobs cannot be used.
    """

    def __init__(self, settings: FarmSettings, pool: Pool | None, seats: Seats | None = None) -> None:
        limits = Limits(settings.attempts, settings.interruptions)
        policy = Policy(limits, settings.retry_delay_s, settings.events_kept, settings.owner_tasks)
        self._settings = settings
        self._store = Store(settings.url, policy)
        self._blobs = open_blobs(settings)
        self._pool = pool
        self._tidier = Tidier(self._store, self._blobs, settings.sweep_s, self._may_sweep)
        self._dispatcher = None if pool is None else self._make_dispatcher(pool)
        self._previews = Previews(self._blobs)
        self._originals = Originals(self._blobs)
        self._pictures: Recent[bytes] = Recent(_PICTURES_KEPT)
        self._live = Live(seats or LocalSeats(lambda: LivePainter(self._blobs)), settings)
        self._checks = Checks(self._parts())

    def _make_dispatcher(self, pool: Pool) -> Dispatcher:
        who = Enrolment(socket.gethostname(), self._settings.role, str(pool.describe()["kind"]), version())
        return Dispatcher(self._store, pool, self._settings, self._blobs.check_room, self._tidier.later, who)

    def _parts(self) -> dict[str, Callable[[], None]]:
        parts = {"store": self._store.check, "blobs": self._blobs.check}
        return parts if self._dispatcher is None else {**parts, "pool": self._dispatcher.check}

    def _may_sweep(self) -> bool:
        """Of all that share the store, the dispatcher that is alive the longest sweeps."""
        mine = "" if self._dispatcher is None else self._dispatcher.id
        return self._store.work.dispatchers()[:1] == [mine]

    @property
    def keys(self) -> Keys:
        return self._store.keys

    @property
    def webhooks(self) -> Webhooks:
        return self._store.webhooks

    @property
    def fleet(self) -> Fleet:
        return self._store.fleet

    @property
    def worker_id(self) -> str:
        return "" if self._dispatcher is None else self._dispatcher.id

    @property
    def live(self) -> Live:
        return self._live

    # -- life

    def start(self) -> None:
        if self._dispatcher is None:
            return
        life = Life(self._settings.home / "dispatchers")
        if life.alone():  # what is in there was left by a crash
            shutil.rmtree(self._settings.scratch, ignore_errors=True)
        try:
            self._dispatcher.start(life)
        except BaseException:
            life.end()
            raise
        self._tidier.start()
        self._live.start()

    def drain(self, timeout_s: float) -> bool:
        if self._dispatcher is None:
            return True
        with contextlib.suppress(ImpastoError):  # for operators to see; what follows needs no store
            self._store.fleet.drain(Place.WORKER, self.worker_id, reason="It was asked to stop.")
        return self._dispatcher.drain(timeout_s)

    def stop(self) -> None:
        self._live.stop()
        if self._dispatcher is not None:
            self._dispatcher.stop()
        self._tidier.stop()
        self._previews.close()
        self._originals.close()
        self._store.close()

    # -- assets

    def add_asset(self, path: Path, filename: str, owner: str = "") -> Asset:
        self._blobs.check_room(path.stat().st_size)
        info = probe_guarded(path, self._settings.limits)
        sha256 = _sha256(path)
        asset = Asset(
            id=f"ast_{sha256}",
            sha256=sha256,
            size_bytes=path.stat().st_size,
            filename=filename,
            media_type=info.media_type,
            kind=info.kind,
            info=info.as_json(),
            created_at=time.time(),
            owner=owner,
        )
        return self._keep(asset, path)

    def _keep(self, asset: Asset, path: Path) -> Asset:
        key = asset_key(asset.id)
        while True:
            if self._blobs.size(key) is None:
                self._blobs.put(key, path)
            if kept := self._store.assets.add(asset, lambda: self._blobs.size(key) is not None):
                return kept

    def asset(self, asset_id: str, owner: str | None = None) -> Asset:
        return self._store.assets.get(asset_id, owner)

    def assets(self, owner: str | None = None, cursor: str | None = None, limit: int = 50) -> Page:
        return self._store.assets.page(owner, cursor, limit)

    def delete_asset(self, asset_id: str, owner: str | None = None) -> None:
        if self._store.assets.remove(asset_id, owner):
            self._store.assets.unless_known(asset_id, lambda: self._blobs.delete(asset_key(asset_id)))

    def asset_file(self, asset_id: str) -> Served:
        return served_asset(self.asset(asset_id))

    def asset_frame(self, asset_id: str, index: int, max_side_px: int = 720) -> bytes:
        asset = self.asset(asset_id)
        try:
            return self._pictures.get(
                (asset_id, index, max_side_px), lambda: self._originals.jpeg(asset, index, max_side_px)
            )
        except KeyError:
            raise NotFound("The asset has been deleted.", field="asset_id", value=asset_id) from None

    # -- jobs

    def submit(
        self,
        request: JobRequest,
        owner: str = "",
        idempotency_key: str = "",
        admit: Callable[[], None] = lambda: None,
    ) -> Submitted:
        if known := self._store.jobs.made_by(request, owner, idempotency_key):
            return known
        admit()
        accepted = check_request(request, self._inputs(request))
        self._blobs.check_room()
        job = self._store.jobs.add(accepted, owner, idempotency_key)
        log.info("job accepted", extra=about(job=job.id, owner=owner, method=request.method))
        self._poke()
        return job

    def _inputs(self, request: JobRequest) -> dict[str, Asset]:
        return {name: self._input(name, asset_id) for name, asset_id in request.inputs.items()}

    def _input(self, name: str, asset_id: str) -> Asset:
        """The asset, with an error that names the input it was meant for."""
        try:
            return self.asset(asset_id)
        except NotFound as error:
            raise NotFound(error.message, field=f"inputs.{name}", value=error.value, remedy=error.remedy) from None

    def job(self, job_id: str) -> Job:
        return self._store.jobs.get(job_id)

    def jobs(
        self,
        state: str | None = None,
        method: str | None = None,
        owner: str | None = None,
        label: tuple[str, str] | None = None,
        cursor: str | None = None,
        limit: int = 50,
    ) -> Page:
        return self._store.jobs.page(state, method, owner, label, cursor, limit)

    def cancel(self, job_id: str) -> Job:
        return self._command(job_id, machine.Cancel())

    def pause(self, job_id: str) -> Job:
        return self._command(job_id, machine.Pause())

    def resume(self, job_id: str) -> Job:
        return self._command(job_id, machine.Resume())

    def _command(self, job_id: str, event: machine.Cancel | machine.Pause | machine.Resume) -> Job:
        job = self._store.jobs.command(job_id, event)
        self._poke()
        return job

    def retry(self, job_id: str) -> Job:
        job = self._store.jobs.retry(job_id)
        self._poke()
        return job

    def delete(self, job_id: str) -> None:
        self._store.jobs.remove(job_id)
        try:
            self._tidier.job(job_id)
        except StorageError:  # it is forgotten all the same; its blobs go once the store is back
            self._tidier.later(job_id)

    def tasks(self, job_id: str, state: str | None = None, cursor: str | None = None, limit: int = 100) -> Page:
        return self._store.history.tasks(job_id, state, cursor, limit)

    def task(self, task_id: str) -> TaskView:
        return self._store.history.task(task_id)

    def task_log(self, task_id: str) -> str:
        return self._store.history.log(task_id)

    def requeue(self, task_id: str) -> TaskView:
        self._store.jobs.requeue(task_id)
        self._poke()
        return self.task(task_id)

    def events(self, job_id: str, after: int = 0, limit: int = 500) -> tuple[list[Event], bool]:
        return self._store.history.events(job_id, after, limit)

    def wait(self, job_id: str, after: int, timeout_s: float) -> bool:
        return self._store.history.wait(job_id, after, timeout_s)

    # -- files

    def file(self, job_id: str, name: str) -> Served:
        job = self.job(job_id)
        row = self._store.jobs.file(job_id, name)
        if row is not None:
            return served_file(job, row, self._blobs.size(row["key"]) or 0)
        if job.state.final:
            raise NotFound(f"The job has no file {name!r}.", field="name", value=name, remedy=_have(job))
        raise Conflict(f"The file {name!r} is not there yet.", field="name", value=name, remedy="Wait for the job.")

    def read(self, served: Served, start: int = 0, stop: int | None = None) -> Iterator[bytes]:
        try:
            return self._blobs.read(served.key, start, stop, _CHUNK)
        except KeyError:
            raise NotFound("The file has been deleted.", field="file", value=served.filename) from None

    def local(self, served: Served) -> AbstractContextManager[Path]:
        return self._blobs.local(served.key)

    def direct_url(self, served: Served) -> str | None:
        direct = self._blobs.direct
        if direct is None or not self._settings.s3_direct:
            return None
        return direct.download_url(served.key, served.filename, served.media_type)

    def preview(
        self, request: JobRequest, frame: int, max_side_px: int = 640, design: Json | None = None,
        regions_of: str | None = None,
    ) -> bytes:  # fmt: skip
        assets = self._inputs(request)
        params = check_request(request, assets).params
        key = None if regions_of is None else self.file(regions_of, "regions").key
        wanted = json.dumps(
            [request.method, params, request.seed, request.inputs, frame, max_side_px, design, key], sort_keys=True
        )
        ask = PreviewAsk(frame, max_side_px, design, key)
        return self._pictures.get(wanted, lambda: self._previews.png(request, assets, ask))

    # -- operators

    def ready(self) -> dict[str, str]:
        return self._checks.verdicts()

    def snapshot(self) -> Json:
        pool = {"kind": "none", "workers": 0, "busy": {}} if self._pool is None else self._pool.describe()
        return {**self._store.overview.snapshot(), "pool": pool}

    def _poke(self) -> None:
        if self._dispatcher is not None:
            self._dispatcher.poke()


def open_farm(settings: FarmSettings) -> Farm:
    """The farm of these settings; call `start` to let it work. With Ray: on the main thread.

    Raises:
        StorageError: the database or the blobs cannot be used.
    """
    blobs = open_blobs(settings)
    return Studio(settings, _pool(settings, blobs), _seats(settings, blobs))


def _pool(settings: FarmSettings, blobs: Blobs) -> Pool | None:
    if settings.pool == "none":
        return None
    if settings.pool == "ray":
        from workers.ray_pool import RayPool

        return RayPool(blobs, settings)
    from workers.local_pool import LocalPool
    from workers.render import Renderer

    return LocalPool(lambda: Renderer(blobs, settings.scratch), settings.workers)


def _seats(settings: FarmSettings, blobs: Blobs) -> Seats | None:
    """With Ray, live sessions have processes of their own."""
    if settings.pool != "ray":
        return None
    from workers.ray_seats import RaySeats

    return RaySeats(blobs, settings.live_spares)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _have(job: Job) -> str:
    return f"There are: {', '.join(job.results)}." if job.results else "It has no files."
