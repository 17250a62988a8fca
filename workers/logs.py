"""What a step logs while it runs, kept with the attempt."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

_LINES = 400
_LINE_CHARS = 2000


class AttemptLog(logging.Handler):
    """The newest lines that this thread logs, each with job, task and attempt in front of it."""

    def __init__(self, job_id: str, task_id: str, attempt_id: str) -> None:
        super().__init__(logging.INFO)
        self.setFormatter(
            logging.Formatter(f"%(asctime)s %(levelname)s {job_id} {task_id} {attempt_id} %(name)s: %(message)s")
        )
        self._lines: deque[str] = deque(maxlen=_LINES)
        self._thread = threading.get_ident()

    def emit(self, record: logging.LogRecord) -> None:
        if record.thread == self._thread:
            self._lines.append(self.format(record)[:_LINE_CHARS])

    def text(self) -> str:
        return "\n".join(self._lines)


@contextmanager
def captured(job_id: str, task_id: str, attempt_id: str) -> Iterator[AttemptLog]:
    """Keep what the current thread logs at INFO and above."""
    root, handler = logging.getLogger(), AttemptLog(job_id, task_id, attempt_id)
    root.addHandler(handler)
    try:
        yield handler
    finally:
        root.removeHandler(handler)
