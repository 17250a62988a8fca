"""Every call to S3, the database and HTTP has an end in time: all clients, found in the sources, and their limits."""

from __future__ import annotations

import ast
import re
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from pipeline.errors import StorageError
from tests.conftest import ROOT
from tests.real.postgres import Postgres
from workers.blobs.local_copies import LocalCopies
from workers.blobs.s3 import S3Blobs
from workers.blobs.s3_client import CALL_S, CONNECT_S, READ_S, S3Options, client_for
from workers.settings import FarmSettings
from workers.store.database import BUSY_TIMEOUT_S, Database

CALLS = (
    "httpx.Client", "httpx.AsyncClient", "httpx.get", "httpx.post", "httpx.stream", "httpx.request", "urlopen",
    "create_connection", "open_connection", "client", "create_engine", "AsyncConnectionPool", "connect", "av.open",
)  # fmt: skip
"""Calls that open a connection, or might: the last parts of their names."""
LIMITS = {
    ("client/impasto_client/_async/http.py", "httpx.AsyncClient"): "timeout=timeout",
    ("client/impasto_client/_sync/http.py", "httpx.Client"): "timeout=timeout",
    ("impasto/live/service.py", "httpx.get"): "timeout=2.0",
    ("impasto/live/whip.py", "httpx.AsyncClient"): "timeout=CONNECT_S",
    ("impasto/live/client.py", "connect"): "open_timeout=",
    ("impasto/live/broadcast.py", "av.open"): "options=options",  # rw_timeout
    ("impasto/live/sources.py", "av.open"): r"timeout=\(OPEN_S, OPEN_S\)|srt://",
    ("service/webhooks/connect.py", "httpcore.AsyncConnectionPool"): "",  # asyncio.timeout around each delivery
    ("workers/live/channel.py", "asyncio.open_connection"): "",  # asyncio.wait_for
    ("workers/blobs/s3_client.py", "boto3.session.Session().client"): "config=config",
    ("workers/store/database.py", "create_engine"): "pool_timeout=10",
    ("workers/store/database.py", "self.engine.connect"): "",
    ("workers/store/postgres.py", "BoundedConnection.connect"): "",
    ("workers/live/ray_workers.py", "LiveWorkerClient.connect"): "",
    ("workers/pools/ray_pool.py", "connect"): "",  # Ray's own limits
}
"""(File, call) -> a pattern of the limit in its arguments; empty: it is set elsewhere."""
LOCAL_FILES = re.compile(r"""av\.open\(\s*(f["']file:|str\(|io\.BytesIO\()""")


def _clients() -> Iterator[tuple[str, str, str]]:
    """(File, name of the call, its text) of every call in the product that opens a connection."""
    for package in ("impasto", "service", "workers", "pipeline", "client/impasto_client"):
        for path in sorted((ROOT / package).rglob("*.py")):
            text = path.read_text()
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.Call):
                    name, call = ast.unparse(node.func), ast.unparse(node)
                    opens = any(name == known or name.endswith(f".{known}") for known in CALLS)
                    if opens and not LOCAL_FILES.match(call):
                        yield str(path.relative_to(ROOT)), name, call


def test_every_client_has_its_time_limit() -> None:
    found = list(_clients())
    unknown = [(file, name) for file, name, _ in found if (file, name) not in LIMITS]
    assert not unknown, "add the time limit of the call, and then its row to LIMITS"
    missing = [call for file, name, call in found if not re.search(LIMITS[file, name], call)]
    assert not missing, "the call has lost its time limit"
    assert {(file, name) for file, name, _ in found} == LIMITS.keys(), "a row without a call"


def test_a_call_to_s3_ends_before_its_attempt_counts_as_hanging() -> None:
    config = client_for(S3Options("bucket", region="here", access_key="a", secret_key="b")).meta.config
    assert (config.connect_timeout, config.read_timeout) == (CONNECT_S, READ_S)
    assert FarmSettings().stall_s > CALL_S + CONNECT_S + READ_S


def test_a_wait_for_sqlite_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert FarmSettings().stall_s > BUSY_TIMEOUT_S
    url = f"sqlite:///{tmp_path / 'a.db'}"
    database = Database(url)
    monkeypatch.setattr("workers.store.database.BUSY_TIMEOUT_S", 0.1)
    with database.write(), pytest.raises(StorageError), Database(url).write():
        pass


@pytest.mark.real("postgres")
def test_a_frozen_postgresql_is_given_up(postgres: Postgres, monkeypatch: pytest.MonkeyPatch) -> None:
    database = Database(postgres.fresh())
    database.check()
    monkeypatch.setattr("workers.store.postgres.ANSWER_S", 1.0)
    server = psutil.Process(postgres.process.pid)
    frozen = [server, *server.children(recursive=True)]
    for process in frozen:
        process.suspend()
    try:
        began = time.monotonic()
        with pytest.raises(StorageError):
            database.check()
        assert time.monotonic() - began < 10
    finally:
        for process in reversed(frozen):
            process.resume()
    database.check()
    database.close()


# -- S3


class BadServer:
    """Records the requests that it gets, and cuts each connection, or answers nothing."""

    def __init__(self, answer: bytes | None) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._answer = answer
        self.requests: list[bytes] = []
        self.endpoint = f"http://127.0.0.1:{self._listener.getsockname()[1]}"
        self._open: list[socket.socket] = []
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            client, _ = self._listener.accept()
            self.requests.append(client.recv(1 << 16))
            if self._answer is None:
                self._open.append(client)
            else:
                client.sendall(self._answer)
                client.close()

    def blobs(self, folder: Path) -> S3Blobs:
        options = S3Options("bucket", "", self.endpoint, "here", "key", "secret", "path")
        return S3Blobs(options, LocalCopies(folder / "copies", 1 << 20))


@pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 100 Continue\r\nx: ", b"HTTP/1.1 200 OK\r\nx: "])
def test_an_answer_of_s3_that_is_cut_ends_the_call(
    answer: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In botocore's `_consume_headers`, the second one is an endless loop."""
    monkeypatch.setattr("workers.blobs.s3_client._TRIES", 2)
    server = BadServer(answer)
    calling = threading.Thread(target=_put, args=(server.blobs(tmp_path),), daemon=True)
    calling.start()
    calling.join(20)
    assert not calling.is_alive(), "it hangs"
    assert server.requests
    assert not any(b"expect:" in request.lower() for request in server.requests)


def _put(blobs: S3Blobs) -> None:
    with suppress(StorageError):
        blobs.put("k", b"v")


def test_a_silent_s3_is_not_tried_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("workers.blobs.s3_client.READ_S", 1.0)
    monkeypatch.setattr("workers.blobs.s3_client.CALL_S", 2.0)
    server = BadServer(None)
    began = time.monotonic()
    with pytest.raises(StorageError):
        server.blobs(tmp_path).put("k", b"v")
    assert time.monotonic() - began < 8
    assert len(server.requests) < 5
