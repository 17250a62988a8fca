"""Rate limit: a token bucket per caller, in memory."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable

MAX_BUCKETS = 10_000
"""Maximum number of buckets; the least recently used are dropped. A dropped bucket counts as full."""


class Rates:
    """Allows each caller `burst` requests at once and `rate_per_s` per second on average."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, caller: str, rate_per_s: float, burst: int) -> float:
        """Take one token. Returns 0.0 if one was available, otherwise the seconds until the next."""
        now = self._clock()
        with self._lock:
            tokens, at = self._buckets.pop(caller, (float(burst), now))
            tokens = min(float(burst), tokens + (now - at) * rate_per_s)
            wait_s = 0.0 if tokens >= 1.0 else (1.0 - tokens) / rate_per_s
            self._buckets[caller] = (tokens - 1.0 if tokens >= 1.0 else tokens, now)
            if len(self._buckets) > MAX_BUCKETS:
                self._buckets.popitem(last=False)
        return wait_s
