"""Optional concurrency within one frame: a helper thread takes part of the work. Results are bit-identical."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, Generic, ParamSpec, Protocol, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
Covariant = TypeVar("Covariant", covariant=True)


class Pending(Protocol[Covariant]):
    """A value that is available now or later (the result interface of `concurrent.futures.Future`)."""

    def result(self) -> Covariant:
        """Wait for the value and return it; raises the exception that computing it raised."""
        ...


@dataclass(frozen=True)
class Ready(Generic[T]):
    """A value that is already computed."""

    value: T

    def result(self) -> T:
        return self.value


@dataclass(frozen=True)
class Submitted(Generic[T]):
    """A value submitted to the helper. If the helper has not started on it, `result` computes it in the caller."""

    future: Future[T]
    make: Callable[[], T]

    def result(self) -> T:
        return self.make() if self.future.cancel() else self.future.result()


class LazyValue(Generic[T]):
    """A value that is computed by the thread that first asks for it.

    Args:
        make: computes the value.
        before: a value that must be computed first, since `make` uses state that it changes.
    """

    def __init__(self, make: Callable[[], T], before: LazyValue[Any] | None = None) -> None:
        self._lock = threading.Lock()
        self._make, self._before = make, before
        self._made: Ready[T] | None = None

    def result(self) -> T:
        with self._lock:
            if self._made is None:
                if self._before is not None:
                    self._before.result()
                self._made = Ready(self._make())
                del self._make, self._before  # and what they refer to
            return self._made.value


class FrameExecutor:
    """Runs functions immediately in the caller, or in submission order on a helper thread.

    Stateful functions (temporal filters) are submitted frame after frame. The helper must therefore have exactly one
    thread, which preserves the order. A function may wait for results submitted before it, never for later ones:
    that would deadlock.

    Args:
        helper: executor with one thread; None = run everything in the caller.
    """

    def __init__(self, helper: Executor | None = None) -> None:
        self.helper = helper

    def __call__(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Pending[T]:
        if self.helper is None:
            return Ready(function(*args, **kwargs))
        return self.helper.submit(function, *args, **kwargs)

    def submit(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Pending[T]:
        """Run `function` as a call of this object does. Only a later stage needs its value, so a subclass may wait."""
        return self(function, *args, **kwargs)

    def submit_stateless(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Pending[T]:
        """`submit` of a function without state: a subclass may run several of them at the same time."""
        return self.submit(function, *args, **kwargs)

    def submit_parallel(self, make: Callable[[], T]) -> Pending[T]:
        """Submit a stateless function. It runs on the helper if that is idle in time, otherwise in the caller."""
        return Ready(make()) if self.helper is None else Submitted(self.helper.submit(make), make)

    def rows(self, work: Callable[[int, int], None], height: int) -> None:
        """Call `work(first, last)` for all rows [0, height) of an image; the upper half is offered to the helper."""
        if self.helper is None:
            work(0, height)
            return
        upper = self.submit_parallel(lambda: work(0, height // 2))
        work(height // 2, height)
        upper.result()


class LazyExecutor(FrameExecutor):
    """Runs a function that is handed to `submit` in the thread that first asks for its value, or calls `finish`.

    The functions run in the order in which they were handed over, whichever thread runs them.
    """

    def __init__(self) -> None:
        super().__init__()
        self._latest: LazyValue[Any] | None = None

    def submit(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Pending[T]:
        latest = LazyValue(lambda: function(*args, **kwargs), self._latest)
        self._latest = latest
        return latest

    def finish(self) -> None:
        """Compute in this thread what has been handed over and not been asked for."""
        if self._latest is not None:
            self._latest.result()


class ThreadExecutor(FrameExecutor):
    """Runs a function that is called on one thread, one that is handed to `submit` on another, each in order, and
    stateless ones on further threads.

    Args:
        calls, thread: executors of one thread.
        others: executor of any number of threads.
    """

    def __init__(self, calls: Executor, thread: Executor, others: Executor) -> None:
        super().__init__()
        self._calls, self._thread, self._others = calls, thread, others

    def __call__(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Pending[T]:
        return self._calls.submit(function, *args, **kwargs)

    def submit(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Pending[T]:
        return self._thread.submit(function, *args, **kwargs)

    def submit_stateless(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Pending[T]:
        return self._others.submit(function, *args, **kwargs)


class RowExecutor(FrameExecutor):
    """Divides the rows of an image among the caller and further threads, and hands parallel functions to these; runs
    everything else in the caller.

    Args:
        threads: executor of so many `helpers`.
    """

    def __init__(self, threads: Executor, helpers: int) -> None:
        super().__init__()
        self._threads, self._helpers = threads, helpers

    def submit_parallel(self, make: Callable[[], T]) -> Pending[T]:
        return Submitted(self._threads.submit(make), make)

    def rows(self, work: Callable[[int, int], None], height: int) -> None:
        count = self._helpers + 1
        edges = [height * part // count for part in range(count + 1)]
        others = [Submitted(self._threads.submit(work, *span), partial(work, *span)) for span in pairwise(edges[1:])]
        work(*edges[:2])
        for other in others:
            other.result()


INLINE = FrameExecutor()
"""Runs everything in the caller: no helper thread."""
