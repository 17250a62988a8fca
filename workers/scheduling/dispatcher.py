"""The dispatcher: one thread that plans steps, claims tasks for its pool, and writes their outcomes to the store.

It has no state that must survive: after a crash at any time, the next dispatcher continues from the store.
While the store or the blobs are unreachable it retries with growing intervals, and keeps the outcomes that arrive.
"""

from __future__ import annotations

import logging
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

from pipeline.errors import StorageError
from workers.contract.order import TaskOutcome
from workers.faults import failed_outcome
from workers.jobs import state_machine as machine
from workers.operator_views import DrainScope, Slot, WorkerInfo
from workers.pools.base import Pool, Report
from workers.process.log_context import log_extra
from workers.scheduling import step_planner
from workers.scheduling.flights import Flight, facts_of, log_end, log_hang, lost_outcome, stall_limit_s
from workers.scheduling.orders import Orders
from workers.scheduling.outcome_writer import OutcomeWriter
from workers.scheduling.process_lock import ProcessLock
from workers.scheduling.step_planner import StepPlanner, is_user_error
from workers.scheduling.versions import is_readable
from workers.settings import FarmSettings
from workers.store import Claim, ClaimFailed, Heartbeat, Store
from workers.store.claims import OtherVersion

log = logging.getLogger(__name__)

_BUSY_TICK_S = 0.4
"""Interval of writing progress and of checking for cancelled attempts, while something runs."""
_WRITE_INTERVALS = ((4.0, 1), (30.0, 3), (float("inf"), 6))
"""(Seconds since the dispatcher was last idle, ticks between writes of progress). Frequent writes would cost a fast
method several percent of its time."""
_IDLE_TICK_S = 1.0
"""Seconds between searches for work that another process has accepted."""
_FULL_TICK_S = 5.0
"""The same while every slot is occupied."""
_CANCEL_CHECK_TICKS = 3
"""Maximum number of ticks between checks for attempts that another process has cancelled."""
_MAX_BACK_OFF_S = 15.0
_LATE_S = 5.0
"""A gap between two ticks of this length is not counted as silence of the attempts, seconds."""
_MOVES_BYTES = 1 << 20
"""An attempt that has moved so many bytes since the last look does not hang."""


