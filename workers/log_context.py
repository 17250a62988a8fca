"""What a log line is about: job, task, attempt, request. Known to the context that logs, or said with the line."""

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
    """What the current context works for."""
    return _ABOUT.get()


def of(record: object) -> About:
    """What a record is about: what was said with it, over what its context works for. Call it where it was logged."""
    return {**here(), **getattr(record, _KEY, {})}


def belong(facts: About) -> None:
    """From now on the current thread works for this."""
    _ABOUT.set(facts)


@contextmanager
def working_for(facts: About) -> Iterator[None]:
    """The current context works for this, besides what it already works for."""
    token = _ABOUT.set({**here(), **facts})
    try:
        yield
    finally:
        _ABOUT.reset(token)
