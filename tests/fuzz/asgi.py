"""Requests and WebSockets to an ASGI application in this process, without sockets and without a client's checks."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

Header = tuple[str, str]
SLOW_S = 30.0
"""A request that takes longer counts as a hang."""
_READ_S = 0.3
"""A client reads a stream for this long, seconds, then disconnects."""
_END_WAIT_S = 0.02
"""A WebSocket client stays connected for this long after its last message, seconds."""
HOST: Header = ("host", "127.0.0.1")


@dataclass(frozen=True)
class Reply:
    """A response. `status` 599: the application raised an exception or did not answer; `body` has the details."""

    status: int
    headers: dict[str, str]
    body: bytes
    taken: int = 0
    """Number of WebSocket messages that the application has received."""


class Application:
    """An ASGI application on the running event loop."""

    def __init__(self, app: Any) -> None:
        self._app = app

    async def request(self, method: str, target: str, headers: Sequence[Header] = (), body: bytes = b"") -> Reply:
        """Send a request; `target` is the path with its query, as sent, without escapes being checked."""
        path, _, query = target.partition("?")
        scope = _scope("http", path, query, headers) | {"method": method}
        return await _bounded(self._exchange(scope, body))

    async def live(self, target: str, messages: Sequence[str | bytes], headers: Sequence[Header] = ()) -> Reply:
        """Open a WebSocket, send the messages, then leave; the status is the close code (1000: the client left, the
        service had not closed), or the HTTP status of the refusal."""
        path, _, query = target.partition("?")
        scope = _scope("websocket", path, query, headers) | {"subprotocols": []}
        return await _bounded(self._talk(scope, messages))

    async def _exchange(self, scope: dict[str, Any], body: bytes) -> Reply:
        waiting = [{"type": "http.request", "body": body, "more_body": False}]
        over, parts, start = asyncio.Event(), [], {"status": 599, "headers": []}

        async def receive() -> dict[str, Any]:
            if waiting:
                return waiting.pop()
            with suppress(TimeoutError):
                await asyncio.wait_for(over.wait(), _READ_S)
            return {"type": "http.disconnect"}

        async def send(message: dict[str, Any]) -> None:
            if message["type"] == "http.response.start":
                start.update(message)
            elif message["type"] == "http.response.body":
                parts.append(message.get("body", b""))
                if not message.get("more_body", False):
                    over.set()

        await self._app(scope, receive, send)
        return Reply(start["status"], _decoded(start["headers"]), b"".join(parts))

    async def _talk(self, scope: dict[str, Any], messages: Sequence[str | bytes]) -> Reply:
        waiting: list[dict[str, Any]] = [{"type": "websocket.connect"}]
        kinds = {str: "text", bytes: "bytes"}
        waiting += [{"type": "websocket.receive", kinds[type(text)]: text} for text in messages]
        waiting.append({"type": "websocket.disconnect", "code": 1000})
        status, reason, answered = 1000, "", asyncio.Event()

        async def receive() -> dict[str, Any]:
            given = len(messages) + 2 - len(waiting)
            if given > 1:  # a client says no more before the service has answered its greeting
                await answered.wait()
            if len(waiting) == 1:
                await asyncio.sleep(_END_WAIT_S)
                return waiting[0]
            return waiting.pop(0)

        async def send(message: dict[str, Any]) -> None:
            nonlocal status, reason
            if message["type"] != "websocket.accept":
                answered.set()
            if message["type"] == "websocket.close":
                status, reason = message.get("code", 1000), message.get("reason") or ""
            elif message["type"] == "websocket.http.response.start":
                status = message["status"]

        await self._app(scope, receive, send)
        taken = len(messages) + 1 - max(1, len(waiting))
        return Reply(status, {}, reason.encode(), max(0, min(taken, len(messages))))


async def _bounded(work: Awaitable[Reply]) -> Reply:
    try:
        async with asyncio.timeout(SLOW_S):
            return await work
    except Exception as error:
        return Reply(599, {}, f"{type(error).__name__}: {error}".encode())


def _scope(kind: str, path: str, query: str, headers: Sequence[Header]) -> dict[str, Any]:
    encoded = [(name.lower().encode("latin-1", "replace"), text.encode("latin-1", "replace"))
               for name, text in (HOST, *headers)]  # fmt: skip
    return {
        "type": kind, "asgi": {"version": "3.0"}, "http_version": "1.1",
        "scheme": "ws" if kind == "websocket" else "http",
        "path": path, "raw_path": path.encode("utf-8", "replace"), "query_string": query.encode("utf-8", "replace"),
        "root_path": "", "headers": encoded, "client": ("127.0.0.1", 50000), "server": ("127.0.0.1", 8420),
        "extensions": {"websocket.http.response": {}},
    }  # fmt: skip


def _decoded(headers: Sequence[tuple[bytes, bytes]]) -> dict[str, str]:
    return {name.decode("latin-1"): text.decode("latin-1") for name, text in headers}
