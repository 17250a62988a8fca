"""Heartbeats of an attempt: sent by the work itself where it moves on, and not by a thread that is always alive.

The task context sends one with every call of the method, a blob store with every piece that it has moved. An attempt
without heartbeats hangs: see `FarmSettings.stall_s`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

EVERY_S = 1.0
"""Least time between two heartbeats that are sent on, seconds."""
_BEAT: ContextVar[Callable[[], None] | None] = ContextVar("impasto_heartbeat", default=None)


@contextmanager
def heartbeats(send: Callable[[], None]) -> Iterator[None]:
    """Within this block, `current_heartbeat` of this thread is `send`, called at most once a second."""
    token = _BEAT.set(_limited(send))
    try:
        yield
    finally:
        _BEAT.reset(token)


def current_heartbeat() -> Callable[[], None]:
    """The heartbeat of the attempt of this thread, to be called from any thread; outside of an attempt it does
    nothing."""
    return _BEAT.get() or _nothing


def _nothing() -> None: ...


def _limited(send: Callable[[], None]) -> Callable[[], None]:
    sent_s = float("-inf")

    def beat() -> None:
        nonlocal sent_s
        now = time.monotonic()
        if now - sent_s >= EVERY_S:
            sent_s = now
            send()

    return beat


@contextmanager
def heartbeats_of_another(limit_s: float) -> Iterator[None]:
    """Heartbeats while this thread waits for a process that reports nothing and has its own time limit.

    Args:
        limit_s: that limit, seconds; then the heartbeats end.
    """
    beat, ended, until_s = current_heartbeat(), threading.Event(), time.monotonic() + limit_s

    def send() -> None:
        while not ended.wait(5 * EVERY_S) and time.monotonic() < until_s:
            beat()

    if beat is not _nothing:
        threading.Thread(target=send, name="impasto-waits", daemon=True).start()
    try:
        yield
    finally:
        ended.set()
