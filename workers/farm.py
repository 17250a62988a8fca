"""`Farm`: assets, jobs and workers, as the service and the command line use them.

A farm joins a store (the database, source of truth), blobs (bytes), a pool (runs attempts) and a dispatcher (moves
tasks from the store to the pool). It is reached by noun: `farm.jobs`, `farm.assets`, `farm.tasks`, `farm.files`,
`farm.exports`, `farm.keys`, `farm.owners`, `farm.audit`, `farm.costs`, `farm.retention`, `farm.webhooks`,
`farm.workers`, `farm.live`, `farm.projects`, `farm.films`, `farm.comments`, `farm.previews`.
"""

from __future__ import annotations

import contextlib
import shutil
import socket
from collections.abc import Callable
from functools import partial

from pipeline.errors import ImpastoError
from pipeline.methods.base import PROCESS_BYTES
from pipeline.video.probe import probe_guarded
from workers.blobs.base import Blobs
from workers.blobs.open import open_blobs
from workers.contract.request import Json
from workers.execution.lru_cache import LruCache
from workers.extras import check_installed
from workers.farm_parts.assets import FarmAssets, Probe
from workers.farm_parts.exports import FarmExports
from workers.farm_parts.files import FarmFiles
from workers.farm_parts.health import HealthChecks
from workers.farm_parts.jobs import FarmJobs
from workers.farm_parts.retention import FarmRetention
from workers.farm_parts.tasks import FarmTasks
from workers.jobs.state_machine import Limits
from workers.live.local_workers import LocalLiveWorkers
from workers.live.renderer import LiveRenderer
from workers.live.sessions import LiveSessions
from workers.live.worker import LiveWorkers
from workers.operator_views import DrainScope, Violation, WorkerInfo
from workers.pools.base import Pool
from workers.pools.machine import THREADS_HERE, Machine, max_processes, this_machine
from workers.previews.local_runner import LocalRunner
from workers.previews.service import PreviewRunner, PreviewService
from workers.projects.films import FarmFilms
from workers.projects.projects import Projects
from workers.scheduling.dispatcher import Dispatcher
from workers.scheduling.garbage_collector import GarbageCollector
from workers.scheduling.process_lock import ProcessLock
from workers.settings import FarmSettings
from workers.store import Store, StorePolicy
from workers.store.projects import Retention
from workers.version import version

_CACHED_IMAGES = 128


