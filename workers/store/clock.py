"""What time it is, for all processes of a store: leases and waits are compared between machines."""

from __future__ import annotations

import time

from sqlalchemy import Connection, text

_LOOK_EVERY_S = 10.0
_NOW = text("SELECT extract(epoch FROM clock_timestamp())::double precision")


class ServerClock:
    """PostgreSQL's clock, asked for now and then and carried on by ours that nobody sets.

    A machine whose clock is wrong, or is set while it works, so neither loses its leases nor takes those of others.
    """

    def __init__(self) -> None:
        self._ahead: float | None = None
        """Of the monotonic clock, s."""
        self._looked = float("-inf")

    def __call__(self) -> float:
        """Seconds since the epoch."""
        return time.time() if self._ahead is None else time.monotonic() + self._ahead

    def look(self, connection: Connection) -> None:
        """Ask the server, unless that was just done."""
        before = time.monotonic()
        if before - self._looked < _LOOK_EVERY_S:
            return
        server_time = float(connection.execute(_NOW).scalar_one())
        self._looked = time.monotonic()
        self._ahead = server_time - (before + self._looked) / 2
