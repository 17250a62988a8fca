"""Connections to webhook receivers, with a check of the address after name resolution."""

from __future__ import annotations

import socket
from collections.abc import Iterable

import anyio
import httpcore

from service.webhooks.targets import is_public


class GuardedBackend(httpcore.AsyncNetworkBackend):
    """Opens connections to public addresses only.

    A name is resolved once, all its addresses are checked, and the connection is made to one of them, so that DNS
    rebinding has no effect. TLS still verifies the name.
    """

    def __init__(self) -> None:
        self._plain = httpcore.AnyIOBackend()

    async def connect_tcp(
        self,
        host: str,
        port: int,
        timeout: float | None = None,
        local_address: str | None = None,
        socket_options: Iterable[httpcore.SOCKET_OPTION] | None = None,
    ) -> httpcore.AsyncNetworkStream:
        try:
            rows = await anyio.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        except (OSError, UnicodeError) as error:
            raise httpcore.ConnectError(f"The name {host} cannot be resolved.") from error
        addresses = [str(row[4][0]) for row in rows]
        if not addresses or not all(map(is_public, addresses)):
            raise httpcore.ConnectError(f"{host} is not a public address.")
        return await self._plain.connect_tcp(addresses[0], port, timeout, local_address, socket_options)

    async def sleep(self, seconds: float) -> None:
        await self._plain.sleep(seconds)


def open_pool(private: bool) -> httpcore.AsyncConnectionPool:
    """A pool without keep-alive: there are many receivers, each rarely used. `private`: allow any address."""
    backend = httpcore.AnyIOBackend() if private else GuardedBackend()
    return httpcore.AsyncConnectionPool(max_keepalive_connections=0, network_backend=backend)
