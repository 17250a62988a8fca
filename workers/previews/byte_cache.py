"""A cache with a limited number of bytes."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

T = TypeVar("T")


class ByteCache:
    """Values by key; the least recently used is dropped first. Thread-safe; a value that two threads need at the same
    time is made once.

    Args:
        limit_bytes: maximum size of all values together. A value larger than a quarter of it is not kept.
    """

    def __init__(self, limit_bytes: int) -> None:
        self.limit_bytes = limit_bytes
        self._values: OrderedDict[Hashable, tuple[object, int]] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()
        self._making: dict[Hashable, threading.Lock] = {}

    @property
    def size_bytes(self) -> int:
        """Bytes of the values that are kept."""
        return self._bytes

    def get(self, key: Hashable, make: Callable[[], T], size_of: Callable[[T], int]) -> T:
        """The value of `key`; `make` is called if it is not kept."""
        with self._lock:
            making = self._making.setdefault(key, threading.Lock())
        try:
            with making:
                found: T | None = self.peek(key)
                if found is None:
                    found = make()
                    self.put(key, found, size_of(found))
            return found
        finally:
            with self._lock:
                self._making.pop(key, None)

    def peek(self, key: Hashable) -> Any:
        """The value of `key`, or None."""
        with self._lock:
            if key not in self._values:
                return None
            self._values.move_to_end(key)
            return self._values[key][0]

    def put(self, key: Hashable, value: object, size_bytes: int) -> None:
        """Keep a value, instead of an earlier one of this key."""
        with self._lock:
            self._bytes -= self._values.pop(key, (None, 0))[1]
            if size_bytes > self.limit_bytes // 4:
                return
            self._values[key] = (value, size_bytes)
            self._bytes += size_bytes
            while self._bytes > self.limit_bytes:
                _, (_, dropped) = self._values.popitem(last=False)
                self._bytes -= dropped

    def drop(self, key: Hashable) -> None:
        """Forget the value of `key`, if it is kept."""
        with self._lock:
            self._bytes -= self._values.pop(key, (None, 0))[1]
