"""Queries to a farm whose stores may be down."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

from pipeline.errors import StorageError

PATIENCE_S = 600.0
T = TypeVar("T")


def patiently(ask: Callable[[], T | None]) -> T:
    """The first answer that is not None, however often the stores are away meanwhile. Fails after PATIENCE_S."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            if (answer := ask()) is not None:
                return answer
        except StorageError as error:
            assert time.monotonic() < deadline, error
        assert time.monotonic() < deadline, "it did not end"
        time.sleep(0.1)
