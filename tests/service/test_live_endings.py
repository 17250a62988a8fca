"""All ways in which a live connection can end, without effect on other connections."""

from __future__ import annotations

import asyncio
import json
import socket
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psutil
import pytest

from tests.service.live_client import LiveClient, live, pack
from tests.service.test_live import FRAME, PICTURE, SIZE, echo, free, hello, looped, served

__all__ = ["echo"]


@pytest.fixture
def url(home: Path) -> Iterator[str]:
    with served(home) as (address, _):
        yield address


async def ended(client: LiveClient) -> tuple[int, str, dict[str, Any]]:
    """(close code, reason, problem) of a connection that the service closes."""
    code, reason = await client.closed()
    errors = [m for m in client.messages if m["type"] == "error"]
    assert errors[-1]["fatal"]
    assert errors[-1]["problem"]["code"] == reason
    return code, reason, errors[-1]["problem"]


FIRST = {"type": "hello", "width": 96, "height": 64, "method": "echo"}


@pytest.mark.parametrize(
    ("first", "code", "reason", "field"),
    [
        ("no json", 4400, "bad-message", "message"),
        ('{"type": "cat"}', 4400, "bad-message", "type"),
        ('{"type": "bye"}', 4400, "bad-message", "type"),
        (pack(1, SIZE, FRAME), 4400, "bad-message", "type"),
        (json.dumps({"type": "hello"}), 4400, "bad-parameter", "width"),
        (json.dumps(FIRST | {"width": 8}), 4400, "bad-parameter", "width"),
        (json.dumps(FIRST | {"height": 4000}), 4400, "bad-parameter", "height"),
        (json.dumps(FIRST | {"fps": 0}), 4400, "bad-parameter", "fps"),
        (json.dumps(FIRST | {"fps": 1e9}), 4400, "bad-parameter", "fps"),
        (json.dumps(FIRST | {"send": ["cat"]}), 4400, "bad-parameter", "send"),
        (json.dumps(FIRST | {"receive": ["cat"]}), 4400, "bad-parameter", "receive"),
        (json.dumps(FIRST | {"params": {"add": -1}}), 4400, "bad-parameter", "params.add"),
        (json.dumps(FIRST | {"method": "toy"}), 4400, "bad-parameter", "method"),
        (json.dumps(FIRST | {"method": "cat"}), 4404, "not-found", "method"),
        (json.dumps(FIRST | {"inputs": {"reference": "ast_x"}}), 4404, "not-found", "inputs.reference"),
        ('{"type": "bye", "x": "' + "y" * (2 << 20) + '"}', 4413, "too-large", "message"),
    ],
)
def test_an_invalid_first_message_ends_the_session(
    url: str, first: str | bytes, code: int, reason: str, field: str
) -> None:
    @looped
    async def run() -> None:
        async with live(url) as client:
            await client.socket.send(first)
            got, why, problem = await ended(client)
            assert (got, why, problem["field"]) == (code, reason, field)
            assert problem["remedy"]

    run()
    assert free(url) == 2


HEADER = struct.Struct(">BBHHHIIQQ")


@pytest.mark.parametrize(
    ("message", "code", "reason"),
    [
        (b"", 4400, "bad-message"),
        (b"short", 4400, "bad-message"),
        (pack(5, SIZE, b""), 4400, "bad-message"),
        (HEADER.pack(2, 1, *SIZE, 0, 5, 0, 0, 0) + FRAME, 4400, "bad-message"),
        (HEADER.pack(1, 6, *SIZE, 0, 5, 0, 0, 0) + FRAME, 4400, "bad-message"),
        (pack(1, SIZE, FRAME), 4400, "bad-message"),
        (pack(5, (2000, 64), FRAME), 4413, "too-large"),
        (pack(5, (96, 8), FRAME), 4415, "bad-frame"),
        (pack(5, (64, 64), FRAME), 4415, "bad-frame"),
        (pack(5, SIZE, b"garbage" * 99), 4415, "bad-frame"),
        (pack(5, SIZE, bytes((12 << 20) + 1)), 4413, "too-large"),
        (json.dumps(FIRST), 4400, "bad-message"),
        ("{", 4400, "bad-message"),
    ],
)
def test_invalid_frames_end_only_their_session(url: str, message: str | bytes, code: int, reason: str) -> None:
    @looped
    async def run() -> None:
        async with live(url) as healthy, live(url) as bad:
            await hello(healthy)
            await hello(bad)
            await bad.send(FRAME)
            await bad.answer()
            await bad.socket.send(message)
            assert (await ended(bad))[:2] == (code, reason)
            await healthy.send(FRAME)
            assert (await healthy.answer()).sequence == 1

    run()


@looped
async def test_a_missing_hello_ends_the_session(home: Path) -> None:
    with served(home, live_hello_s=0.2) as (url, _):
        async with live(url) as client:
            assert (await ended(client))[:2] == (4408, "hello-timeout")


@looped
async def test_frames_before_ready_end_the_session(url: str) -> None:
    async with live(url) as client:
        await client.send_message(FIRST | {"params": {"open_s": 0.3}})
        await client.socket.send(pack(1, SIZE, FRAME))
        assert (await ended(client))[:2] == (4400, "bad-message")
    assert await asyncio.to_thread(free, url) == 2


