"""The dispatcher: one thread that plans steps, claims tasks for its pool, and brings their outcomes into the store.

It keeps nothing that matters: kill it at any instant and its successor goes on from what the store says. When the
store or the blobs are away it waits, longer each time, and loses no outcome meanwhile.
"""

from __future__ import annotations

import logging
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

from pipeline.errors import ImpastoError, StorageError
from workers import state_machine as machine
from workers.faults import failed_outcome, fault_from, is_final, is_resource_away
from workers.frame_window import window_inputs
from workers.log_context import about
from workers.model import Fault, TaskOutcome
from workers.operations import DrainScope, Slot, WorkerInfo
from workers.pools.base import Pool, Report
from workers.scheduling.flights import Flight, facts_of, log_end, lost_outcome, stalled_outcome
from workers.scheduling.orders import Orders
from workers.scheduling.planning import plan_step
from workers.scheduling.process_lock import ProcessLock
from workers.settings import FarmSettings
from workers.store import Claim, ClaimFailed, Heartbeat, StepToPlan, Store

log = logging.getLogger(__name__)

_BUSY_TICK_S = 0.4
"""While something runs: how often progress is written and cancelled attempts are looked for."""
_PACES = ((4.0, 1), (30.0, 3), (float("inf"), 6))
"""So long after a rest, progress is written at every tick, then at every third, then every sixth: nobody watches each
step of long work, and to write it and have it read would cost a fast method percents of its time."""
_IDLE_TICK_S = 1.0
"""How soon work that another process has accepted is seen."""
_FULL_TICK_S = 5.0
"""The same while there is no place for it."""
_LOOK_TICKS = 3
"""So many ticks lie at most between two looks for attempts that another process has cancelled."""
_MAX_BACK_OFF_S = 15.0
_RESOURCE_AWAY_S = 3.0
"""Wait of a task that met an absent store, a full disk or exhausted descriptors."""
_PLANS_AT_ONCE = 4
_SKIP_S = 60.0
"""A step whose plan can neither be stored nor recorded as failed is not tried again for this long."""


