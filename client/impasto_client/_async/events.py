"""Events of a job: resumed after a broken connection, and replaced by polling if streams are not available."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

import httpx

from impasto_client.events import NotAStream, Parser, ServerEvent
from impasto_client.problems import error_of

SILENCE_S = 45.0
"""Maximum interval of comments or events in a stream, seconds; a longer silence means a broken connection."""
LONGEST_PAUSE_S = 10.0


async def follow(
    http: httpx.AsyncClient, path: str, *, after: int = 0, poll_s: float = 1.0
) -> AsyncIterator[ServerEvent | None]:
    """Yield the events of `path` with seq > `after`, without end.

    Yields None when the caller should read the state itself: after a heartbeat, after a broken connection, which is
    resumed after the last event, and every `poll_s` seconds if no stream is available.
    """
    last, pause = after, 0.0
    while True:
        try:
            async for event in _stream(http, path, last):
                last, pause = max(last, event.seq if event else 0), 0.0
                yield event
        except NotAStream:
            while True:
                yield None
                await asyncio.sleep(poll_s)
        except httpx.TransportError:
            pause = min(max(2 * pause, poll_s), LONGEST_PAUSE_S)
        yield None
        await asyncio.sleep(pause or min(poll_s, 0.2))


async def _stream(http: httpx.AsyncClient, path: str, last: int) -> AsyncIterator[ServerEvent | None]:
    headers = {"Accept": "text/event-stream"} | ({"Last-Event-ID": str(last)} if last else {})
    timeout = httpx.Timeout(http.timeout.connect, read=SILENCE_S)
    async with http.stream("GET", path, headers=headers, timeout=timeout) as response:
        if response.status_code in (429, 502, 503, 504):
            raise httpx.ReadError(f"the service answered {response.status_code}")
        if response.status_code in (401, 403, 404):
            await response.aread()
            raise error_of(response)
        if not response.headers.get("content-type", "").startswith("text/event-stream"):
            raise NotAStream
        parser = Parser()
        async for line in response.aiter_lines():
            for event in parser.line(line):
                yield event
