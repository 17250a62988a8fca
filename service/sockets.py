"""uvicorn's HTTP and WebSocket protocols with our limits: they report each phase of a connection to its guard.

uvicorn's own WebSocket keep-alive closes a client that does not answer a ping in time, also one that only reads slowly
and whose ping waits behind a frame. Here a client counts as lost only if no byte from it has arrived since the ping.
"""

from __future__ import annotations

import socket
from asyncio import BaseTransport, Transport
from typing import ClassVar, cast

from uvicorn._types import ASGISendEvent
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from service.connections import ConnectionGuard, Phase

ABORT = "impasto.abort"
"""ASGI extension: {"call": drops the connection and its unsent data}."""
LOST = 1006
UNSENT_BYTES = 256 << 10
"""Limit of unsent bytes in the kernel's send buffer (TCP_NOTSENT_LOWAT). It is small, so that frames for a slow reader
wait where newer ones can replace them."""


class GuardedHttp(H11Protocol):
    """HTTP/1.1 that reports to `guard`."""

    guard: ClassVar[ConnectionGuard]

    def connection_made(self, transport: Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.guard.enter(transport, Phase.HEADERS)

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if self.transport.get_protocol() is self:  # not a WebSocket since this call
            self._report()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._report()

    def connection_lost(self, exc: Exception | None) -> None:
        self.guard.leave(self.transport)
        super().connection_lost(exc)

    def _report(self) -> None:
        if self.transport.is_closing():
            return
        if self.cycle is None or self.cycle.response_complete:
            self.guard.enter(self.transport, Phase.HEADERS)
        else:
            self.guard.enter(self.transport, Phase.BODY if self.cycle.more_body else Phase.ANSWER)


class LiveSocket(WebSocketsSansIOProtocol):
    """WebSocket that reports to `guard`, and ends when its client is lost."""

    guard: ClassVar[ConnectionGuard]
    heard_at = 0.0

    def connection_made(self, transport: BaseTransport) -> None:
        super().connection_made(transport)
        self.guard.enter(cast(Transport, transport), Phase.BODY)
        if (connection := transport.get_extra_info("socket")) is not None:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if hasattr(socket, "TCP_NOTSENT_LOWAT"):
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT_BYTES)

    def data_received(self, data: bytes) -> None:
        self.heard_at = self.loop.time()
        if self.handshake_complete:
            self.guard.enter(self.transport, Phase.WEBSOCKET)
        super().data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        self.guard.leave(self.transport)
        if self.handshake_complete and self.conn.close_rcvd is None and not self.close_sent:
            self.queue.put_nowait({"type": "websocket.disconnect", "code": LOST, "reason": ""})
        super().connection_lost(exc)

    async def send(self, message: ASGISendEvent) -> None:
        await super().send(message)
        if self.initial_response is not None and self.close_sent:
            self.handshake_complete = True  # refused regularly, so the end needs no log message

    def keepalive_timeout(self) -> None:
        if self.heard_at <= self.ping_sent_at:
            self.transport.abort()
            return
        self.ping_sent_at = self.loop.time()
        wait_s = cast(float, self.ping_timeout)
        self.pong_timer = self.loop.call_later(wait_s, self.keepalive_timeout)

    async def run_asgi(self) -> None:
        extensions = cast(dict[str, object], self.scope["extensions"])
        extensions[ABORT] = {"call": self.transport.abort}
        await super().run_asgi()


def guarded(guard: ConnectionGuard) -> tuple[type[GuardedHttp], type[LiveSocket]]:
    """The two protocols as classes that report to `guard`, because uvicorn instantiates protocol classes itself."""
    http = type("Http", (GuardedHttp,), {"guard": guard})
    return http, type("Socket", (LiveSocket,), {"guard": guard})