@looped
async def test_a_client_that_leaves_before_ready(url: str) -> None:
    async with live(url) as client:
        await client.send_message(FIRST | {"params": {"open_s": 0.3}})
        await asyncio.sleep(0.05)
    assert await asyncio.to_thread(free, url) == 2


@looped
async def test_a_session_without_frames_times_out(home: Path) -> None:
    with served(home, live_idle_s=0.3) as (url, _):
        async with live(url) as client:
            await hello(client)
            for _ in range(3):
                await asyncio.sleep(0.15)
                await client.send(FRAME)
            await client.send_message({"type": "keyframe"})
            assert (await ended(client))[:2] == (4410, "idle")


@looped
async def test_too_many_frames_end_the_session(url: str) -> None:
    async with live(url) as client:
        await hello(client)
        for number in range(1, 260):
            await client.socket.send(pack(number, SIZE, FRAME))
        assert (await ended(client))[:2] == (4429, "rate-limited")


@pytest.mark.parametrize("fault", ["analyze", "paint"])
def test_internal_errors_end_the_session_with_1011(url: str, fault: str) -> None:
    @looped
    async def run() -> None:
        async with live(url) as client:
            await hello(client, params={"fault": fault})
            await client.send(FRAME)
            code, reason, problem = await ended(client)
            assert (code, reason) == (1011, "internal-error")
            assert "injected" not in problem["detail"]

    run()
    assert free(url) == 2


def test_a_service_shutdown_ends_the_session(home: Path) -> None:
    @looped
    async def run() -> None:
        with served(home) as (url, _):
            client = await stack(url)
        assert await client.closed() == (1001, "going-away")
        assert client.messages[-1]["problem"]["code"] == "going-away"

    async def stack(url: str) -> LiveClient:
        holder = live(url)
        client = await holder.__aenter__()
        await hello(client)
        asyncio.get_running_loop().create_task(_read(client))
        return client

    async def _read(client: LiveClient) -> None:
        await client.closed()

    run()


class Deaf:
    """A client that sends a hello and frames and never reads."""

    def __init__(self, url: str, message: bytes) -> None:
        host, port = url.removeprefix("http://").split(":")
        self.socket = socket.create_connection((host, int(port)))
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        key = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
        head = f"GET /v1/live HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n{key}\r\n"
        self.socket.sendall(head.encode())
        assert b"101" in self.socket.recv(16)
        fields = {"send": ["raw"], "receive": ["raw"], "width": 640, "height": 480}
        self.write(0x81, json.dumps(FIRST | fields).encode())
        self.message, self.number = message, 0

    def write(self, kind: int, data: bytes) -> None:
        size = struct.pack(">BQ", 0xFF, len(data))
        self.socket.sendall(bytes([kind]) + size + bytes(4) + data)

    def send(self) -> None:
        self.number += 1
        self.write(0x82, pack(self.number, (640, 480), self.message))


def test_a_client_that_does_not_read_does_not_delay_others(home: Path) -> None:
    picture = np.zeros((480, 640, 3), np.uint8).tobytes()

    @looped
    async def run() -> None:
        with served(home, live_slow_s=1.5, live_ping_s=0.5) as (url, _):
            async with live(url) as healthy:
                await hello(healthy)
                deaf = await asyncio.to_thread(Deaf, url, picture)
                before = psutil.Process().memory_info().rss
                for number in range(60):
                    await asyncio.to_thread(deaf.send)
                    await healthy.send(FRAME)
                    assert (await healthy.answer(2)).latency_us < 500_000
                    if number == 40:
                        assert psutil.Process().memory_info().rss - before < 60 << 20
                    await asyncio.sleep(0.02)
                assert await asyncio.to_thread(free, url, 4, 1) == 1
                deaf.socket.close()

    run()


def test_a_vanished_client_is_detected_by_ping(home: Path) -> None:
    @looped
    async def run() -> None:
        with served(home, live_ping_s=0.3, live_resume_s=0.2) as (url, _):
            gone = await asyncio.to_thread(Deaf, url, b"")
            await asyncio.sleep(0.2)
            assert await asyncio.to_thread(free, url, 0.1, 1) == 1
            assert await asyncio.to_thread(free, url, 3) == 2
            gone.socket.close()

    run()


def test_the_test_picture_matches_its_header() -> None:
    assert PICTURE.shape == (SIZE[1], SIZE[0], 3)


def test_an_operator_sees_a_session_and_ends_it(url: str) -> None:
    @looped
    async def run() -> None:
        async with live(url) as client:
            ready = await hello(client)
            await client.send(FRAME)
            async with asyncio.timeout(20):
                while not (found := await asyncio.to_thread(_sessions, url)):
                    await asyncio.sleep(0.1)
            (session,) = found
            assert (session["id"], session["method"], session["connected"]) == (ready["session"], "echo", True)
            assert (session["width"], session["height"]) == SIZE
            answer = await asyncio.to_thread(httpx.post, f"{url}/v1/ops/live/{session['id']}/end")
            assert answer.status_code == 202
            assert (await ended(client))[:2] == (4403, "dismissed")

    run()
    assert free(url) == 2


def _sessions(url: str) -> list[dict[str, Any]]:
    items: list[dict[str, Any]] = httpx.get(f"{url}/v1/ops/live").json()["items"]
    return items
