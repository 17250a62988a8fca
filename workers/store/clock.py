"""The time of the database server, the same for all processes of a store, which compare leases and waits with it."""

from __future__ import annotations

import time

from sqlalchemy import Connection, text

_SYNC_INTERVAL_S = 10.0
_NOW = text("SELECT extract(epoch FROM clock_timestamp())::double precision")


class ServerClock:
    """PostgreSQL's clock, read every ten seconds; the monotonic clock of this machine supplies the time in between.

    A wrong clock of a machine, or a change of it, neither loses the machine's leases nor takes those of others.
    """

    def __init__(self) -> None:
        self._ahead: float | None = None
        """Server time minus monotonic time, seconds; None before the first reading."""
        self._synced_at = float("-inf")

    def __call__(self) -> float:
        """Seconds since the epoch."""
        return time.time() if self._ahead is None else time.monotonic() + self._ahead

    def synchronize(self, connection: Connection) -> None:
        """Read the server's time, unless it was read within the last ten seconds."""
        before = time.monotonic()
        if before - self._synced_at < _SYNC_INTERVAL_S:
            return
        server_time = float(connection.execute(_NOW).scalar_one())
        self._synced_at = time.monotonic()
        self._ahead = server_time - (before + self._synced_at) / 2
