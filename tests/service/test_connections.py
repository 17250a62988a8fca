"""Connections that wait for ever: bounded in time and number, and never the end of other clients' service."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import logging
import resource
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest

from service.connections import ConnectionGuard, Phase, connection_limit
from service.log_limit import BURST, WINDOW_S, RepeatFilter
from tests.processes import started

DESCRIPTORS, HALF_SENT = 1024, 1200
HEADER_S, IDLE_S = 3.0, 4.0
PROGRAM = """
import resource, sys
from pathlib import Path
limit = int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_NOFILE, (limit // 2, limit))
from service.server import serve
from service.settings import Settings
settings = Settings(home=Path(sys.argv[1]), port=0, pool="local", workers=1, header_s=3.0, idle_s=4.0, live_hello_s=3.0,
    requests_per_minute=1_000_000)
serve(settings, lambda url: print(url, flush=True))
"""
UNFINISHED = {
    "headers": b"GET /v1/methods HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ",
    "body": (
        b"POST /v1/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\nContent-Length: 900\r\n\r\n{"
    ),
    "websocket": (
        b"GET /v1/live HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
        b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: " + base64.b64encode(bytes(16)) + b"\r\n\r\n"
    ),
}
"""An incomplete request, by the part that is missing."""


class Line(asyncio.Transport):
    """A transport that only records calls."""

    def __init__(self) -> None:
        super().__init__()
        self.closed, self.unsent, self.sent = False, 0, b""

    def abort(self) -> None:
        self.closed = True

    close = abort

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self.sent += bytes(data)

    def get_write_buffer_size(self) -> int:
        return self.unsent


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def guard(clock: Clock) -> ConnectionGuard:
    return ConnectionGuard(3, header_s=10, stall_s=20, silent_s=40, clock=clock)


def opened(guard: ConnectionGuard, clock: Clock, *phases: Phase) -> list[Line]:
    lines = []
    for phase in phases:
        clock.now += 1
        lines.append(Line())
        guard.enter(lines[-1], phase)
    return lines


def test_the_limit_leaves_descriptors_for_files() -> None:
    assert connection_limit(1024, 4096) == 768
    assert connection_limit(65536, 4096) == 4096
    assert connection_limit(130, 4096) == 2


def test_the_connection_that_waits_longest_is_closed_first(guard: ConnectionGuard, clock: Clock) -> None:
    lines = opened(guard, clock, Phase.BODY, Phase.HEADERS, Phase.HEADERS, Phase.HEADERS)
    assert [line.closed for line in lines] == [False, True, False, False]


def test_with_no_idle_connection_the_newest_is_refused(guard: ConnectionGuard, clock: Clock) -> None:
    lines = opened(guard, clock, Phase.ANSWER, Phase.WEBSOCKET, Phase.ANSWER, Phase.HEADERS)
    assert [line.closed for line in lines] == [False, False, False, True]
    assert lines[3].sent.startswith(b"HTTP/1.1 503")
    assert len(guard) == 3


def test_connections_with_slow_headers_are_closed_and_slow_requests_are_not(
    guard: ConnectionGuard, clock: Clock
) -> None:
    slow, busy, live = opened(guard, clock, Phase.HEADERS, Phase.ANSWER, Phase.WEBSOCKET)
    clock.now += 5
    guard.enter(slow, Phase.HEADERS)  # more bytes of the same headers do not buy time
    clock.now += 6
    guard.sweep()
    assert (slow.closed, busy.closed, live.closed) == (True, False, False)


def test_a_connection_whose_answer_is_not_read_is_closed(guard: ConnectionGuard, clock: Clock) -> None:
    unread, read = opened(guard, clock, Phase.ANSWER, Phase.ANSWER)
    for step in range(5):
        unread.unsent, read.unsent = 1000, 1000 + step
        clock.now += 6
        guard.sweep()
    assert (unread.closed, read.closed) == (True, False)


def test_an_answer_that_is_read_slowly_is_not_cut_off_by_the_limit_for_headers(
    guard: ConnectionGuard, clock: Clock
) -> None:
    (slow,) = opened(guard, clock, Phase.HEADERS)  # the whole answer is in the transport's buffer
    for step in range(5):
        slow.unsent = 9000 - 1000 * step
        clock.now += 6
        guard.sweep()
    assert not slow.closed


def test_a_websocket_that_sends_nothing_is_closed(guard: ConnectionGuard, clock: Clock) -> None:
    silent, alive = opened(guard, clock, Phase.WEBSOCKET, Phase.WEBSOCKET)
    for _ in range(5):
        clock.now += 10
        guard.record_bytes(alive)
        guard.sweep()
    assert (silent.closed, alive.closed) == (True, False)


def test_repeated_warnings_are_dropped_and_counted(clock: Clock) -> None:
    passes = RepeatFilter(clock)

    def record(level: int, text: str = "accept() failed: %s") -> logging.LogRecord:
        return logging.LogRecord("asyncio", level, "x.py", 1, text, ("EMFILE",), None)

    assert sum(passes.filter(record(logging.ERROR)) for _ in range(1000)) == BURST
    assert passes.filter(record(logging.ERROR, "something else"))
    assert all(passes.filter(record(logging.INFO)) for _ in range(100))
    clock.now += WINDOW_S + 1
    again = record(logging.ERROR)
    assert passes.filter(again)
    assert again.getMessage() == f"accept() failed: EMFILE ({1000 - BURST} similar lines were dropped)"


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path, int]]:
    """A service of its own with few descriptors: address, its log, its process."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 2 * HALF_SENT:
        pytest.skip("this process may not open enough sockets")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 2 * HALF_SENT), hard))
    folder = tmp_path_factory.mktemp("served")
    log = folder / "log.txt"
    command = [sys.executable, "-c", PROGRAM, str(folder / "home"), str(DESCRIPTORS)]
    with log.open("wb") as sink, started(command, stdout=subprocess.PIPE, stderr=sink, text=True) as process:
        assert process.stdout is not None
        yield process.stdout.readline().strip(), log, process.pid
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.parametrize("missing", UNFINISHED)
def test_incomplete_requests_do_not_block_the_service(
    served: tuple[str, Path, int], tiny_clip: Path, missing: str
) -> None:
    url, log, pid = served
    where = urlsplit(url)
    fresh = httpx.Limits(max_keepalive_connections=0)  # an idle connection may be closed to make room
    with contextlib.ExitStack() as stack, httpx.Client(base_url=url, timeout=20, limits=fresh) as http:
        answer = http.post("/v1/assets", files={"file": ("a.mp4", tiny_clip.read_bytes())})
        assert answer.is_success, answer.text
        asset = answer.json()["id"]
        job = http.post("/v1/jobs", json={"method": "abstraction", "inputs": {"video": asset}}).json()["id"]
        for _ in range(HALF_SENT):
            line = stack.enter_context(socket.create_connection((where.hostname, where.port), timeout=10))
            with contextlib.suppress(OSError):
                line.sendall(UNFINISHED[missing])
        assert descriptors(pid) < DESCRIPTORS * 0.95
        began = time.monotonic()
        assert http.get("/v1/methods").status_code == 200
        assert time.monotonic() - began < 15
        assert finished(http, job) == "succeeded"
        deadline = time.monotonic() + 60
        while descriptors(pid) >= DESCRIPTORS / 2:
            assert time.monotonic() < deadline, "half-sent requests are kept"
            time.sleep(0.2)
    assert log.stat().st_size < 1 << 20


def descriptors(pid: int) -> int:
    """Number of open files of a process."""
    return sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir())


def finished(http: httpx.Client, job: str) -> str:
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline:
        answer = http.get(f"/v1/jobs/{job}")
        assert answer.is_success, answer.text
        state = answer.json()["state"]
        if state not in ("queued", "running"):
            return str(state)
        time.sleep(0.2)
    return "unfinished"


def test_a_request_with_two_lengths_is_refused_and_closed(served: tuple[str, Path, int]) -> None:
    where = urlsplit(served[0])
    hidden = b"GET /v1/methods HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    with socket.create_connection((where.hostname, where.port), timeout=10) as line:
        line.sendall(
            b"POST /v1/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\nContent-Length: 5\r\n"
            b"Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n" + hidden
        )
        answer = b"".join(iter(lambda: line.recv(1 << 16), b""))
    assert answer.startswith(b"HTTP/1.1 400") and answer.count(b"HTTP/1.1") == 1
