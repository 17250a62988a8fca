"""Limits of client connections: their number, the time for a request's headers, and the time for which an answer may
wait.

A connection that waits for bytes of its client costs a file descriptor. The guard closes those that wait too long,
and keeps their number below the process's descriptor limit, so that files, databases and child processes always have
descriptors left. It stands between the transport and the server's protocol, before a request exists, and therefore
covers slow headers, slow bodies, WebSocket upgrades, and clients that do not read their answer or that have vanished.

It uses asyncio and ASGI only: `GuardedConnection` sees the bytes of a connection, `ReportPhases` the requests on it.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass
from enum import IntEnum
from typing import cast

import uvicorn
from starlette.types import ASGIApp, Message, Receive, Scope, Send

log = logging.getLogger(__name__)

ABORT = "impasto.abort"
"""ASGI extension: {"call": drops the connection and its unsent data}."""
SWEEP_S = 1.0
UNSENT_BYTES = 256 << 10
"""Limit of unsent bytes of a WebSocket in the kernel's send buffer (TCP_NOTSENT_LOWAT). It is small, so that frames for
a slow reader wait where newer ones can replace them."""
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
    """A WebSocket in use, which has its own time-outs and answers pings."""


@dataclass
class _Client:
    phase: Phase
    since: float
    """Time at which the phase began; for BODY and WEBSOCKET, at which bytes last arrived."""
    unsent_bytes: int = 0
    unsent_since: float = 0.0
    """Time since which `unsent_bytes` has not changed."""


class ConnectionGuard:
    """Counts connections by transport and closes those that exceed a limit. Used on the event loop only.

    Args:
        limit: maximum number of connections.
        header_s: how long a request's headers may take after the connection opened or the last answer ended, seconds.
        stall_s: how long a client may leave an answer unread, seconds.
        silent_s: how long the client of a WebSocket may send nothing, not even the answer to a ping, seconds.
        clock: seconds, monotonic.
    """

    def __init__(
        self,
        limit: int,
        header_s: float,
        stall_s: float,
        silent_s: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._limit, self._header_s, self._stall_s, self._silent_s = limit, header_s, stall_s, silent_s
        self._clock = clock
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
        elif client.phase != phase:
            client.phase, client.since = phase, self._clock()

    def record_bytes(self, transport: asyncio.Transport) -> None:
        """Record that bytes have arrived from the client."""
        client = self._clients.get(transport)
        if client is not None and client.phase in (Phase.BODY, Phase.WEBSOCKET):
            client.since = self._clock()

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
        """Close connections whose headers take too long, or whose client does not read or has vanished."""
        now = self._clock()
        for transport, client in list(self._clients.items()):
            if self._stalled(transport, client, now) or self._late(client, now):
                self._close(transport)
        if self._refused:
            log.warning("%d connections were closed to stay within %d", self._refused, self._limit)
            self._refused = 0

    def _stalled(self, transport: asyncio.Transport, client: _Client, now: float) -> bool:
        unsent = transport.get_write_buffer_size()
        if unsent == 0 or unsent != client.unsent_bytes:
            client.unsent_bytes, client.unsent_since = unsent, now
        return unsent > 0 and client.phase is not Phase.WEBSOCKET and now - client.unsent_since > self._stall_s

    def _late(self, client: _Client, now: float) -> bool:
        """Whether the client has sent nothing for too long. One that still reads an answer need not send headers."""
        if client.phase is Phase.WEBSOCKET:
            return now - client.since > self._silent_s
        return client.phase is Phase.HEADERS and not client.unsent_bytes and now - client.since > self._header_s

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


_TRANSPORT: ContextVar[asyncio.Transport] = ContextVar("transport")
"""The connection on which a request arrived; the server starts the request's task while it handles these bytes."""


class GuardedConnection(asyncio.Protocol):
    """Passes a connection's events on to the server's protocol, and reports them to `guard`."""

    def __init__(self, protocol: asyncio.Protocol, guard: ConnectionGuard) -> None:
        self._protocol, self._guard = protocol, guard
        self._upgraded = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        self._protocol.connection_made(transport)
        self._guard.enter(self._transport, Phase.HEADERS)

    def data_received(self, data: bytes) -> None:
        if self._upgraded:
            self._guard.enter(self._transport, Phase.WEBSOCKET)
        self._guard.record_bytes(self._transport)
        _TRANSPORT.set(self._transport)
        self._protocol.data_received(data)
        if (successor := self._transport.get_protocol()) is not self:  # the server has upgraded to a WebSocket
            self._protocol, self._upgraded = cast(asyncio.Protocol, successor), True
            self._transport.set_protocol(self)

    def eof_received(self) -> bool | None:
        return self._protocol.eof_received()

    def pause_writing(self) -> None:
        self._protocol.pause_writing()

    def resume_writing(self) -> None:
        self._protocol.resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        self._guard.leave(self._transport)
        self._protocol.connection_lost(exc)


class ReportPhases:
    """Middleware that reports the phase of each request to `guard`, and gives WebSockets the extension `ABORT`."""

    def __init__(self, app: ASGIApp, guard: ConnectionGuard) -> None:
        self._app, self._guard = app, guard

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        transport = _TRANSPORT.get(None)
        if transport is None or scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            self._guard.enter(transport, Phase.BODY)
            _limit_unsent(transport)
            scope.setdefault("extensions", {})[ABORT] = {"call": transport.abort}
            await self._app(scope, receive, send)
        else:
            await self._request(transport, scope, receive, send)

    async def _request(self, transport: asyncio.Transport, scope: Scope, receive: Receive, send: Send) -> None:
        has_body = any(name in (b"content-length", b"transfer-encoding") for name, _ in scope["headers"])
        self._guard.enter(transport, Phase.BODY if has_body else Phase.ANSWER)

        async def received() -> Message:
            message = await receive()
            if message["type"] == "http.request" and not message.get("more_body"):
                self._guard.enter(transport, Phase.ANSWER)
            return message

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.body" and not message.get("more_body"):
                self._guard.enter(transport, Phase.HEADERS)
            elif message["type"] == "http.response.start":
                self._guard.enter(transport, Phase.ANSWER)
            await send(message)

        await self._app(scope, received, sent)


def _limit_unsent(transport: asyncio.Transport) -> None:
    connection = transport.get_extra_info("socket")
    if connection is not None and hasattr(socket, "TCP_NOTSENT_LOWAT"):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT_BYTES)


def guard_connections(config: uvicorn.Config, guard: ConnectionGuard) -> None:
    """Let every connection of the server report to `guard`."""
    config.load()
    made = config.http_protocol_class
    config.http_protocol_class = cast(
        type[asyncio.Protocol], lambda **options: GuardedConnection(made(**options), guard)
    )
