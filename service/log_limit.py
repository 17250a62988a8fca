"""A logging filter that bounds repeated warnings, so that a fault that recurs thousands of times cannot fill a disk."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

WINDOW_S = 10.0
BURST = 5
MAX_KINDS = 1000


class RepeatFilter(logging.Filter):
    """Passes at most `BURST` records of one kind in `WINDOW_S` seconds, and later logs the number of dropped ones.

    A kind is a logger, a level and a message before its arguments are filled in. Records below WARNING always pass.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._lock = threading.Lock()
        self._kinds: dict[tuple[str, int, str], tuple[float, int]] = {}
        """Kind -> start of its window, and number of records in it."""

    def filter(self, record: logging.LogRecord) -> bool:
        if record.levelno < logging.WARNING:
            return True
        kind, now = (record.name, record.levelno, str(record.msg)[:200]), self._clock()
        with self._lock:
            began, count = self._kinds.pop(kind, (now, 0))
            dropped = 0
            if now - began > WINDOW_S:
                dropped, began, count = max(0, count - BURST), now, 0
            self._kinds[kind] = (began, count + 1)
            if len(self._kinds) > MAX_KINDS:
                del self._kinds[next(iter(self._kinds))]
        if dropped:
            record.msg, record.args = f"{record.getMessage()} ({dropped} similar lines were dropped)", ()
        return count < BURST
