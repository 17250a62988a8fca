"""API throughput: submissions and reads per second, and latency with 10,000 jobs and a job of 100,000 tasks.

The service is one process without workers, which would compete with it for the processors. It runs on SQLite and on a
real PostgreSQL. The client keeps a fixed number of connections open, each with one request in flight. For each kind of
request, the table shows the highest rate at which the 99th percentile of the latency is at most 100 ms. Client, service
and PostgreSQL share two processors. PostgreSQL does not flush to disk (tests.real.postgres), SQLite does.
"""

from __future__ import annotations

import asyncio
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from benchmarks.dispatch import _plan, _queue, _submit
from workers.store import Store

CONNECTIONS = (1, 2, 4, 8, 16)
SECONDS, RUNS = 1.5, 3
"""Length of a measurement, and measurements per number of connections. The best one counts, since the load of the
machine varies."""
P99_MS = 100.0
SIZES = ((10, 100), (10_000, 100_000))
"""(queued jobs of 50 owners, tasks of one more job)"""
READS = 30
ADMIN = "a key for this benchmark only"


@dataclass
class Load:
    """Responses to one kind of request, measured with a fixed number of connections."""

    connections: int
    seconds: float = 0.0
    cpu_s: float = 0.0
    """CPU time of the service, seconds."""
    took_ms: list[float] = field(default_factory=list)

    @property
    def rate(self) -> float:
        return len(self.took_ms) / self.seconds

    def percentile(self, percent: int) -> float:
        return statistics.quantiles(self.took_ms, n=100, method="inclusive")[percent - 1]


Ask = Callable[["Connection", int], Awaitable[object]]


