"""Attempts in a pool: the dispatcher's record of each, and the outcomes of attempts that a worker lost."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from workers.contract.order import TaskOrder, TaskOutcome
from workers.contract.record import Fault
from workers.pools.base import Report
from workers.process.log_context import LogContext, log_extra

log = logging.getLogger(__name__)

_PIXELS = 3840 * 2160
"""Pixels of the largest frames for which `FarmSettings.stall_s` is enough."""


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
    stall_s: float = float("inf")
    """Time without a report after which it hangs, seconds."""
    hang: str = ""
    """Diagnosis of an attempt that was ended because it hangs; empty: it does not hang."""
    moved_bytes: int = 0
    """Bytes that its process had moved when that was last asked."""


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


def stall_limit_s(order: TaskOrder, stall_s: float) -> float:
    """Time without a report after which an attempt hangs, seconds. Larger frames take longer."""
    video = order.input_info.get("video", {})
    return stall_s * max(1.0, int(video.get("width", 0)) * int(video.get("height", 0)) / _PIXELS)


def log_hang(attempt_id: str, flight: Flight, seen: str) -> str:
    """Log that the attempt hangs; returns the text for the log of the attempt.

    Args:
        seen: what the pool has seen of it.
    """
    message = f"The attempt reported nothing for {flight.stall_s:.0f} s, and its process was ended: {seen}."
    log.warning("%s", message, extra=facts_of(attempt_id, flight, worker=flight.worker))
    return message
