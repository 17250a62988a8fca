"""What a step logs while it runs, kept with the attempt."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_LINES = 400
_LINE_CHARS = 2000
_ATTEMPT: ContextVar[str] = ContextVar("impasto_attempt", default="")
"""The attempt that the current thread works for."""


class AttemptLog(logging.Handler):
    """The newest lines that the threads of one attempt log, each with job, task and attempt in front of it."""

    def __init__(self, job_id: str, task_id: str, attempt_id: str) -> None:
        super().__init__(logging.INFO)
        self.setFormatter(
            logging.Formatter(f"%(asctime)s %(levelname)s {job_id} {task_id} {attempt_id} %(name)s: %(message)s")
        )
        self._lines: deque[str] = deque(maxlen=_LINES)
        self._attempt_id = attempt_id

    def emit(self, record: logging.LogRecord) -> None:
        if _ATTEMPT.get() == self._attempt_id:
            self._lines.append(self.format(record)[:_LINE_CHARS])

    def text(self) -> str:
        return "\n".join(self._lines)


def belong(attempt_id: str) -> None:
    """From now on the current thread works for this attempt: called whenever a thread uses its bench, so that the
    helpers which a step starts need not know of it."""
    _ATTEMPT.set(attempt_id)


@contextmanager
def captured(job_id: str, task_id: str, attempt_id: str) -> Iterator[AttemptLog]:
    """Keep what the current thread, and those that join it by `belong`, log at INFO and above."""
    root, handler = logging.getLogger(), AttemptLog(job_id, task_id, attempt_id)
    mine = _ATTEMPT.set(attempt_id)
    root.addHandler(handler)
    try:
        yield handler
    finally:
        root.removeHandler(handler)
        _ATTEMPT.reset(mine)
