"""Wall time of an attempt by stage. Thread-safe: a method may decode or compute in its own threads."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

METHOD = "method"


class StageTimer:
    """Wall seconds by stage of one attempt, run by the thread that makes this object.

    "method" is the wall time of the step function minus the time for which its own thread waited for the platform
    (decode, encode, store). Waiting of the method's other threads does not delay the method and counts only in its
    stage.
    """

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}
        self._lock = threading.Lock()
        self._owner = threading.get_ident()
        self._waited = 0.0

    @contextmanager
    def clock(self, stage: str) -> Iterator[None]:
        """Time a stage of the method."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            self._add(stage, time.perf_counter() - begin)

    @contextmanager
    def waiting(self, stage: str) -> Iterator[None]:
        """Time a stage of the platform, which does not count for the method."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            seconds = time.perf_counter() - begin
            self._add(stage, seconds)
            if threading.get_ident() == self._owner:
                self._waited += seconds

    @contextmanager
    def blocked(self) -> Iterator[None]:
        """Time for which the method's own thread waits for a stage that runs, and is timed, on another thread."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            if threading.get_ident() == self._owner:
                self._waited += time.perf_counter() - begin

    @contextmanager
    def method(self) -> Iterator[None]:
        """Time the step function itself."""
        begin, waited = time.perf_counter(), self._waited
        try:
            yield
        finally:
            self._add(METHOD, time.perf_counter() - begin - (self._waited - waited))

    def _add(self, stage: str, seconds: float) -> None:
        with self._lock:
            self._seconds[stage] = self._seconds.get(stage, 0.0) + seconds

    def seconds(self) -> dict[str, float]:
        with self._lock:
            return {stage: round(value, 6) for stage, value in sorted(self._seconds.items())}
