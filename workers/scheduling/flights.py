"""Attempts in a pool: the dispatcher's record of each, and the outcomes of attempts that a worker lost."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from workers.model import Fault, TaskOutcome
from workers.pools.base import Report
from workers.process.log_context import LogContext, log_extra

log = logging.getLogger(__name__)


@dataclass
class Flight:
    """An attempt in the pool."""

    last_report_s: float
    """Time of its last report, monotonic s."""
    job_id: str
    task_id: str
    last_step: bool
    progress: float = 0.0
    preview: str = ""
    worker: str = ""
    reported: bool = True
    """Whether the store has the latest `progress` and `preview`."""
    revoked: bool = False


def facts_of(attempt_id: str, flight: Flight, **more: str) -> dict[str, LogContext]:
    return log_extra(job=flight.job_id, task=flight.task_id, attempt=attempt_id, **more)


def log_end(attempt_id: str, flight: Flight, outcome: TaskOutcome, counted: bool) -> None:
    """Log the end of an attempt, and whether its outcome was accepted."""
    facts = facts_of(attempt_id, flight, worker=flight.worker, counted=str(counted).lower())
    if outcome.fault is not None:
        log.warning("attempt failed, %s: %s", outcome.fault.code, outcome.fault.message, extra=facts)
    else:
        log.info("attempt was cancelled" if outcome.cancelled else "attempt succeeded", extra=facts)


def lost_outcome(report: Report) -> TaskOutcome:
    fault = Fault("worker-lost", "The worker died while it ran this task.", "Look for a lack of memory, then retry.")
    log_text = f"The worker {report.worker or '(unknown)'} died."
    return TaskOutcome(report.attempt_id, {}, {}, {}, None, {}, log_text, fault)


def stalled_outcome(attempt_id: str, seconds: float) -> TaskOutcome:
    fault = Fault("stalled", f"The task reported nothing for {seconds:.0f} s.", "See the log of the task, then retry.")
    return TaskOutcome(attempt_id, {}, {}, {}, None, {}, "", fault)
