"""`serve`: the farm and the HTTP service in one process, until a signal stops it."""

from __future__ import annotations

import asyncio
import logging
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

import uvicorn
from fastapi import FastAPI

from pipeline.errors import BadParameter
from service.app import create_app
from service.connections import ConnectionGuard, ReportPhases, connection_limit, guard_connections
from service.log_limit import RepeatFilter
from service.settings import Settings
from workers.farm import Farm, open_farm
from workers.process.descriptors import raise_descriptor_limit
from workers.process.free_memory import limit_free_memory
from workers.process.logs import set_up_logs
from workers.process.starting import without_garbage_collection

ACCEPTED_AT_ONCE = 16
"""Maximum number of connections that asyncio accepts in one iteration of its loop. A connection that the guard closes
keeps its descriptor for four iterations (accepted, set up, announced to the guard, closed), so that up to four times
as many exceed the guard's limit for a moment."""
LISTEN_QUEUE = 1024
"""Maximum number of connections that wait in the kernel to be accepted."""
GRACE_S = 10
"""Time for unfinished answers at shutdown, seconds; event streams end at once."""


def serve(settings: Settings, on_ready: Callable[[str], None] = lambda url: None) -> None:
    """Open the farm, serve until SIGINT or SIGTERM, then shut down cleanly. Call it on the main thread.

    Args:
        on_ready: called with the address, for example "http://127.0.0.1:8420", once requests are answered.

    Raises:
        BadParameter: a key is required and none exists.
        StorageError: the farm cannot be opened.
        OSError: the address cannot be bound.
    """
    set_up_logs(settings).addFilter(RepeatFilter())
    limit_free_memory()
    with without_garbage_collection():
        farm = open_farm(settings)
    try:
        _require_a_key_or_local_mode(settings, farm)
        listener = _bind(settings.host, settings.port)
        farm.start()
        with without_garbage_collection():
            app = create_app(settings, farm)
        server = make_server(app, settings, on_ready)
        with listener, _graceful_shutdown_signals():
            server.run(sockets=[listener])
    finally:
        farm.stop()


def make_server(app: FastAPI, settings: Settings, on_ready: Callable[[str], None] = lambda url: None) -> uvicorn.Server:
    """The server of `app`; run it with the socket that it listens on."""
    limit = connection_limit(raise_descriptor_limit(), settings.max_connections)
    guard = ConnectionGuard(limit, settings.header_s, settings.idle_s, 2 * settings.live_ping_s)
    config = uvicorn.Config(
        ReportPhases(app, guard),
        http="h11",
        host=settings.host,
        port=settings.port,
        log_config=None,  # `set_up_logs` has configured logging
        log_level="warning",
        access_log=False,  # `service.middleware` logs requests
        lifespan="on",
        server_header=False,
        timeout_graceful_shutdown=GRACE_S,
        backlog=ACCEPTED_AT_ONCE,
        ws="websockets-sansio",
        ws_max_size=2 * max(settings.live_frame_bytes, settings.max_json_bytes),
        ws_ping_interval=settings.live_ping_s,
        ws_ping_timeout=None,  # the guard ends clients that send nothing; uvicorn would end slow readers too
        ws_per_message_deflate=False,
    )
    guard_connections(config, guard)
    logging.getLogger("uvicorn.error").addFilter(_is_no_refusal)
    return _Server(config, app, guard, on_ready)


def _is_no_refusal(record: logging.LogRecord) -> bool:
    """uvicorn logs an error for every WebSocket that is refused with a response, which is no error of the service."""
    return "without completing handshake" not in str(record.msg)


class _Server(uvicorn.Server):
    def __init__(
        self, config: uvicorn.Config, app: FastAPI, guard: ConnectionGuard, on_ready: Callable[[str], None]
    ) -> None:
        super().__init__(config)
        self._app, self._guard, self._on_ready = app, guard, on_ready
        self._sweeping: asyncio.Task[None] | None = None

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        self._sweeping = asyncio.create_task(self._guard.run())
        await super().startup(sockets)
        for listener in sockets or ():
            listener.listen(LISTEN_QUEUE)
        if self.started and sockets:
            self._on_ready(address_of(sockets[0]))

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._app.state.service.closing.set()  # end event streams before uvicorn waits for open answers
        await self._app.state.live.close()
        await super().shutdown(sockets)
        if self._sweeping is not None:
            self._sweeping.cancel()


def _bind(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(
        family, socket.SOCK_STREAM, socket.IPPROTO_TCP
    )  # with the protocol named, asyncio sets TCP_NODELAY
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except OSError:
        listener.close()
        raise
    return listener


def address_of(listener: socket.socket) -> str:
    """The URL of the socket for a browser on this machine."""
    host, port = listener.getsockname()[:2]
    here = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)  # noqa: S104  (shown, not bound)
    return f"http://[{here}]:{port}" if ":" in here else f"http://{here}:{port}"


def _require_a_key_or_local_mode(settings: Settings, farm: Farm) -> None:
    if (
        settings.open
        or settings.admin_key
        or settings.oidc_issuer
        or any(key.revoked_at is None for key in farm.keys.list())
    ):
        return
    raise BadParameter(
        "Requests need an API key, and none exists.",
        field="IMPASTO_ADMIN_KEY",
        remedy="Create one with `impasto keys create`, set IMPASTO_ADMIN_KEY to a long secret, or bind 127.0.0.1.",
    )


@contextmanager
def _graceful_shutdown_signals() -> Iterator[None]:
    """uvicorn raises the signal that stopped it again when it returns; ignore it, so that the farm stops cleanly."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def ignore(_number: int, _frame: FrameType | None) -> None:
        return

    before = {number: signal.signal(number, ignore) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
