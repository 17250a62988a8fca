"""Hands over what a long computation makes while it runs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from queue import SimpleQueue
from typing import TypeVar, cast

from pipeline.errors import Cancelled
from workers.previews.memory import Check

T = TypeVar("T")
_END = object()


def streamed(work: Callable[[Callable[[T], None], Check], None], check: Check) -> Iterator[T]:
    """Yield each item as soon as `work` hands it over. `work` runs in a thread of its own, which ends with the
    iteration.

    Args:
        work: called with a function that takes an item, and with a check that it calls between pieces of work.

    Raises: the error of `work`.
    """
    items: SimpleQueue[object] = SimpleQueue()
    left = threading.Event()

    def checked() -> None:
        if left.is_set():
            raise Cancelled("The client of this preview has left.")
        check()

    def run() -> None:
        try:
            work(items.put, checked)
            items.put(_END)
        except BaseException as error:
            items.put(error)

    thread = threading.Thread(target=run, name="impasto-preview", daemon=True)
    thread.start()
    try:
        while (item := items.get()) is not _END:
            if isinstance(item, BaseException):
                raise item
            yield cast("T", item)
    finally:
        left.set()
        thread.join()