class Dispatcher:
    """Runs the jobs of a store on a pool.

    Args:
        store: jobs and tasks.
        pool: started and stopped by the dispatcher.
        settings: capacity, leases, limits.
        check_space: raises StorageFull if no new work should begin.
        collect: called with the id of a job that succeeded or was deleted, whose blobs can be removed. Quick.
        who: name and version, shown to operators.
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
        self._planner = StepPlanner(store)
        self._outcomes = OutcomeWriter(store.queue)
        self._reports: deque[Report] = deque()
        self._postponed: deque[tuple[float, Flight, Report]] = deque()
        """Reports that could not be handled, and when each is tried again, monotonic s."""
        self._wake = threading.Event()
        self._stopping = False
        self._draining = False
        self._slots: tuple[Slot, ...] | None = None
        """Slots as last written to the store."""
        self._running_parts = (
            self._handle_reports, self._end_hanging, self._keep_leases, self._register, self._write_progress,
            self._revoke,
        )  # fmt: skip
        """Functions for running attempts, called in every tick. Repeatable: an exception in the middle loses
        nothing."""
        self._thread = threading.Thread(target=self._run, name="impasto-dispatcher", daemon=True)
        self._process_lock: ProcessLock | None = None
        self._last_renewal = self._progress_written = self._last_cancel_check = self._last_idle = float("-inf")
        self._last_tick = time.monotonic()
        self.trouble = ""
        """Error that prevents it from working now; empty: none."""

    # -- start and stop

    def start(self, process_lock: ProcessLock) -> None:
        """Start, and continue the jobs of an earlier dispatcher. `stop` releases `process_lock`."""
        self._pool.start(self._receive)
        self._process_lock = process_lock
        self._last_tick = self._last_idle = time.monotonic()
        self._thread.start()

    def stop(self, grace_s: float = 5.0) -> None:
        """Ask running attempts to stop, return their tasks to the queue, and end."""
        if self._process_lock is None:
            return
        self._stopping = True
        self._wake.set()
        self._thread.join(grace_s + _MAX_BACK_OFF_S)
        self._pool.stop(grace_s)
        self._return_running()
        self._process_lock.end()
        self._process_lock = None

    def drain(self, timeout_s: float) -> bool:
        """Start nothing new and wait for running attempts; whether all ended within `timeout_s`. Then call `stop`."""
        self._draining = True
        deadline = time.monotonic() + timeout_s
        while self._flights and time.monotonic() < deadline:
            time.sleep(0.05)
        return not self._flights

    def wake(self) -> None:
        """Search for work now, because the store has changed."""
        self._last_cancel_check = float("-inf")
        self._wake.set()

    def check(self) -> None:
        """Raise StorageError if it cannot work, or if its thread hangs or has died."""
        silent_s = time.monotonic() - self._last_tick
        if not self._thread.is_alive() or silent_s > 4 * _MAX_BACK_OFF_S:
            raise StorageError(f"The dispatcher has been silent for {silent_s:.0f} s.", remedy="Restart the service.")
        if trouble := self.trouble or str(self._pool.describe().get("lacking", "")):
            raise StorageError(trouble)

    @property
    def id(self) -> str:
        """The dispatcher's id in the store; empty until it is started."""
        return "" if self._process_lock is None else self._process_lock.id

    @property
    def running(self) -> int:
        """Number of attempts in the pool."""
        return len(self._flights)

    # -- the thread

    def _run(self) -> None:
        back_off, woken, searched = 0.0, True, float("-inf")
        while not self._stopping:
            self._wake.clear()
            self._ignore_own_pause(time.monotonic() - self._last_tick)
            self._last_tick = time.monotonic()
            try:
                parts: list[Callable[[], None]] = [*self._running_parts]
                interval_s = _IDLE_TICK_S if self._has_free_slot() else _FULL_TICK_S
                if woken or back_off or self._last_tick - searched >= interval_s:
                    parts += [self._plan, self._fill]
                    searched = self._last_tick
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
        self._retry_postponed()
        while self._reports:
            try:
                self._take(self._reports[0])
            except StorageError:
                raise
            except Exception:
                log.exception("a report cannot be handled; it is set aside for %.0f s", step_planner.SKIP_S)
                self._postpone_report(self._reports[0])
            self._reports.popleft()

    def _postpone_report(self, report: Report) -> None:
        flight = self._flights.pop(report.attempt_id, None)
        if flight is not None:
            self._postponed.append((time.monotonic() + step_planner.SKIP_S, flight, report))

    def _retry_postponed(self) -> None:
        """Try reports again that were set aside long enough ago."""
        while self._postponed and self._postponed[0][0] <= time.monotonic():
            _, flight, report = self._postponed.popleft()
            self._flights[report.attempt_id] = flight
            self._reports.append(report)

    def _take(self, report: Report) -> None:
        flight = self._flights.get(report.attempt_id)
        if flight is None or flight.hang:
            return  # already given up; the store would refuse it, too
        flight.last_report_s = time.monotonic()
        if report.worker and report.worker != flight.worker:
            flight.worker, flight.reported = report.worker, False
        if report.lost:
            self._end(report.attempt_id, flight, lost_outcome(report))
        elif report.outcome is not None:
            self._end(report.attempt_id, flight, report.outcome)
        elif (report.progress, report.preview or flight.preview) != (flight.progress, flight.preview):
            flight.progress, flight.preview = report.progress, report.preview or flight.preview
            flight.reported = False

    def _end(self, attempt_id: str, flight: Flight, outcome: TaskOutcome) -> None:
        """Write an outcome to the store. The attempt is forgotten here only after that has succeeded."""
        counted = self._outcomes.write(attempt_id, flight, outcome, self._stopping)
        self._flights.pop(attempt_id, None)
        log_end(attempt_id, flight, outcome, counted)
        jobs = self._store.jobs
        over = jobs.succeeded(flight.job_id) if counted and flight.last_step else not jobs.exists(flight.job_id)
        if over:
            self._collect(flight.job_id)

    def _write_progress(self) -> None:
        news = {attempt_id: flight for attempt_id, flight in self._flights.items() if not flight.reported}
        now = time.monotonic()
        if not news or now - self._progress_written < _BUSY_TICK_S * self._write_interval():
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

    def _write_interval(self) -> int:
        """Ticks between two writes of progress."""
        worked_s = time.monotonic() - self._last_idle
        return next(ticks for until_s, ticks in _WRITE_INTERVALS if worked_s < until_s)

    # -- leases, revocations, silence

    def _keep_leases(self) -> None:
        assert self._process_lock is not None
        lease_s = self._settings.lease_s
        if time.monotonic() - self._last_renewal < lease_s / 3:
            return
        self._store.queue.renew(self._process_lock.id, lease_s)
        dead = self._process_lock.dead()
        if given_back := self._store.queue.interrupt(dead):
            log.info("%d attempts of dead dispatchers were returned to the queue", given_back)
        self._process_lock.forget(dead)
        self._last_renewal = time.monotonic()

    def _register(self) -> None:
        """Write the slots for operators."""
        if (slots := self._pool.slots()) != self._slots:
            self._store.workers.register(self.id, self._who, slots)
            self._slots = slots

    def _ignore_own_pause(self, gap_s: float) -> None:
        """Attempts are not silent while this thread was: the process was frozen, or the store did not answer."""
        if gap_s > _LATE_S:
            for flight in self._flights.values():
                flight.last_report_s += gap_s

    def _end_hanging(self) -> None:
        """End attempts that hang in a library. They are not charged: they count as interrupted."""
        now = time.monotonic()
        for attempt_id, flight in list(self._flights.items()):
            if now - flight.last_report_s > flight.stall_s / 3:
                self._check_io(attempt_id, flight)
            if now - flight.last_report_s <= flight.stall_s:
                continue
            if not flight.hang:
                if not (seen := self._pool.abandon(attempt_id)):
                    flight.last_report_s = now  # it has not begun
                    continue
                flight.hang = log_hang(attempt_id, flight, seen)
            outcome = TaskOutcome(attempt_id, {}, {}, {}, None, {}, flight.hang)
            self._store.queue.finish(outcome, machine.Interrupted(), flight.worker)
            self._flights.pop(attempt_id, None)

    def _check_io(self, attempt_id: str, flight: Flight) -> None:
        """An attempt that moves bytes without reporting, for example a large file, does not hang."""
        moved = self._pool.moved_bytes(attempt_id)
        if moved - flight.moved_bytes >= _MOVES_BYTES:
            flight.moved_bytes, flight.last_report_s = moved, time.monotonic() - flight.stall_s / 3

    def _revoke(self) -> None:
        """Cancel attempts in the pool that no longer count, because their job was cancelled."""
        assert self._process_lock is not None
        now = time.monotonic()
        if not self._flights or now - self._last_cancel_check < _BUSY_TICK_S * min(
            self._write_interval(), _CANCEL_CHECK_TICKS
        ):
            return
        mine = self._store.queue.attempts_of(self._process_lock.id)
        self._last_cancel_check = now
        for attempt_id, flight in list(self._flights.items()):
            if attempt_id not in mine and not flight.revoked:
                flight.revoked = True
                self._pool.cancel(attempt_id)

    # -- new work

    def _plan(self) -> None:
        if self._planner.plan():
            self._wake.set()  # an empty step ends at once, and the next one needs a plan

    def _fill(self) -> None:
        assert self._process_lock is not None
        self._pool.drain([drain.name for drain in self._store.workers.drains() if drain.place is DrainScope.NODE])
        while self._has_free_slot() and not (self._stopping or self._draining):
            self._check_space()
            try:
                claim = self._store.queue.claim(
                    self._process_lock.id, self._settings.lease_s, self._planner.skipped, is_readable
                )
            except OtherVersion as error:
                self._planner.take_over(error.job_id)
                self._wake.set()  # it may have to be planned
                continue
            except ClaimFailed as error:
                log.exception("no task of the job can be claimed; it is skipped", extra=log_extra(job=error.job_id))
                self._planner.skip(error.job_id)
                continue
            if claim is None:
                return
            last = claim.step_name == machine.ASSEMBLE
            flight = Flight(time.monotonic(), claim.job_id, str(claim.task["id"]), last)
            self._flights[claim.attempt_id] = flight
            log.info("attempt begins", extra=facts_of(claim.attempt_id, flight, step=claim.step_name))
            self._send(claim)

    def _has_free_slot(self) -> bool:
        """Counts attempts as well as slots: a task order that fails to build does not occupy a slot."""
        return len(self._flights) < self._pool.capacity and self._pool.free > 0

    def _send(self, claim: Claim) -> None:
        """Submit a claimed task to the pool. An error becomes the attempt's outcome, so that its slot is free."""
        try:
            order = self._orders.order(claim)
            self._flights[claim.attempt_id].stall_s = stall_limit_s(order, self._settings.stall_s)
            self._pool.submit(order)
        except Exception as error:
            if not is_user_error(error):
                log.exception("an order failed", extra=log_extra(job=claim.job_id))
            self._receive(Report(claim.attempt_id, outcome=failed_outcome(claim.attempt_id, error)))

    def _return_running(self) -> None:
        """Return attempts that did not end in time to the queue."""
        try:
            self._handle_reports()
            for attempt_id in list(self._flights):
                self._store.queue.postpone(attempt_id, 0.0, "The service was stopped.")
            self._store.queue.retire(self.id)
        except StorageError as error:
            log.warning("running attempts could not be returned to the queue; the next start does it: %s", error)
        self._flights.clear()


def run_each(parts: Sequence[Callable[[], None]]) -> None:
    """Call every part. An unexpected exception of one does not prevent the others from running; it is raised at the
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
