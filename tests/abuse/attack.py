"""Sends requests as fast as a number of connections allows, in a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import multiprocessing
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection


@dataclass(frozen=True)
class Call:
    """One request: the head without its length, and the body."""

    head: bytes
    body: bytes = b""
    chunked: bool = False

    def data(self) -> bytes:
        return self.head + b"Content-Length: %d\r\nConnection: close\r\n\r\n" % len(self.body) + self.body


@dataclass(frozen=True)
class Attack:
    """What is sent, by how many connections at once.

    Attributes:
        slow_s: pause between two bytes of a body, seconds; 0: all at once.
        patience_s: time after which a client leaves, seconds.
    """

    name: str
    calls: tuple[Call, ...]
    parallel: int
    slow_s: float = 0.0
    patience_s: float = 10.0


def attack(made: Attack, place: tuple[str, int], seconds: float, result: Connection) -> None:
    """Run it, and send the number of answers by status: 0 for none."""
    result.send(asyncio.run(_attack(made, place, seconds)))


def in_process(
    made: Attack, place: tuple[str, int], seconds: float
) -> tuple[multiprocessing.process.BaseProcess, Connection]:
    """Start it in a process of its own."""
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe(duplex=False)
    process = spawn.Process(target=attack, args=(made, place, seconds, there), daemon=True)
    process.start()
    return process, here


async def _attack(made: Attack, place: tuple[str, int], seconds: float) -> Counter[int]:
    found: Counter[int] = Counter()
    if not made.parallel:
        await asyncio.sleep(seconds)
    calls, until = itertools.cycle(made.calls), time.monotonic() + seconds
    await asyncio.gather(*(_repeat(made, calls, place, until, found) for _ in range(made.parallel)))
    return found


async def _repeat(
    made: Attack, calls: Iterator[Call], place: tuple[str, int], until: float, found: Counter[int]
) -> None:
    while (left := until - time.monotonic()) > 0:
        status = 0
        with contextlib.suppress(OSError, TimeoutError, ValueError, asyncio.IncompleteReadError):
            async with asyncio.timeout(min(made.patience_s, left + 1)):
                status = await _ask(next(calls), place, made.slow_s)
        found[status] += 1
        if status in (0, 429, 503):
            await asyncio.sleep(0.05)


async def _ask(call: Call, place: tuple[str, int], slow_s: float) -> int:
    reader, writer = await asyncio.open_connection(*place)
    try:
        data = call.data()
        if slow_s:
            writer.write(data[: len(data) - len(call.body)])
            for byte in call.body:
                writer.write(bytes([byte]))
                await asyncio.sleep(slow_s)
        else:
            writer.write(data)
            with contextlib.suppress(ConnectionError):
                await writer.drain()
        line = await reader.readline()
        while await reader.read(1 << 16):
            pass
        return int(line.split()[1]) if line else 0
    finally:
        writer.transport.abort()
