"""Threads of a task on machines with many processors: work that does not depend on the past is done some items ahead of
the caller, in the same order and with the same bytes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from typing import TypeVar

from pipeline.kernels.processors import usable_processors

T = TypeVar("T")
Made = TypeVar("Made")
MANY_PROCESSORS = 4
"""Processors from which on a single task has these threads: with fewer, tasks beside each other keep all busy."""


@contextmanager
def helpers(count: int, name: str) -> Iterator[ThreadPoolExecutor | None]:
    """An executor of so many threads; None on a machine with few processors."""
    if usable_processors() < MANY_PROCESSORS:
        yield None
        return
    with ThreadPoolExecutor(count, name) as threads:
        yield threads


@contextmanager
def ahead(
    make: Callable[[T], Made], items: Iterable[T], threads: int, name: str, most: int | None = None
) -> Iterator[Iterator[Made]]:
    """Results of `make` for each item, in order. Threads make them ahead of the caller, or the caller on a machine
    with few processors. The items are read by the caller. The end of the context waits for the threads.

    Args:
        most: items that may be made or wait while the caller works on one; None: twice the threads.
    """
    with helpers(threads, name) as executor:
        if executor is None:
            yield map(make, items)
            return
        with closing(_ahead(executor, make, items, most or 2 * threads)) as made:
            yield made


def _ahead(
    executor: ThreadPoolExecutor, make: Callable[[T], Made], items: Iterable[T], most: int
) -> Generator[Made, None, None]:
    waiting = deque[Future[Made]]()
    try:
        for item in items:
            waiting.append(executor.submit(make, item))
            if len(waiting) > most:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for each in waiting:
            each.cancel()
