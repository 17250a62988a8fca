"""Plans the next steps of jobs and stores their tasks."""

from __future__ import annotations

import logging
import time

from pipeline.errors import ImpastoError, StorageError
from workers.faults import fault_from
from workers.jobs.frame_window import window_inputs
from workers.process.log_context import log_extra
from workers.scheduling.planning import plan_step
from workers.scheduling.versions import VersionKeeper, is_readable
from workers.store import StepToPlan, Store

log = logging.getLogger(__name__)

_PLANS_AT_ONCE = 4
VERSION_WAIT_S = 5.0
"""Time for which a job is skipped that waits for another version of the program, seconds."""
SKIP_S = 60.0
"""Time for which a job is skipped after its state could not be written, seconds."""


class StepPlanner:
    """Plans steps. Used by one thread."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._versions = VersionKeeper(store)
        self.skipped: dict[str, float] = {}
        """Job id -> monotonic time until which the job is skipped, because its state could not be written."""

    def plan(self) -> bool:
        """Plan the steps that are due, most urgent jobs first; returns whether there was one. Raises StorageError."""
        now = time.monotonic()
        self.skipped = {job_id: until for job_id, until in self.skipped.items() if until > now}
        due = self._store.plans.to_plan(_PLANS_AT_ONCE, self.skipped)
        for todo in due:
            self.plan_one(todo)
        return bool(due)

    def skip(self, job_id: str, seconds: float | None = None) -> None:
        """Skip the job for `seconds`, default `SKIP_S`."""
        self.skipped[job_id] = time.monotonic() + (SKIP_S if seconds is None else seconds)

    def take_over(self, job_id: str) -> None:
        """Continue a job that another version has planned, or let it be planned again. If it must wait, or an error
        prevents that, it is skipped for a while."""
        try:
            found = self._store.plans.find(job_id)
            if found is None or not self._versions.take_over(found):
                self.skip(job_id, VERSION_WAIT_S)
        except StorageError:
            raise
        except Exception:
            log.exception("a job of another version cannot be continued", extra=log_extra(job=job_id))
            self.skip(job_id)

    def plan_one(self, todo: StepToPlan) -> None:
        """Plan a step and store its tasks. An error fails this job only; if that cannot be recorded, the job is skipped
        for a while. StorageError is raised, because it concerns every job."""
        try:
            self._plan_and_store(todo)
        except StorageError:
            raise
        except Exception as error:
            log.warning(
                "planning failed: %s", error, extra=log_extra(job=todo.job_id), exc_info=not is_user_error(error)
            )
            self._record_failure(todo, error)

    def _record_failure(self, todo: StepToPlan, error: Exception) -> None:
        try:
            self._store.plans.plan_failed(todo.job_id, todo.step, fault_from(error))
        except StorageError:
            raise
        except Exception:
            log.exception("a failed plan cannot be recorded; the job is skipped", extra=log_extra(job=todo.job_id))
            self.skip(todo.job_id)

    def _plan_and_store(self, todo: StepToPlan) -> None:
        if not is_readable(vars(todo)):
            self.take_over(todo.job_id)
            return
        plans, inputs, request = self._store.plans, self._store.task_inputs, todo.request
        results, _ = inputs.before(todo.job_id, todo.step)
        info = window_inputs(inputs.input_info(request.inputs), request.frames, request.source)
        plans.planned(todo.job_id, todo.step, plan_step(todo.step, request, todo.params, info, results))


def is_user_error(error: Exception) -> bool:
    """Whether the message explains the error; others are logged with a traceback."""
    return isinstance(error, ImpastoError)
