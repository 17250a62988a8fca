"""Request bodies: JSON is bounded, strict and read whole; uploads are streamed and must not stall."""

from __future__ import annotations

import asyncio
import json
import math
import re
import time
from collections.abc import AsyncIterator, Sequence
from itertools import accumulate
from typing import NoReturn

from pydantic import JsonValue
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect, Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pipeline.errors import ImpastoError
from service.errors import BadJson, BodyTooLarge, RequestTimeout, UnsupportedMediaType, respond

MIN_BYTES_PER_S = 1024
"""Minimum rate of a body; slower ones are aborted, because each occupies a connection."""
MAX_DEPTH = 64
"""Maximum depth of lists and objects in a JSON body."""
_STRINGS = re.compile(rb'"(?:[^"\\]|\\.)*+"?', re.DOTALL)
_NO_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))
STREAMED = ("/v1/assets", "/v1/uploads", "/v1/projects/import", "/v1/live/whip", "/v1/live/whep")
"""Paths whose routes read the body themselves."""


PROJECTS = "/v1/projects"
"""Paths of project documents and their previews, whose bodies are larger and may be patches."""
PATCHES = ("application/json-patch+json", "application/merge-patch+json")


class JsonBodies:
    """Reads every other body before its route is called, checks that it is JSON, and limits its size and time.

    Args:
        max_project_bytes: maximum size of bodies for routes of projects.
    """

    def __init__(self, app: ASGIApp, max_bytes: int, max_project_bytes: int, idle_s: float) -> None:
        self._app, self._max_bytes, self._idle_s = app, max_bytes, idle_s
        self._max_project_bytes = max_project_bytes

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
        limit = self._max_project_bytes if scope["path"].startswith(PROJECTS) else self._max_bytes
        parts = [chunk async for chunk in chunks(Request(scope, receive), limit, self._idle_s)]
        body = b"".join(parts)
        if body:
            patch = scope["method"] == "PATCH" and scope["path"].startswith(PROJECTS)
            _check_type(Headers(scope=scope).get("content-type", ""), PATCHES if patch else ("application/json",))
            strict_json(body)
        return body


def _replay(body: bytes, receive: Receive) -> Receive:
    """A `receive` that returns the body that was read, then the connection's further messages (its end)."""
    waiting: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def replay() -> Message:
        return waiting.pop() if waiting else await receive()

    return replay


def _check_type(content_type: str, known: Sequence[str]) -> None:
    kind = content_type.partition(";")[0].strip().lower()
    if kind not in known:
        raise UnsupportedMediaType(
            "The body must be JSON.",
            field="Content-Type",
            value=content_type,
            remedy=f"Send the header 'Content-Type: {' or '.join(known)}'.",
        )


async def chunks(request: Request, max_bytes: int, idle_s: float) -> AsyncIterator[bytes]:
    """The parts of the body as they arrive.

    Raises: BodyTooLarge beyond `max_bytes`, RequestTimeout if fewer than `MIN_BYTES_PER_S` bytes a second arrive over
    `idle_s` seconds, ClientDisconnect.
    """
    announced = request.headers.get("content-length", "")
    if announced.isdecimal() and int(announced[:20]) > max_bytes:
        _too_large(max_bytes, announced)
    stream, total = request.stream(), 0
    window_total, window_end = 0, time.monotonic() + idle_s
    while True:
        try:
            chunk = await asyncio.wait_for(anext(stream), max(0.0, window_end - time.monotonic()))
        except StopAsyncIteration:
            return
        except TimeoutError:
            raise _too_slow(total) from None
        total += len(chunk)
        if total - window_total >= MIN_BYTES_PER_S * idle_s:
            window_total, window_end = total, time.monotonic() + idle_s
        if total > max_bytes:
            _too_large(max_bytes, total)
        if chunk:
            yield chunk


def _too_slow(received: int) -> RequestTimeout:
    return RequestTimeout(
        "The body arrives too slowly.",
        field="body",
        value=f"{received} bytes so far",
        remedy=f"Send at least {MIN_BYTES_PER_S} bytes a second.",
    )


def _too_large(max_bytes: int, value: object) -> NoReturn:
    raise BodyTooLarge(f"The body is larger than {max_bytes} bytes.", field="body", value=value, remedy="Send less.")


def strict_json(body: bytes) -> JsonValue:
    """Parse JSON by RFC 8259: no NaN or Infinity, numbers within float64, valid Unicode without NUL, bounded depth.

    Raises: BadJson.
    """
    _check_depth(body)
    try:
        parsed: JsonValue = json.loads(body, parse_constant=_no_constant, parse_float=_finite)
        text = json.dumps(parsed, ensure_ascii=False)
        text.encode()
    except (ValueError, RecursionError) as error:
        raise BadJson("The body is not JSON.", field="body", remedy=f"Correct it: {error}.") from None
    if "\\u0000" in text:
        raise BadJson("The body contains a NUL character.", field="body", remedy="Remove it.")
    return parsed


def _check_depth(body: bytes) -> None:
    """Refuse deep nesting before a recursive parser reads it. Brackets inside strings do not count."""
    brackets = _STRINGS.sub(b"", body).translate(None, _NO_BRACKETS)
    depth = max(accumulate(1 if byte in b"[{" else -1 for byte in brackets), default=0)
    if depth > MAX_DEPTH:
        raise BadJson(
            f"The body nests deeper than {MAX_DEPTH} levels.", field="body", value=depth, remedy="Nest less deeply."
        )


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:40]} is too large for a number")
    return number
