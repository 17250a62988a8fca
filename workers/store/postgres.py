"""Connections to PostgreSQL whose every wait has an end: a server that is frozen enforces no time limit of its own."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, TypeVar

import psycopg
from psycopg.pq import TransactionStatus

T = TypeVar("T")
ANSWER_S = 150.0
"""Longest wait for an answer of the server, seconds: more than its own limit of a statement, 120 s."""
_INTERVAL_S = 0.1


class BoundedConnection(psycopg.Connection[Any]):
    """Closes itself when an answer takes too long, and raises OperationalError."""

    def wait(self, gen: Generator[Any, Any, T], interval: float = _INTERVAL_S, timeout: float | None = None) -> T:
        try:
            return super().wait(gen, interval, ANSWER_S if timeout is None else timeout)
        except psycopg.OperationalError:
            if self.pgconn.transaction_status == TransactionStatus.ACTIVE:  # the answer may come later
                self.pgconn.finish()
            raise


def connect(_dialect: object, _record: object, arguments: list[Any], named: dict[str, Any]) -> BoundedConnection:
    """SQLAlchemy's event "do_connect"."""
    return BoundedConnection.connect(*arguments, **named)
