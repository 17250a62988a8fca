"""How uvicorn speaks WebSocket for us: told apart who is lost from who reads slowly, and able to drop either.

uvicorn's own keep-alive closes a client that does not answer a ping in time, also one that only reads slowly and whose
ping waits behind a frame. Here a client counts as lost only if nothing at all has come from it since the ping.
"""

from __future__ import annotations

import socket
from asyncio import BaseTransport
from typing import cast

from uvicorn._types import ASGISendEvent
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

ABORT = "impasto.abort"
"""ASGI extension: {"call": drops the connection and what was to be sent}."""
LOST = 1006
UNSENT_BYTES = 256 << 10
"""What the kernel takes before it is sent: frames for a slow reader wait where newer ones can replace them, not in a
buffer of megabytes."""


class LiveSocket(WebSocketsSansIOProtocol):
    """uvicorn's protocol, with an end for clients that are gone."""

    heard_at = 0.0

    def connection_made(self, transport: BaseTransport) -> None:
        super().connection_made(transport)
        if (connection := transport.get_extra_info("socket")) is not None:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if hasattr(socket, "TCP_NOTSENT_LOWAT"):
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT_BYTES)

    def data_received(self, data: bytes) -> None:
        self.heard_at = self.loop.time()
        super().data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        if self.handshake_complete and self.conn.close_rcvd is None and not self.close_sent:
            self.queue.put_nowait({"type": "websocket.disconnect", "code": LOST, "reason": ""})
        super().connection_lost(exc)

    async def send(self, message: ASGISendEvent) -> None:
        await super().send(message)
        if self.initial_response is not None and self.close_sent:
            self.handshake_complete = True  # refused in order: nothing to complain of at the end

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
