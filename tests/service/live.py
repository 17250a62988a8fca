"""A real uvicorn on loopback, for clients that will not speak to a test double."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from service.app import create_app
from service.server import address_of, make_server
from service.settings import Settings
from workers.farm import Farm


@contextmanager
def running(settings: Settings, farm: Farm) -> Iterator[str]:
    """Serve until the block ends; gives the address."""
    up = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        server = make_server(create_app(settings, farm), settings, lambda _url: up.set())
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        assert up.wait(10)
        try:
            yield address_of(listener)
        finally:
            server.should_exit = True
            thread.join(15)
            assert not thread.is_alive()