class Connection:
    """A minimal HTTP/1.1 client with keep-alive; a full client uses more CPU time than the service."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    async def ask(self, verb: str, path: str, body: object = None) -> bytes:
        """Send a request; returns the response body. Raises RuntimeError unless the status is 2xx."""
        data = b"" if body is None else json.dumps(body).encode()
        head = f"{verb} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
        head += f"Authorization: Bearer {ADMIN}\r\nContent-Length: {len(data)}\r\n\r\n"
        self._writer.write(head.encode() + data)
        lines = (await self._reader.readuntil(b"\r\n\r\n")).decode().split("\r\n")
        length = next(int(line[15:]) for line in lines if line.lower().startswith("content-length:"))
        answer = await self._reader.readexactly(length)
        if lines[0].split()[1][0] != "2":
            raise RuntimeError(f"{verb} {path}: {lines[0]}: {answer[:300]!r}")
        return answer

    async def first_event(self, path: str) -> bytes:
        """Read an event stream to the end of its first event. The connection cannot be used afterwards."""
        head = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {ADMIN}\r\n\r\n"
        self._writer.write(head.encode())
        while b"data: " not in (line := await self._reader.readuntil(b"\n")):
            pass
        return line

    def close(self) -> None:
        self._writer.close()


def main() -> None:
    """Print tables for each database."""
    with tempfile.TemporaryDirectory(prefix="impasto-api-") as folder:
        _measure("SQLite", lambda size: f"sqlite:///{Path(folder) / f'{size[1]}.db'}")
    from tests.real.postgres import Postgres, missing

    if reason := missing():
        print(f"no PostgreSQL: {reason}")
        return
    server = Postgres()
    server.start()
    try:
        _measure("PostgreSQL", lambda size: server.fresh())
    finally:
        server.close()


def _measure(name: str, url: Callable[[tuple[int, int]], str]) -> None:
    for size in SIZES:
        place = url(size)
        store = Store(place)
        _queue(store, size[0])
        big = _submit(store, priority=1)
        _plan(store, big, size[1])
        store.close()
        print(f"\n{name}, {size[0]:,} jobs and a job of {size[1]:,} tasks")
        with _service(place) as (port, service):
            asyncio.run(_all(port, service, big))


@contextmanager
def _service(database: str) -> Iterator[tuple[int, psutil.Process]]:
    """Run `impasto serve` without workers; yields its port and process."""
    with tempfile.TemporaryDirectory(prefix="impasto-home-") as home:
        given = {"POOL": "none", "ADMIN_KEY": ADMIN, "REQUESTS_PER_MINUTE": "1000000", "QUOTA_ACTIVE_JOBS": "1000000"}
        env = os.environ | {f"IMPASTO_{name}": value for name, value in given.items()}
        env["IMPASTO_DATABASE_URL"] = database
        command = [sys.executable, "-m", "impasto", "serve", "--port", "0", "--home", home]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=env
        ) as service:
            assert service.stdout is not None
            try:
                port = int(service.stdout.readline().rpartition(":")[2])
                yield port, psutil.Process(service.pid)
            finally:
                service.terminate()


async def _all(port: int, service: psutil.Process, big: str) -> None:
    ready = await _open(port)
    asset = await _asset(port)
    job = json.loads(await ready.ask("POST", "/v1/jobs", _job(asset)))["id"]
    print("    request                connections  a second    p50 ms    p99 ms    CPU ms of the service")
    for name, ask in {
        "submit a job": lambda c, n: c.ask("POST", "/v1/jobs", _job(asset, n)),
        "read a job": lambda c, n: c.ask("GET", f"/v1/jobs/{job}"),
        "healthz": lambda c, n: c.ask("GET", "/healthz"),
    }.items():
        best = await _best(port, service, ask)
        row = f"{best.connections:10d}{best.rate:10.0f}{best.percentile(50):10.1f}{best.percentile(99):10.1f}"
        row += f"{1e3 * best.cpu_s / len(best.took_ms):10.2f}"
        print(f"    {name:<24}{row}")
    await _looks(port, big)
    ready.close()


async def _looks(port: int, big: str) -> None:
    """Median and maximum latency of sequential requests on one connection."""
    print("    one at a time              median ms   slowest ms")
    for name, path in {
        "the large job": f"/v1/jobs/{big}",
        "newest 50 jobs": "/v1/jobs?limit=50",
        "queued jobs of a method": "/v1/jobs?state=queued&method=toy&limit=50",
        "100 tasks of the job": f"/v1/jobs/{big}/tasks?limit=100",
        "its timeline": f"/v1/ops/jobs/{big}/timeline",
        "operators' snapshot": "/v1/ops/snapshot",
        "failures": "/v1/ops/failures",
        "metrics": "/metrics",
    }.items():
        connection = await _open(port)
        took = [await _time(connection.ask("GET", path)) for _ in range(READS)]
        print(f"    {name:<24}{statistics.median(took):12.1f}{max(took):12.1f}")
        connection.close()
    took = []
    for _ in range(READS):
        connection = await _open(port)
        took.append(await _time(connection.first_event(f"/v1/jobs/{big}/events")))
        connection.close()
    print(f"    {'first event':<24}{statistics.median(took):12.1f}{max(took):12.1f}")
    connection = await _open(port)
    cancelled = await _time(connection.ask("POST", f"/v1/jobs/{big}/cancel"))
    print(f"    {'cancel the large job':<24}{cancelled:12.1f}")
    connection.close()


async def _best(port: int, service: psutil.Process, ask: Ask) -> Load:
    """The load with the highest rate whose 99th percentile is within `P99_MS`; if none is, the one with the lowest."""
    loads = [await _load(port, service, ask, connections) for _ in range(RUNS) for connections in CONNECTIONS]
    in_time = [load for load in loads if load.percentile(99) <= P99_MS]
    if not in_time:
        return min(loads, key=lambda load: load.percentile(99))
    return max(in_time, key=lambda load: load.rate)


async def _load(port: int, service: psutil.Process, ask: Ask, connections: int) -> Load:
    load, before = Load(connections), service.cpu_times()
    began = time.perf_counter()
    await asyncio.gather(*(_client(port, ask, load, began + SECONDS) for _ in range(connections)))
    load.seconds, after = time.perf_counter() - began, service.cpu_times()
    load.cpu_s = after.user + after.system - before.user - before.system
    return load


async def _client(port: int, ask: Ask, load: Load, until: float) -> None:
    connection = await _open(port)
    while time.perf_counter() < until:
        load.took_ms.append(await _time(ask(connection, len(load.took_ms))))
    connection.close()


async def _time(answer: Awaitable[object]) -> float:
    """Milliseconds until the response has arrived."""
    began = time.perf_counter()
    await answer
    return 1e3 * (time.perf_counter() - began)


async def _open(port: int) -> Connection:
    return Connection(*await asyncio.open_connection("127.0.0.1", port))


def _job(asset: str, seed: int = 0) -> dict[str, object]:
    return {"method": "abstraction", "inputs": {"video": asset}, "seed": seed, "labels": {"shot": str(seed)}}


async def _asset(port: int) -> str:
    """Upload a clip; the id of its asset."""
    import httpx

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "clip.mp4"
        words = ["scene", "cut", "-o", str(path), "--size", "96x64", "--frames", "12", "--quiet"]
        subprocess.run([sys.executable, "-m", "impasto", *words], check=True, stdout=subprocess.DEVNULL)
        headers = {"Authorization": f"Bearer {ADMIN}"}
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", headers=headers, timeout=60) as client:
            answer = await client.post("/v1/assets", files={"file": ("clip.mp4", path.read_bytes())})
            return str(answer.json()["id"])


if __name__ == "__main__":
    main()
