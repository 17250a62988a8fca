"""The context of log lines: job, task, attempt, request. Set for a block of code, or passed with one line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar

About = Mapping[str, str | int | float]

_KEY = "about"
_ABOUT: ContextVar[About] = ContextVar("impasto_about", default={})  # noqa: B039  (never changed in place)


def about(**facts: str | int | float) -> dict[str, About]:
    """The `extra` of a line that is about these: `log.info("...", extra=about(job=job_id))`."""
    return {_KEY: facts}


def here() -> About:
    """The context of the current thread or asynchronous task."""
    return _ABOUT.get()


def of(record: object) -> About:
    """The context of a record: what was passed with it, then the current context. Call it in the thread that logged."""
    return {**here(), **getattr(record, _KEY, {})}


def belong(facts: About) -> None:
    """From now on the current thread works for this."""
    _ABOUT.set(facts)


@contextmanager
def working_for(facts: About) -> Iterator[None]:
    """Add to the context of the current thread or asynchronous task."""
    token = _ABOUT.set({**here(), **facts})
    try:
        yield
    finally:
        _ABOUT.reset(token)
