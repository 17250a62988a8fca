"""Queries to a farm whose stores may be down."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

from pipeline.errors import StorageError

RETRY_S = 600.0
T = TypeVar("T")


def with_retries(ask: Callable[[], T | None]) -> T:
    """Call `ask` until it returns an answer that is not None, also while the stores are down. Fails after `RETRY_S`."""
    deadline = time.monotonic() + RETRY_S
    while True:
        try:
            if (answer := ask()) is not None:
                return answer
        except StorageError as error:
            assert time.monotonic() < deadline, error
        assert time.monotonic() < deadline, "it did not end"
        time.sleep(0.1)
