"""A live client written from docs/live.md alone: a real WebSocket, and none of our code."""

from __future__ import annotations

import asyncio
import json
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from websockets.asyncio.client import ClientConnection, connect

HEADER = struct.Struct(">BBHHHIIQQ")


@dataclass(frozen=True)
class Answer:
    key: bool
    size: tuple[int, int]
    sequence: int
    latency_us: int
    timestamp: int
    payload: bytes


def pack(sequence: int, size: tuple[int, int], payload: bytes, key: bool = True, timestamp: int = 0) -> bytes:
    return HEADER.pack(1, key, *size, 0, sequence, 0, timestamp, 0) + payload


def unpack(data: bytes) -> Answer:
    version, flags, width, height, _, sequence, latency, timestamp, _ = HEADER.unpack_from(data)
    assert version == 1
    return Answer(flags == 1, (width, height), sequence, latency, timestamp, data[HEADER.size :])


def jpeg(frame: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".jpg", frame[..., ::-1])[1].tobytes()


@dataclass
class LiveClient:
    socket: ClientConnection
    ready: dict[str, Any] = field(default_factory=dict)
    messages: list[dict[str, Any]] = field(default_factory=list)
    """JSON messages that arrived while another one was awaited."""
    answers: list[Answer] = field(default_factory=list)
    sequence: int = 0

    async def hello(self, **fields: Any) -> dict[str, Any]:
        await self.send_message({"type": "hello", "width": 96, "height": 64, "method": "toy", **fields})
        self.ready = await self.message("ready")
        return self.ready

    async def send_message(self, message: Any) -> None:
        await self.socket.send(json.dumps(message))

    async def send(self, payload: bytes, size: tuple[int, int] = (96, 64), key: bool = True, timestamp: int = 0) -> int:
        self.sequence += 1
        await self.socket.send(pack(self.sequence, size, payload, key, timestamp))
        return self.sequence

    async def receive(self, timeout_s: float = 30.0) -> None:
        """Sort one more message."""
        data = await asyncio.wait_for(self.socket.recv(), timeout_s)
        if isinstance(data, bytes):
            self.answers.append(unpack(data))
        else:
            self.messages.append(json.loads(data))

    async def message(self, kind: str, timeout_s: float = 30.0) -> dict[str, Any]:
        """The next JSON message of this type; earlier messages are discarded."""
        async with asyncio.timeout(timeout_s):
            while True:
                while self.messages:
                    if (found := self.messages.pop(0))["type"] == kind:
                        return found
                await self.receive()

    async def answer(self, timeout_s: float = 30.0) -> Answer:
        async with asyncio.timeout(timeout_s):
            while not self.answers:
                await self.receive()
        return self.answers.pop(0)

    async def closed(self) -> tuple[int, str]:
        """Read until the service closes the connection; (code, reason)."""
        try:
            while True:
                await self.receive()
        except Exception:
            await self.socket.wait_closed()
        return self.socket.close_code or 0, self.socket.close_reason or ""


@asynccontextmanager
async def live(url: str, query: str = "", **more: Any) -> AsyncIterator[LiveClient]:
    address = url.replace("http", "ws") + "/v1/live" + query
    async with connect(address, compression=None, max_size=1 << 26, open_timeout=60, **more) as socket:
        yield LiveClient(socket)
