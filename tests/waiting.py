"""Waiting for an event of another thread or process."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import httpx

HTTP = httpx.Client(limits=httpx.Limits(max_keepalive_connections=0), timeout=60)
"""For requests that are repeated until something happens. Each `httpx.get` makes a client of its own, which loads all
certificates of the system: 24 ms of CPU time."""
SLOWER = 4
"""How many times slower a busy machine may be than the idle one for which the tests' waits were chosen.

A wait ends with its event, so that a longer limit costs time only where a test fails.
"""


def pause_s(waited_s: float) -> float:
    """Delay before the next check: a twentieth of the time waited so far, 0.02 to 0.25 s."""
    return min(0.25, max(0.02, waited_s / 20))


def until(ask: Callable[[], Any], timeout_s: float = 10.0) -> Any:
    """Wait for the first true result of `ask`. Raises AssertionError after `SLOWER * timeout_s` seconds."""
    start = time.monotonic()
    while not (answer := ask()):
        waited_s = time.monotonic() - start
        assert waited_s < SLOWER * timeout_s, f"it did not happen within {SLOWER * timeout_s:g} s"
        time.sleep(pause_s(waited_s))
    return answer


def answers(url: str) -> bool:
    """Whether a server answers at `url` with success, within 5 s."""
    try:
        return HTTP.get(url, timeout=5).is_success
    except httpx.TransportError:
        return False
