"""Limits of client connections: their number, the time for a request's headers, and the time for which an answer may
wait.

A connection that waits for bytes of its client costs a file descriptor. The guard closes those that wait too long,
and keeps their number below the process's descriptor limit, so that files, databases and child processes always have
descriptors left. It works on the transport, before a request exists, and therefore covers slow headers, slow bodies,
WebSocket upgrades and clients that do not read their answer.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

log = logging.getLogger(__name__)

SWEEP_S = 1.0
RESERVED_SHARE, MIN_RESERVED = 0.25, 128
BUSY = (
    b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 5\r\nConnection: close\r\nContent-Length: 0\r\n"
    b"Cache-Control: no-store\r\n\r\n"
)


class Phase(IntEnum):
    """Phase of a connection, in the order in which connections are closed to free descriptors."""

    HEADERS = 0
    """It waits for a request, or for the rest of its headers."""
    BODY = 1
    """It waits for the body of a request, or for the first message of a WebSocket."""
    ANSWER = 2
    """The service works on the request or sends the answer."""
    WEBSOCKET = 3
    """A WebSocket in use, which has its own time-outs."""


@dataclass
class _Client:
    phase: Phase
    since: float
    """Time at which the phase began; for BODY, at which bytes last arrived."""
    unsent_bytes: int = 0
    unsent_since: float = 0.0
    """Time since which `unsent_bytes` has not changed."""


class ConnectionGuard:
    """Counts connections by transport and closes those that exceed a limit. Used on the event loop only.

    Args:
        limit: maximum number of connections.
        header_s: how long a request's headers may take after the connection opened or the last answer ended, seconds.
        stall_s: how long a client may leave an answer unread, seconds.
        clock: seconds, monotonic.
    """

    def __init__(
        self, limit: int, header_s: float, stall_s: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._limit, self._header_s, self._stall_s, self._clock = limit, header_s, stall_s, clock
        self._clients: dict[asyncio.Transport, _Client] = {}
        self._refused = 0

    def __len__(self) -> int:
        return len(self._clients)

    def enter(self, transport: asyncio.Transport, phase: Phase) -> None:
        """Record that the connection is now in `phase`. A new one may close another, or be refused."""
        client = self._clients.get(transport)
        if client is None:
            self._clients[transport] = _Client(phase, self._clock())
            if len(self._clients) > self._limit:
                self._free_capacity(transport)
        elif client.phase != phase or phase is Phase.BODY:
            client.phase, client.since = phase, self._clock()

    def leave(self, transport: asyncio.Transport) -> None:
        """The connection is closed."""
        self._clients.pop(transport, None)

    def _free_capacity(self, newest: asyncio.Transport) -> None:
        """Close the connection that has waited longest for its client; if none waits, refuse the newest."""
        waiting = [
            (client.phase, client.since, transport)
            for transport, client in self._clients.items()
            if client.phase <= Phase.BODY and transport is not newest
        ]
        self._refused += 1
        if waiting:
            self._close(min(waiting, key=lambda row: row[:2])[2])
        else:
            newest.write(BUSY)
            newest.close()
            self.leave(newest)

    def sweep(self) -> None:
        """Close connections whose headers take too long, or whose client does not read."""
        now = self._clock()
        for transport, client in list(self._clients.items()):
            late = client.phase is Phase.HEADERS and now - client.since > self._header_s
            stalled = client.phase is not Phase.WEBSOCKET and self._stalled(transport, client, now)
            if late or stalled:
                self._close(transport)
        if self._refused:
            log.warning("%d connections were closed to stay within %d", self._refused, self._limit)
            self._refused = 0

    def _stalled(self, transport: asyncio.Transport, client: _Client, now: float) -> bool:
        unsent = transport.get_write_buffer_size()
        if unsent == 0 or unsent != client.unsent_bytes:
            client.unsent_bytes, client.unsent_since = unsent, now
        return unsent > 0 and now - client.unsent_since > self._stall_s

    def _close(self, transport: asyncio.Transport) -> None:
        self.leave(transport)
        transport.abort()

    async def run(self) -> None:
        """Sweep once a second until cancelled."""
        while True:
            await asyncio.sleep(SWEEP_S)
            self.sweep()


def connection_limit(descriptors: int, wanted: int) -> int:
    """Maximum number of connections with this many descriptors: `wanted`, or fewer to leave some for files."""
    reserved = max(MIN_RESERVED, int(descriptors * RESERVED_SHARE))
    return max(1, min(wanted, descriptors - reserved))
