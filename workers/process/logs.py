"""Logs of a process on stderr, as text or JSON lines, and logs of attempts, which are stored with them."""

from __future__ import annotations

import json
import logging
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime

from workers.process.log_context import LogContext, current_context, of, working_for
from workers.settings import FarmSettings

OURS = ("impasto", "service", "workers", "pipeline")
_RECORDS = 400
_HEAD_CHARS, _TAIL_CHARS = 1_000, 7_000
"""Characters of a long record in an attempt's log: its message and the end of its traceback, where the cause is."""
_TRACE_CHARS = 20_000


def set_up_logs(settings: FarmSettings) -> logging.Handler:
    """Log to stderr according to the settings; returns the handler. Call it at a process's entry; a second call
    replaces the handler."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonLines() if settings.log_format == "json" else TextLines())
    handler.setLevel(settings.log_level.upper())
    handler.set_name("impasto")
    root = logging.getLogger()
    for old in [found for found in root.handlers if found.get_name() == "impasto"]:
        root.removeHandler(old)
    root.addHandler(handler)
    for name in OURS:
        logging.getLogger(name).setLevel(min(logging.INFO, handler.level))
    return handler


class JsonLines(logging.Formatter):
    """One JSON object per line: time, level, logger, message, context, traceback.

    A newline in a message stays inside its string, so that a message cannot forge a line.
    """

    def format(self, record: logging.LogRecord) -> str:
        row: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **of(record),
        }
        if record.exc_info:
            row["trace"] = self.formatException(record.exc_info)[-_TRACE_CHARS:]
        return json.dumps(row, default=str)


class TextLines(logging.Formatter):
    """Text for people: time, level, logger, message, then the context in brackets."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)s %(name)s: %(message)s")

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802  (the name it overrides)
        facts = of(record)
        words = " ".join(f"{name}={value}" for name, value in facts.items())
        record.message = record.message.replace("\n", "\\n")
        return super().formatMessage(record) + (f" [{words}]" if words else "")


class AttemptLog(logging.Handler):
    """The newest lines that the threads of one attempt log, each with job, task and attempt in front of it."""

    def __init__(self, job_id: str, task_id: str, attempt_id: str) -> None:
        super().__init__(logging.INFO)
        self.setFormatter(
            logging.Formatter(f"%(asctime)s %(levelname)s {job_id} {task_id} {attempt_id} %(name)s: %(message)s")
        )
        self._lines: deque[str] = deque(maxlen=_RECORDS)
        self._attempt_id = attempt_id

    def emit(self, record: logging.LogRecord) -> None:
        if current_context().get("attempt") == self._attempt_id:
            self._lines.append(shortened(self.format(record)))

    def text(self) -> str:
        return "\n".join(self._lines)


def shortened(text: str) -> str:
    """`text` without its middle if it is longer than 8,000 characters."""
    left_out = len(text) - _HEAD_CHARS - _TAIL_CHARS
    if left_out <= 0:
        return text
    return f"{text[:_HEAD_CHARS]}\n[{left_out} characters left out]\n{text[-_TAIL_CHARS:]}"


def attempt_facts(job_id: str, task_id: str, attempt_id: str) -> LogContext:
    """The context fields of an attempt's log lines."""
    return {"job": job_id, "task": task_id, "attempt": attempt_id}


@contextmanager
def captured(job_id: str, task_id: str, attempt_id: str) -> Iterator[AttemptLog]:
    """Collect records of level INFO and above from the current thread, and from threads that call `set_context`."""
    root, handler = logging.getLogger(), AttemptLog(job_id, task_id, attempt_id)
    root.addHandler(handler)
    try:
        with working_for(attempt_facts(job_id, task_id, attempt_id)):
            yield handler
    finally:
        root.removeHandler(handler)
