"""The context of log lines (job, task, attempt, request), set for a block of code or passed with one line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar

LogContext = Mapping[str, str | int | float]

_KEY = "log_context"
_CURRENT: ContextVar[LogContext] = ContextVar("impasto_log_context", default={})  # noqa: B039  (never changed in place)


def log_extra(**facts: str | int | float) -> dict[str, LogContext]:
    """The argument `extra` of a log call: `log.info("...", extra=log_extra(job=job_id))`."""
    return {_KEY: facts}


def current_context() -> LogContext:
    """The context of the current thread or asynchronous task."""
    return _CURRENT.get()


def of(record: object) -> LogContext:
    """The context of a record: the fields passed with it, then the current context. Call it in the thread that
    logged."""
    return {**current_context(), **getattr(record, _KEY, {})}


def set_context(facts: LogContext) -> None:
    """Set the context of the current thread."""
    _CURRENT.set(facts)


@contextmanager
def working_for(facts: LogContext) -> Iterator[None]:
    """Add to the context of the current thread or asynchronous task."""
    token = _CURRENT.set({**current_context(), **facts})
    try:
        yield
    finally:
        _CURRENT.reset(token)