class Dispatcher:
    """Runs the jobs of a store on a pool.

    Args:
        store: the truth.
        pool: started and stopped by this.
        settings: capacity, leases, limits.
        has_room: raises StorageFull when nothing new should begin.
        tidy: told of a job (its id) that succeeded or was deleted: blobs are needed no more. Quick.
        who: how operators know it.
    """

    def __init__(
        self,
        store: Store,
        pool: Pool,
        settings: FarmSettings,
        check_space: Callable[[], None] = lambda: None,
        collect: Callable[[str], None] = lambda job_id: None,
        who: WorkerInfo | None = None,
    ) -> None:
        self._store = store
        self._pool = pool
        self._who = who or WorkerInfo(socket.gethostname(), "serve", "local", "")
        self._settings = settings
        self._check_space = check_space
        self._collect = collect
        self._orders = Orders(store, pool.shares_memory)
        self._flights: dict[str, Flight] = {}
        self._skipped: dict[str, float] = {}
        """Job id -> monotonic time until which it is neither planned nor claimed from: something is wrong with it."""
        self._reports: deque[Report] = deque()
        self._aside: deque[tuple[float, Flight, Report]] = deque()
        """Reports that could not be handled, and when each is tried again, monotonic s."""
        self._wake = threading.Event()
        self._stopping = False
        self._draining = False
        self._slots: tuple[Slot, ...] | None = None
        """Those that the store knows."""
        self._running_parts = (
            self._handle_reports, self._keep_leases, self._enrol, self._write_progress, self._revoke,
        )  # fmt: skip
        """What looks after running attempts in each turn. Repeatable: an exception in the middle loses nothing."""
        self._thread = threading.Thread(target=self._run, name="impasto-dispatcher", daemon=True)
        self._process_lock: ProcessLock | None = None
        self._last_renewal = self._progress_written = self._last_look = self._last_idle = float("-inf")
        self._last_turn = time.monotonic()
        self.trouble = ""
        """What keeps it from working now; empty if nothing does."""

    # -- life

    def start(self, process_lock: ProcessLock) -> None:
        """Take up what earlier lives have left, and begin. `stop` ends `process_lock`."""
        self._pool.start(self._receive)
        self._process_lock = process_lock
        self._last_turn = self._last_idle = time.monotonic()
        self._thread.start()

    def stop(self, grace_s: float = 5.0) -> None:
        """Ask running attempts to stop, give their tasks back, and end."""
        if self._process_lock is None:
            return
        self._stopping = True
        self._wake.set()
        self._thread.join(grace_s + _MAX_BACK_OFF_S)
        self._pool.stop(grace_s)
        self._leave()
        self._process_lock.end()
        self._process_lock = None

    def drain(self, timeout_s: float) -> bool:
        """Take nothing new, and let what runs end; whether all of it did within `timeout_s`. Call `stop` then."""
        self._draining = True
        deadline = time.monotonic() + timeout_s
        while self._flights and time.monotonic() < deadline:
            time.sleep(0.05)
        return not self._flights

    def poke(self) -> None:
        """Something in the store has changed: look now."""
        self._last_look = float("-inf")
        self._wake.set()

    def check(self) -> None:
        """Raise StorageError with what keeps it from working, or if its thread hangs or has died."""
        silent_s = time.monotonic() - self._last_turn
        if not self._thread.is_alive() or silent_s > 4 * _MAX_BACK_OFF_S:
            raise StorageError(f"The dispatcher has been silent for {silent_s:.0f} s.", remedy="Restart the service.")
        if trouble := self.trouble or str(self._pool.describe().get("lacking", "")):
            raise StorageError(trouble)

    @property
    def id(self) -> str:
        """As the store knows it; empty unless it is started."""
        return "" if self._process_lock is None else self._process_lock.id

    @property
    def running(self) -> int:
        """Attempts that are with the pool."""
        return len(self._flights)

    # -- the thread

    def _run(self) -> None:
        back_off, woken, searched = 0.0, True, float("-inf")
        while not self._stopping:
            self._wake.clear()
            self._last_turn = time.monotonic()
            try:
                parts: list[Callable[[], None]] = [*self._running_parts]
                rest_s = _IDLE_TICK_S if self._has_free_slot() else _FULL_TICK_S
                if woken or back_off or self._last_turn - searched >= rest_s:
                    parts += [self._plan, self._fill]
                    searched = self._last_turn
                run_each(parts)
                back_off, self.trouble = 0.0, ""
            except Exception as error:
                back_off = min(_MAX_BACK_OFF_S, max(0.5, 2 * back_off))
                self._record_outage(error)
            woken = self._wake.wait(back_off or (_BUSY_TICK_S if self._flights else _IDLE_TICK_S))
            if not (woken or self._flights):
                self._last_idle = time.monotonic()

    def _record_outage(self, error: Exception) -> None:
        self.trouble = str(error) or type(error).__name__
        if isinstance(error, StorageError):
            log.warning("dispatcher waits: %s", error)
        else:
            log.exception("dispatcher failed; it tries again")

    # -- reports from the pool

    def _receive(self, report: Report) -> None:
        """Called from any thread."""
        self._reports.append(report)
        if report.outcome is not None or report.lost:
            self._wake.set()

    def _handle_reports(self) -> None:
        """Handle the reports in order. One that cannot be handled is set aside for a while, so that it neither blocks
        the others nor occupies a slot."""
        self._bring_back()
        while self._reports:
            try:
                self._take(self._reports[0])
            except StorageError:
                raise
            except Exception:
                log.exception("a report cannot be handled; it is set aside for %.0f s", _SKIP_S)
                self._set_aside(self._reports[0])
            self._reports.popleft()

    def _set_aside(self, report: Report) -> None:
        flight = self._flights.pop(report.attempt_id, None)
        if flight is not None:
            self._aside.append((time.monotonic() + _SKIP_S, flight, report))

    def _bring_back(self) -> None:
        """Try reports again that were set aside long enough ago."""
        while self._aside and self._aside[0][0] <= time.monotonic():
            _, flight, report = self._aside.popleft()
            self._flights[report.attempt_id] = flight
            self._reports.append(report)

    def _take(self, report: Report) -> None:
        flight = self._flights.get(report.attempt_id)
        if flight is None:
            return  # given up already; the store would refuse it, too
        flight.last_report_s = time.monotonic()
        if report.worker and report.worker != flight.worker:
            flight.worker, flight.reported = report.worker, False
        if report.lost:
            self._settle(report.attempt_id, flight, lost_outcome(report))
        elif report.outcome is not None:
            self._settle(report.attempt_id, flight, report.outcome)
        elif (report.progress, report.preview or flight.preview) != (flight.progress, flight.preview):
            flight.progress, flight.preview = report.progress, report.preview or flight.preview
            flight.reported = False

    def _settle(self, attempt_id: str, flight: Flight, outcome: TaskOutcome) -> None:
        """Write an outcome to the store. The attempt is forgotten here only after that has succeeded.

        An outcome that cannot be written (a NaN, an object that is not JSON) fails its attempt; if even that cannot be
        written, the attempt is given back. So one outcome never delays the others.
        """
        try:
            counted = self._commit(outcome, flight.worker)
        except StorageError:
            raise
        except Exception as error:
            log.exception("the outcome cannot be stored", extra=facts_of(attempt_id, flight))
            counted = self._commit_unstorable(attempt_id, flight, error)
        self._flights.pop(attempt_id, None)
        log_end(attempt_id, flight, outcome, counted)
        jobs = self._store.jobs
        over = jobs.succeeded(flight.job_id) if counted and flight.last_step else not jobs.exists(flight.job_id)
        if over:
            self._collect(flight.job_id)

    def _commit_unstorable(self, attempt_id: str, flight: Flight, error: Exception) -> bool:
        try:
            return self._commit(failed_outcome(attempt_id, error), flight.worker)
        except StorageError:
            raise
        except Exception:
            log.exception("the failure cannot be stored either", extra=facts_of(attempt_id, flight))
            return self._store.queue.put_off(attempt_id, _SKIP_S, "The outcome could not be stored.")

    def _commit(self, outcome: TaskOutcome, worker: str) -> bool:
        work, fault = self._store.queue, outcome.fault
        if outcome.cancelled and self._stopping:
            return work.put_off(outcome.attempt_id, 0.0, outcome.log)
        if outcome.cancelled:  # an attempt that nobody stopped is at fault; that of a cancelled job is fenced
            fault = fault or Fault("cancelled", "The task stopped by itself.", "See the log of the task.")
        if fault is None:
            return work.finish(outcome, worker=worker)
        if is_resource_away(fault):
            return work.put_off(outcome.attempt_id, _RESOURCE_AWAY_S, outcome.log)
        return work.finish(outcome, machine.Failed(fault, is_final(fault)), worker)

    def _write_progress(self) -> None:
        news = {attempt_id: flight for attempt_id, flight in self._flights.items() if not flight.reported}
        now = time.monotonic()
        if not news or now - self._progress_written < _BUSY_TICK_S * self._pace():
            return
        self._progress_written = now
        heartbeats = {name: Heartbeat(flight.progress, flight.worker, flight.preview) for name, flight in news.items()}
        try:
            self._store.queue.progress(heartbeats)
        except StorageError:
            raise
        except Exception:  # the next report of each attempt is written again
            log.exception("progress cannot be written")
        for flight in news.values():
            flight.reported = True

    def _pace(self) -> int:
        """Ticks from one look at what runs to the next."""
        worked_s = time.monotonic() - self._last_idle
        return next(ticks for until_s, ticks in _PACES if worked_s < until_s)

    # -- leases, revocations, silence

    def _keep_leases(self) -> None:
        assert self._process_lock is not None
        lease_s = self._settings.lease_s
        if time.monotonic() - self._last_renewal < lease_s / 3:
            return
        self._store.queue.renew(self._process_lock.id, lease_s)
        dead = self._process_lock.dead()
        if given_back := self._store.queue.interrupt(dead):
            log.info("%d attempts of dead dispatchers were given back", given_back)
        self._process_lock.forget(dead)
        self._last_renewal = time.monotonic()

    def _enrol(self) -> None:
        """Let operators know of our slots."""
        if (slots := self._pool.slots()) != self._slots:
            self._store.workers.enrol(self.id, self._who, slots)
            self._slots = slots

    def _revoke(self) -> None:
        """Tell the pool of attempts that no longer count (their job was cancelled), and of silent ones."""
        assert self._process_lock is not None
        now = time.monotonic()
        if not self._flights or now - self._last_look < _BUSY_TICK_S * min(self._pace(), _LOOK_TICKS):
            return
        mine = self._store.queue.mine(self._process_lock.id)
        self._last_look = now
        for attempt_id, flight in list(self._flights.items()):
            if attempt_id not in mine and not flight.revoked:
                flight.revoked = True
                self._pool.cancel(attempt_id)
            if now - flight.last_report_s > self._settings.stall_s:
                self._receive(Report(attempt_id, outcome=stalled_outcome(attempt_id, self._settings.stall_s)))
                self._pool.abandon(attempt_id)

    # -- new work

    def _plan(self) -> None:
        self._forget_skipped()
        for todo in self._store.plans.to_plan(_PLANS_AT_ONCE + len(self._skipped)):
            if todo.job_id not in self._skipped:
                self._plan_one(todo)

    def _skip(self, job_id: str) -> None:
        self._skipped[job_id] = time.monotonic() + _SKIP_S

    def _forget_skipped(self) -> None:
        now = time.monotonic()
        self._skipped = {job_id: until for job_id, until in self._skipped.items() if until > now}

    def _plan_one(self, todo: StepToPlan) -> None:
        """Plan a step and store its tasks. Whatever goes wrong fails this job only; if that cannot be recorded, the job
        is skipped for a while. An absent store is raised, because it concerns every job."""
        try:
            self._plan_and_store(todo)
        except StorageError:
            raise
        except Exception as error:
            log.warning("planning failed: %s", error, extra=about(job=todo.job_id), exc_info=not _is_ours(error))
            self._record_plan_failure(todo, error)
        self._wake.set()  # an empty step ends at once, and the next one needs a plan

    def _record_plan_failure(self, todo: StepToPlan, error: Exception) -> None:
        try:
            self._store.plans.plan_failed(todo.job_id, todo.step, fault_from(error))
        except StorageError:
            raise
        except Exception:
            log.exception("a failed plan cannot be recorded; the job is skipped", extra=about(job=todo.job_id))
            self._skip(todo.job_id)

    def _plan_and_store(self, todo: StepToPlan) -> None:
        plans, inputs, request = self._store.plans, self._store.task_inputs, todo.request
        results, _ = inputs.before(todo.job_id, todo.step)
        info = window_inputs(inputs.input_info(request.inputs), request.frames)
        plans.planned(todo.job_id, todo.step, plan_step(todo.step, request, todo.params, info, results))

    def _fill(self) -> None:
        assert self._process_lock is not None
        self._pool.drain([drain.name for drain in self._store.workers.drains() if drain.place is DrainScope.NODE])
        while self._has_free_slot() and not (self._stopping or self._draining):
            self._check_space()
            try:
                claim = self._store.queue.claim(self._process_lock.id, self._settings.lease_s, self._skipped)
            except ClaimFailed as error:
                log.exception("no task of the job can be claimed; it is skipped", extra=about(job=error.job_id))
                self._skip(error.job_id)
                continue
            if claim is None:
                return
            last = claim.step_name == machine.ASSEMBLE
            flight = Flight(time.monotonic(), claim.job_id, str(claim.task["id"]), last)
            self._flights[claim.attempt_id] = flight
            log.info("attempt begins", extra=facts_of(claim.attempt_id, flight, step=claim.step_name))
            self._send(claim)

    def _has_free_slot(self) -> bool:
        """An order that cannot be made out takes no place in the pool, and would let us claim without end."""
        return len(self._flights) < self._pool.capacity and self._pool.free > 0

    def _send(self, claim: Claim) -> None:
        """Hand a claimed task to the pool. Whatever goes wrong is the attempt's outcome, so that its slot is free."""
        try:
            self._pool.submit(self._orders.order(claim))
        except Exception as error:
            if not _is_ours(error):
                log.exception("an order failed", extra=about(job=claim.job_id))
            self._receive(Report(claim.attempt_id, outcome=failed_outcome(claim.attempt_id, error)))

    def _leave(self) -> None:
        """Give back what did not end in time."""
        try:
            self._handle_reports()
            for attempt_id in list(self._flights):
                self._store.queue.put_off(attempt_id, 0.0, "The service was stopped.")
            self._store.queue.retire(self.id)
        except StorageError as error:
            log.warning("could not give running attempts back; the next start does: %s", error)
        self._flights.clear()


def run_each(parts: Sequence[Callable[[], None]]) -> None:
    """Call every part. An unexpected exception of one does not keep the others from their work; it is raised at the
    end. StorageError is raised at once, because without a store no part can work."""
    failed: list[Exception] = []
    for part in parts:
        try:
            part()
        except StorageError:
            raise
        except Exception as error:
            failed.append(error)
    if len(failed) == 1:
        raise failed[0]
    if failed:
        raise ExceptionGroup("several parts of the dispatcher failed", failed)


def _is_ours(error: Exception) -> bool:
    """Whether the error says enough by itself; others are logged with a traceback."""
    return isinstance(error, ImpastoError)
