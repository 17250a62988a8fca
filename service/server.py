"""serve: the farm and the HTTP service in one process, until a signal."""

from __future__ import annotations

import gc
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
from service.settings import Settings
from service.sockets import LiveSocket
from workers.farm import Farm
from workers.logs import set_up_logs
from workers.studio import open_farm

GRACE_S = 10
"""Answers under way may take this long when the service stops; event streams end at once."""


def serve(settings: Settings, on_ready: Callable[[str], None] = lambda url: None) -> None:
    """Open the farm, serve until SIGINT or SIGTERM, stop in order. Call it on the main thread.

    Args:
        on_ready: called with the address, for example "http://127.0.0.1:8420", once requests are answered.

    Raises:
        BadParameter: a key is needed and there is none.
        StorageError: the farm cannot be opened.
        OSError: the address cannot be bound.
    """
    set_up_logs(settings)
    farm = open_farm(settings)
    try:
        _check_way_in(settings, farm)
        listener = _bind(settings.host, settings.port)
        farm.start()
        server = make_server(create_app(settings, farm), settings, on_ready)
        gc.collect()
        gc.freeze()  # what is there now stays; looking through it for garbage would hold up every answer
        with listener, _gentle_signals():
            server.run(sockets=[listener])
    finally:
        farm.stop()


def make_server(app: FastAPI, settings: Settings, on_ready: Callable[[str], None] = lambda url: None) -> uvicorn.Server:
    """The server of `app`; run it with the socket that it listens on."""
    config = uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        log_config=None,  # ours, made before
        log_level="warning",
        access_log=False,  # the edge writes a better one
        lifespan="on",
        server_header=False,
        timeout_graceful_shutdown=GRACE_S,
        ws=LiveSocket,
        ws_max_size=2 * max(settings.live_frame_bytes, settings.max_json_bytes),
        ws_ping_interval=settings.live_ping_s,
        ws_ping_timeout=settings.live_ping_s,
        ws_per_message_deflate=False,
    )
    return _Server(config, app, on_ready)


class _Server(uvicorn.Server):
    def __init__(self, config: uvicorn.Config, app: FastAPI, on_ready: Callable[[str], None]) -> None:
        super().__init__(config)
        self._app, self._on_ready = app, on_ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started and sockets:
            self._on_ready(address_of(sockets[0]))

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._app.state.service.closing.set()  # before the wait for open answers: streams are among them
        await self._app.state.live.close()
        await super().shutdown(sockets)


def _bind(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)  # named, so that asyncio sends at once
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except OSError:
        listener.close()
        raise
    return listener


def address_of(listener: socket.socket) -> str:
    """Where a browser on this machine finds the socket."""
    host, port = listener.getsockname()[:2]
    here = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)  # noqa: S104  (shown, not bound)
    return f"http://[{here}]:{port}" if ":" in here else f"http://{here}:{port}"


def _check_way_in(settings: Settings, farm: Farm) -> None:
    if settings.open or settings.admin_key or any(key.revoked_at is None for key in farm.keys.list()):
        return
    raise BadParameter(
        "Requests need an API key here, and there is none.",
        field="IMPASTO_ADMIN_KEY",
        remedy="Make one with `impasto keys create`, set IMPASTO_ADMIN_KEY to a long secret, or bind 127.0.0.1.",
    )


@contextmanager
def _gentle_signals() -> Iterator[None]:
    """uvicorn raises the signal that stopped it again at its end: it must not cut short what follows."""
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
