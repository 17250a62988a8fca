"""A proxy between the farm and S3 that injects faults: errors, latency, truncated answers, broken connections."""

from __future__ import annotations

import random
import socket
import threading
import time
from contextlib import suppress
from typing import Literal
from urllib.parse import urlsplit

Mode = Literal["", "503", "slow", "truncate", "reset"]
_BUSY = b"HTTP/1.1 503 Slow Down\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
_CHUNK = 1 << 14


class BadNetwork:
    """Listens on a port of this machine and passes connections on to `endpoint`.

    Attributes:
        mode: what is wrong now; empty: nothing.
        share: how many connections or answers it concerns, 0..1.
    """

    def __init__(self, endpoint: str, chance: random.Random) -> None:
        at = urlsplit(endpoint)
        self._target, self._chance = (str(at.hostname), int(at.port or 80)), chance
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.mode: Mode = ""
        self.share = 0.5
        self.spoilt = 0
        """Number of connections and answers with an injected fault."""
        threading.Thread(target=self._serve, name="bad-network", daemon=True).start()

    @property
    def endpoint(self) -> str:
        return f"http://127.0.0.1:{self._listener.getsockname()[1]}"

    def close(self) -> None:
        self._listener.close()

    def _serve(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                threading.Thread(target=self._pass_on, args=(client,), daemon=True).start()

    def _hits(self) -> bool:
        hit = bool(self.mode) and self._chance.random() < self.share
        self.spoilt += hit
        return hit

    def _pass_on(self, client: socket.socket) -> None:
        with client, suppress(OSError):
            if self.mode == "503" and self._hits():
                client.recv(_CHUNK)
                client.sendall(_BUSY)
                return
            with socket.create_connection(self._target, 5) as server:
                server.settimeout(None)
                back = threading.Thread(target=self._copy, args=(server, client, True), daemon=True)
                back.start()
                self._copy(client, server, False)
                back.join()

    def _copy(self, source: socket.socket, sink: socket.socket, answers: bool) -> None:
        with suppress(OSError):
            while data := source.recv(_CHUNK):
                if answers and self.mode and self._hits() and not self._spoil(data, sink):
                    break
                sink.sendall(data)
        for end in (source, sink):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def _spoil(self, data: bytes, sink: socket.socket) -> bool:
        """Inject the current fault; whether the connection continues."""
        if self.mode == "slow":
            time.sleep(self._chance.uniform(0.1, 1.0))
            return True
        if self.mode == "truncate":
            sink.sendall(data[: len(data) // 2])
        return self.mode == "503"
