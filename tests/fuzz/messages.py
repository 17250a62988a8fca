"""Live sessions over the application's WebSocket with valid and changed messages and frames: no internal errors."""

from __future__ import annotations

import asyncio
import json
import struct
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from pipeline.methods import methods
from pipeline.methods.base import seeded
from tests.fuzz.ledger import Run
from tests.fuzz.mutate import mutated
from tests.fuzz.samples import samples
from tests.fuzz.service import application
from tests.fuzz.values import Random, changed_json, changed_text, pick
from tests.workers.live_toys import Echo

STEP = 300
"""Number of connections in a step, which has its own service."""
MOST_MESSAGES = 12
_HEADER = struct.Struct(">BBHHHIIQQ")
_FAILED = (1011, 500, 599)
"""Close code and statuses that report an internal error."""
_SIDE = (48, 32)


def fuzz(run: Run, folder: Path, goes_on: Callable[[], bool]) -> None:
    """Steps until the time is up; one that is begun is ended. A case is a message that the service has taken.
    Frames are painted by a test method, which costs no time and which this process has from then on."""
    found = {**methods(), "echo": Echo()}
    for place in ("pipeline.methods", "workers.live.sessions", "service.live.connection"):
        import_module(place).methods = lambda: found  # type: ignore[attr-defined]
    while goes_on():
        number = run.first + run.steps
        asyncio.run(step(run, folder / f"messages-{number}", number))
        run.steps += 1


async def step(run: Run, folder: Path, number: int, connections: int = STEP) -> None:
    """One step: its messages depend on the seed and the number alone."""
    folder.mkdir()
    random = seeded(run.seed, 23, number)
    async with application(folder) as (app, known):
        for index in range(connections):
            sent = messages(known["asset_id"][0], random)
            began = time.monotonic()
            reply = await app.live("/v1/live", sent)
            await asyncio.sleep(0.001)  # a session ends a moment after its connection
            for _ in range(reply.taken):
                run.count(f"closed {reply.status}", (time.monotonic() - began) / reply.taken)
            if reply.status in _FAILED:
                what = f"{reply.status} {reply.body[:300]!r}: {sent!r}"
                run.findings[f"messages:{run.seed}:{number}:{index}"] = what[:600]


def messages(asset_id: str, random: Random) -> list[str | bytes]:
    """Messages of one connection: a hello, then frames and messages."""
    hello: dict[str, Any] = {
        "type": "hello", "method": "echo", "width": _SIDE[0], "height": _SIDE[1], "fps": 25.0, "seed": 1,
        "send": ["jpeg"], "receive": ["jpeg"], "params": {"add": 3}, "inputs": {}, "quality": 80,
    }  # fmt: skip
    first = hello if random.random() < 0.7 else changed_json(hello, random)
    sent: list[str | bytes] = [_text(first, random)]
    sequence = 0
    for _ in range(int(random.integers(MOST_MESSAGES))):
        if random.random() < 0.7:
            sequence += int(random.integers(1, 3)) if random.random() < 0.98 else -1
            sent.append(_frame(max(0, sequence), random))
        else:
            other = pick(random, _others(asset_id))
            sent.append(_text(other if random.random() < 0.8 else changed_json(other, random), random))
    return sent


def _others(asset_id: str) -> tuple[Any, ...]:
    change = {"type": "params", "params": {"add": 3}, "inputs": {"reference": asset_id}}
    return {"type": "keyframe"}, {"type": "bye"}, change, hello_again()


def hello_again() -> dict[str, Any]:
    """A second hello, which a running session must refuse."""
    return {"type": "hello", "width": 8, "height": 8}


def _text(value: Any, random: Random) -> str:
    text = json.dumps(value)
    return changed_text(text, random) if random.random() < 0.05 else text


def _frame(sequence: int, random: Random) -> bytes:
    payload = samples()["jpg"][0]
    if random.random() < 0.2:
        payload = mutated(payload, payload, int(random.integers(2**31)), 0)
    size = _SIDE if random.random() < 0.95 else (int(random.integers(70000) % 65536), int(random.integers(300)))
    data = _HEADER.pack(1, int(random.integers(2)), *size, 0, sequence, 0, sequence * 40_000, 0) + payload
    return mutated(data, data, int(random.integers(2**31)), 1) if random.random() < 0.05 else data
