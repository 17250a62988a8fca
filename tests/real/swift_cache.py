"""A cache in the memory of Swift's proxy, as its `cache` filter with memcached would be.

Without a cache the proxy asks the account and container servers again at every request, which doubles the CPU time of
a request for a small object. There is one proxy process, so that the cache needs no server of its own.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any


class Cache:
    """The methods of `swift.common.memcached.MemcacheRing` that Swift calls."""

    def __init__(self) -> None:
        self._values: dict[str, tuple[Any, float]] = {}
        """Value, and the time of `time.monotonic` at which it expires."""

    def get(self, key: str, **options: Any) -> Any:
        value, until = self._values.get(key, (None, 0.0))
        return value if until > time.monotonic() else None

    def set(self, key: str, value: Any, time: float = 0, **options: Any) -> None:
        self._values[key] = value, _end(time)

    def delete(self, key: str, **options: Any) -> None:
        self._values.pop(key, None)

    def incr(self, key: str, delta: int = 1, time: float = 0, **options: Any) -> int:
        value = max(0, int(self.get(key) or 0) + int(delta))
        self.set(key, value, time)
        return value

    def decr(self, key: str, delta: int = 1, time: float = 0, **options: Any) -> int:
        return self.incr(key, -delta, time)

    def get_multi(self, keys: Iterable[str], *words: Any, **options: Any) -> list[Any]:
        return [self.get(key) for key in keys]

    def set_multi(self, values: Mapping[str, Any], *words: Any, time: float = 0, **options: Any) -> None:
        for key, value in values.items():
            self.set(key, value, time)


def _end(seconds: float) -> float:
    return time.monotonic() + seconds if seconds else float("inf")


def filter_factory(global_conf: Mapping[str, str], **local_conf: str) -> Callable[[Any], Any]:
    """A filter of Paste Deploy."""
    cache = Cache()

    def wrapped(app: Any) -> Any:
        def answer(env: dict[str, Any], start_response: Any) -> Any:
            env["swift.cache"] = cache
            return app(env, start_response)

        return answer

    return wrapped
