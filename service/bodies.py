"""Request bodies: JSON is bounded, strict and read whole; uploads are streamed and must not stall."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from typing import NoReturn

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect, Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pipeline.errors import ImpastoError
from service.access.admission import Admission, Cost
from service.errors import BodyTooLarge, RequestTimeout, UnsupportedMediaType, respond
from workers.strict_json import MAX_VALUES, BadJson, strict_json

MIN_BYTES_PER_S = 1024
"""Minimum rate of a body; slower ones are aborted, because each occupies a connection."""
LARGE_BYTES = 64 * 1024
"""A larger body needs a slot (`Cost.BODY`) until the answer begins: parsed, it may take fifty times its size."""
MOST_MEMBERS = 1000
"""Members of a body, not of objects in it. Each unknown one is a fault, which costs a thousand times its bytes."""
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
        async with AsyncExitStack() as until_answered:
            try:
                body = await self._read(scope, receive, until_answered)
            except ImpastoError as error:
                await respond(error, scope["path"])(scope, receive, send)
                return
            except ClientDisconnect:
                return

            async def answer(message: Message) -> None:
                await until_answered.aclose()
                await send(message)

            await self._app(scope, _replay(body, receive), answer)

    async def _read(self, scope: Scope, receive: Receive, until_answered: AsyncExitStack) -> bytes:
        project = scope["path"].startswith(PROJECTS)
        limit = self._max_project_bytes if project else self._max_bytes
        parts: list[bytes] = []
        total = 0
        async for chunk in chunks(Request(scope, receive), limit, self._idle_s):
            parts.append(chunk)
            total += len(chunk)
            if total > LARGE_BYTES >= total - len(chunk):
                await until_answered.enter_async_context(_slot(scope))
        body = b"".join(parts)
        if body:
            patches = PATCHES if project and scope["method"] == "PATCH" else ("application/json",)
            _check_type(Headers(scope=scope).get("content-type", ""), patches)
            await self._check(body, MAX_VALUES if project else MAX_VALUES // 10)
        return body

    async def _check(self, body: bytes, max_values: int) -> None:
        large = len(body) > LARGE_BYTES
        parsed = await run_in_threadpool(strict_json, body, max_values) if large else strict_json(body, max_values)
        if isinstance(parsed, dict) and len(parsed) > MOST_MEMBERS:
            raise BadJson(
                f"The body has more than {MOST_MEMBERS} members.", field="body", value=len(parsed),
                remedy="See /docs for the fields.",
            )  # fmt: skip


def _slot(scope: Scope) -> AbstractAsyncContextManager[None]:
    """A slot for the large body of a request, which is not read on while it waits."""
    admission: Admission = scope["app"].state.service.admission
    address = f"@{scope['client'][0]}" if scope.get("client") else "@"
    return admission.one(Cost.BODY, scope.get("state", {}).get("principal"), address)


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
