"""Request bodies: JSON is small, strict and read whole; uploads are streamed to disk, counted, and may not stall."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import AsyncIterator
from typing import Any, NoReturn

from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect, Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pipeline.errors import ImpastoError
from service.errors import BadJson, BodyTooLarge, RequestTimeout, UnsupportedMediaType, respond

STREAMED = ("/v1/assets", "/v1/uploads")
"""Their bodies are files: their routes read them themselves."""


class JsonBodies:
    """Reads every other body before its route: bounded in bytes and seconds, JSON by type and by content."""

    def __init__(self, app: ASGIApp, max_bytes: int, idle_s: float) -> None:
        self._app, self._max_bytes, self._idle_s = app, max_bytes, idle_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["path"].startswith(STREAMED):
            await self._app(scope, receive, send)
            return
        try:
            body = await self._read(scope, receive)
        except ImpastoError as error:
            await respond(error, scope["path"])(scope, receive, send)
            return
        except ClientDisconnect:
            return
        await self._app(scope, _replay(body, receive), send)

    async def _read(self, scope: Scope, receive: Receive) -> bytes:
        parts = [chunk async for chunk in chunks(Request(scope, receive), self._max_bytes, self._idle_s)]
        body = b"".join(parts)
        if body:
            _check_type(Headers(scope=scope).get("content-type", ""))
            strict_json(body)
        return body


def _replay(body: bytes, receive: Receive) -> Receive:
    """A `receive` that gives the body that was read, then goes on with the connection (to see it close)."""
    waiting: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def replay() -> Message:
        return waiting.pop() if waiting else await receive()

    return replay


def _check_type(content_type: str) -> None:
    kind = content_type.partition(";")[0].strip().lower()
    if kind != "application/json":
        raise UnsupportedMediaType(
            "The body must be JSON.",
            field="Content-Type",
            value=content_type,
            remedy="Send the header 'Content-Type: application/json'.",
        )


async def chunks(request: Request, max_bytes: int, idle_s: float) -> AsyncIterator[bytes]:
    """The body's pieces as they arrive.

    Raises: BodyTooLarge beyond `max_bytes`, RequestTimeout when nothing comes for `idle_s`, ClientDisconnect.
    """
    announced = request.headers.get("content-length", "")
    if announced.isdecimal() and int(announced[:20]) > max_bytes:
        _too_large(max_bytes, announced)
    stream, total = request.stream(), 0
    while True:
        try:
            chunk = await asyncio.wait_for(anext(stream), idle_s)
        except StopAsyncIteration:
            return
        except TimeoutError:
            raise RequestTimeout("The body stopped arriving.", field="body", remedy="Send it again.") from None
        total += len(chunk)
        if total > max_bytes:
            _too_large(max_bytes, total)
        if chunk:
            yield chunk


def _too_large(max_bytes: int, value: object) -> NoReturn:
    raise BodyTooLarge(f"The body is larger than {max_bytes} bytes.", field="body", value=value, remedy="Send less.")


def strict_json(body: bytes) -> Any:
    """Parse JSON as RFC 8259 has it: no NaN or Infinity, numbers that fit a float, text that is Unicode without NUL.

    Raises: BadJson.
    """
    try:
        parsed = json.loads(body, parse_constant=_no_constant, parse_float=_finite)
        text = json.dumps(parsed, ensure_ascii=False)
        text.encode()
    except (ValueError, RecursionError) as error:
        raise BadJson("The body is not JSON.", field="body", remedy=f"Mend it: {error}.") from None
    if "\\u0000" in text:
        raise BadJson("The body holds a NUL character.", field="body", remedy="Leave it out.")
    return parsed


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:40]} is too large for a number")
    return number