class Farm:
    """Operations of the service and the command, by noun: `farm.jobs`, `farm.assets`, `farm.projects`, ...

    Args:
        settings: where data is stored, and limits.
        pool: runs attempts; None: this process accepts and shows jobs only.
        live_workers: render live sessions; None: threads of this process.
        probe: examines uploaded files; by default in a child process, because they are untrusted.
        preview_runner: makes previews; None: threads of this process.
        private: the farm of one command, whose folder is deleted after its job. It clears nothing up, and after a power
            cut tasks that had just ended may run again.

    Attributes:
        store: the database: jobs, tasks and their states. Prefer the nouns below.
        blobs: files of assets, tasks and results, by key.

    Raises:
        StorageError: the database or the blob store cannot be used.
    """

    def __init__(
        self,
        settings: FarmSettings,
        pool: Pool | None,
        live_workers: LiveWorkers | None = None,
        probe: Probe = probe_guarded,
        preview_runner: PreviewRunner | None = None,
        private: bool = False,
    ) -> None:
        limits = Limits(settings.attempts, settings.interruptions)
        policy = StorePolicy(
            limits, settings.retry_delay_s, settings.events_kept, settings.owner_tasks, durable=not private
        )
        images: LruCache[bytes] = LruCache(_CACHED_IMAGES)
        self._settings, self._pool, self._private = settings, pool, private
        self.store, self.blobs = Store(settings.url, policy), open_blobs(settings)
        self._collector = GarbageCollector(
            self.store,
            self.blobs,
            settings.sweep_s,
            self._may_sweep,
            settings.project_undo_s,
            Retention(settings.project_versions_s),
            settings.reuse_s,
            settings.records_s,
        )
        self._dispatcher = None if pool is None else self._make_dispatcher(pool)
        self.assets = FarmAssets(self.store, self.blobs, probe, settings.limits, images)
        runner = preview_runner or LocalRunner(self.blobs, settings.preview_bytes)
        self.previews = PreviewService(runner, settings.preview_threads)
        self.jobs = FarmJobs(
            self.store, self.blobs, self._collector, self._wake, images, self.previews, settings.most_workers
        )
        self.tasks = FarmTasks(self.store, self._wake)
        self.files = FarmFiles(self.store, self.blobs, settings.s3_direct)
        self.exports = FarmExports(self.jobs, self.assets, self.files)
        self.retention = FarmRetention(self.store, self.jobs, self.exports)
        self._collector.apply_rules = self.retention.apply
        self.projects = Projects(
            self.store.projects, self.assets, self.jobs, self.files, self.store.reuse, settings.reuse_s
        )  # fmt: skip
        self.films = FarmFilms(self.projects, self.assets, self.files, settings.scratch)
        self.comments = self.store.comments
        self.keys, self.webhooks, self.workers = self.store.keys, self.store.webhooks, self.store.workers
        self.owners, self.audit, self.costs = self.store.owners, self.store.audit, self.store.costs
        self.live = LiveSessions(live_workers or LocalLiveWorkers(lambda: LiveRenderer(self.blobs)), settings)
        self._health = HealthChecks(self._parts())

    def _make_dispatcher(self, pool: Pool) -> Dispatcher:
        who = WorkerInfo(socket.gethostname(), self._settings.role, str(pool.describe()["kind"]), version())
        collect = (lambda job_id: None) if self._private else self._collector.later
        return Dispatcher(self.store, pool, self._settings, self.blobs.check_free_space, collect, who)

    def _parts(self) -> dict[str, Callable[[], None]]:
        parts = {"store": self.store.check, "blobs": self.blobs.check}
        return parts if self._dispatcher is None else {**parts, "pool": self._dispatcher.check}

    def _may_sweep(self) -> bool:
        """Whether this process sweeps: of all processes that share the store, the longest-running dispatcher does."""
        return self.store.queue.dispatchers()[:1] == [self.worker_id]

    def _wake(self) -> None:
        if self._dispatcher is not None:
            self._dispatcher.wake()

    @property
    def worker_id(self) -> str:
        """The id of this process among `farm.workers`; empty if it has no pool."""
        return "" if self._dispatcher is None else self._dispatcher.id

    def start(self) -> None:
        """Begin to run tasks and live sessions. With Ray: on the main thread."""
        if self._dispatcher is None:
            return
        lock = ProcessLock(self._settings.home / "dispatchers")
        if lock.alone():  # scratch files are leftovers of a crash
            shutil.rmtree(self._settings.scratch, ignore_errors=True)
        try:
            self._dispatcher.start(lock)
        except BaseException:
            lock.end()
            raise
        if not self._private:
            self._collector.start()
        self.live.start()
        self.previews.start_runner()

    def drain(self, timeout_s: float) -> bool:
        """Take no new task and let running attempts end; whether all ended within `timeout_s`. Call `stop` then."""
        if self._dispatcher is None:
            return True
        with contextlib.suppress(ImpastoError):  # shown to operators; draining itself needs no store
            self.workers.drain(DrainScope.WORKER, self.worker_id, reason="It was asked to stop.")
        return self._dispatcher.drain(timeout_s)

    def stop(self) -> None:
        """Return running tasks to the queue and end."""
        self.live.stop()
        self.previews.close()  # its actors, before the dispatcher ends the connection to Ray
        if self._dispatcher is not None:
            self._dispatcher.stop()
        self._collector.stop()
        self.films.close()
        self.assets.close()
        self.files.close()
        self.store.close()

    def ready(self) -> dict[str, str]:
        """Part ("store", "blobs", "pool") -> "ok" or its error."""
        return self._health.verdicts()

    def validate_state(self) -> list[Violation]:
        """Violated invariants of the database, empty if there are none. Read-only and of bounded cost."""
        return self.store.validation.validate_state()

    def snapshot(self) -> Json:
        """Figures for metrics: queue depth and age, tasks by state, workers, throughput. "totals": counts of this
        process since it began (attempts by outcome, failures by code, frames and busy seconds by method)."""
        pool = {"kind": "none", "workers": 0, "busy": {}} if self._pool is None else self._pool.describe()
        return {**self.store.statistics.snapshot(), "pool": pool}


