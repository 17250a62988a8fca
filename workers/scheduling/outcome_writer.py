"""Writes the outcomes of attempts to the store."""

from __future__ import annotations

import logging

from pipeline.errors import StorageError
from workers.contract.order import TaskOutcome
from workers.contract.record import Fault
from workers.faults import failed_outcome, is_final, is_resource_away
from workers.jobs import state_machine as machine
from workers.scheduling import step_planner
from workers.scheduling.flights import Flight, facts_of
from workers.store.task_queue import TaskQueue

log = logging.getLogger(__name__)

_RESOURCE_AWAY_S = 3.0
"""Delay of a task after an unreachable store, a full disk or exhausted descriptors."""


class OutcomeWriter:
    def __init__(self, queue: TaskQueue) -> None:
        self._queue = queue

    def write(self, attempt_id: str, flight: Flight, outcome: TaskOutcome, stopping: bool) -> bool:
        """Write an outcome; whether the store has accepted it.

        An outcome that cannot be written (a NaN, an object that is not JSON) fails its attempt; if even that cannot be
        written, the attempt is returned to the queue. So one outcome never delays the others.

        Args:
            stopping: whether the dispatcher stops: then a cancelled attempt returns to the queue.

        Raises: StorageError.
        """
        try:
            return self._commit(outcome, flight.worker, stopping)
        except StorageError:
            raise
        except Exception as error:
            log.exception("the outcome cannot be stored", extra=facts_of(attempt_id, flight))
            return self._commit_unstorable(attempt_id, flight, error, stopping)

    def _commit_unstorable(self, attempt_id: str, flight: Flight, error: Exception, stopping: bool) -> bool:
        try:
            return self._commit(failed_outcome(attempt_id, error), flight.worker, stopping)
        except StorageError:
            raise
        except Exception:
            log.exception("the failure cannot be stored either", extra=facts_of(attempt_id, flight))
            return self._queue.postpone(attempt_id, step_planner.SKIP_S, "The outcome could not be stored.")

    def _commit(self, outcome: TaskOutcome, worker: str, stopping: bool) -> bool:
        fault = outcome.fault
        if outcome.cancelled and stopping:
            return self._queue.postpone(outcome.attempt_id, 0.0, outcome.log)
        if outcome.cancelled:
            # The method stopped by itself, which is its error. If the job was cancelled, the store refuses the outcome.
            fault = fault or Fault("cancelled", "The task stopped without being cancelled.", "See the log of the task.")
        if fault is None:
            return self._queue.finish(outcome, worker=worker)
        if is_resource_away(fault):
            return self._queue.postpone(outcome.attempt_id, _RESOURCE_AWAY_S, outcome.log)
        return self._queue.finish(outcome, machine.Failed(fault, is_final(fault)), worker)