def open_farm(settings: FarmSettings, *, private: bool = False) -> Farm:
    """The farm of these settings; call `start` to let it work. With Ray: on the main thread.

    Args:
        private: see `Farm`; its jobs get no previews, poster and contact sheet, either.

    Raises:
        StorageError: the database or the blob store cannot be used.
        BadParameter: a setting needs an extra of the package that is not installed.
    """
    check_installed(settings)
    blobs = open_blobs(settings)
    machine = None if settings.workers else this_machine()
    pool, live_workers = _pool(settings, blobs, machine, private), _live_workers(settings, blobs)
    farm = Farm(settings, pool, live_workers, preview_runner=_preview_runner(settings, blobs), private=private)
    if machine is not None:
        machine.live_sessions = lambda: farm.live.sessions
    return farm


def _pool(settings: FarmSettings, blobs: Blobs, machine: Machine | None, private: bool) -> Pool | None:
    if settings.pool == "none":
        return None
    if settings.pool == "ray":
        from workers.pools.ray_pool import RayPool

        return RayPool(blobs, settings)
    from workers.execution.artefact_handover import ArtefactHandover
    from workers.execution.decoders import IDLE, Decoders
    from workers.execution.renderer import Renderer, Shared, prepare_process
    from workers.execution.warm_up import warm_up_process
    from workers.pools.child_main import child_renderer
    from workers.pools.child_runner import ChildRunner
    from workers.pools.local_pool import LocalPool

    threads = THREADS_HERE if private else 0
    workers = settings.workers or max_processes(settings.most_workers, this_machine().memory_bytes, threads)
    if machine is not None:
        machine.memory_bytes = max(0, machine.memory_bytes - max(0, workers - threads) * PROCESS_BYTES)
    decoders = Decoders(blobs, idle=IDLE * threads)
    shared = Shared(decoders, ArtefactHandover())
    in_child = partial(child_renderer, settings.for_workers, blobs, overview=not private, one_job=private)

    def runner(number: int) -> Renderer | ChildRunner:
        if number < threads:
            return Renderer(blobs, settings.scratch, overview=not private, shared=shared)
        return ChildRunner(in_child)

    def warm_up(stopped: Callable[[], bool]) -> None:  # this process, for previews and live sessions
        prepare_process()
        warm_up_process(stopped)

    return LocalPool(
        runner, workers, machine, settings.task_memory_bytes, close=decoders.close,
        warm_up=warm_up if settings.warm_up else None,
    )  # fmt: skip


def _live_workers(settings: FarmSettings, blobs: Blobs) -> LiveWorkers | None:
    """Live workers. On a Ray cluster every live session has a separate process."""
    if settings.pool != "ray":
        return None
    from workers.live.ray_workers import RayLiveWorkers

    return RayLiveWorkers(blobs, settings.live_spares)


def _preview_runner(settings: FarmSettings, blobs: Blobs) -> PreviewRunner | None:
    """Runner of previews. On a Ray cluster, previews run in separate processes."""
    if settings.pool != "ray":
        return None
    from workers.previews.ray_runner import PreviewActors, RayRunner

    actors = PreviewActors(
        settings.preview_actors, settings.preview_bytes, settings.preview_threads, settings.preview_idle_s,
        settings.warm_up,
    )  # fmt: skip
    return RayRunner(blobs, actors)
