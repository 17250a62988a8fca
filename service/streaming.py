"""Answers that are sent in pieces.

If a client leaves before the end, Starlette does not close the source of the pieces; Python's garbage collection does,
perhaps minutes later. Until then a preview would keep its slot, so that two such previews block all others, and a
download would keep its file open. Here a source is closed as soon as its answer ends.
"""

from __future__ import annotations

from collections.abc import AsyncGenerator, Callable, Generator, Iterator, Mapping

from anyio import CancelScope, CapacityLimiter
from anyio.to_thread import run_sync
from starlette.concurrency import run_in_threadpool
from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send


class StreamedResponse(StreamingResponse):
    """An answer whose source is always closed when the answer ends.

    Args:
        source: iterator of the pieces. A synchronous one is read in threads that other requests share; see `in_threads`
            for a source that may be slow.
        on_disconnect: called once if the client leaves, even while a piece is being made.
    """

    def __init__(
        self,
        source: Iterator[bytes] | AsyncGenerator[str] | AsyncGenerator[bytes],
        status_code: int,
        headers: Mapping[str, str],
        media_type: str,
        on_disconnect: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(source, status_code, headers, media_type)
        self._source, self._on_disconnect = source, on_disconnect

    async def listen_for_disconnect(self, receive: Receive) -> None:
        await super().listen_for_disconnect(receive)
        self._on_disconnect()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            with CancelScope(shield=True):
                await _close(self.body_iterator)
                await _close(self._source)


async def in_threads(source: Iterator[bytes], threads: CapacityLimiter) -> AsyncGenerator[bytes]:
    """Yield the pieces of a source that may be slow, each read in one of `threads`, so that no other request waits.

    A generator is closed at the end, in such a thread, too.
    """
    try:
        while (piece := await run_sync(next, source, None, limiter=threads)) is not None:
            yield piece
    finally:
        if isinstance(source, Generator):
            with CancelScope(shield=True):
                await run_sync(source.close, limiter=threads)


async def _close(source: object) -> None:
    if isinstance(source, AsyncGenerator):
        await source.aclose()
    elif isinstance(source, Generator):
        await run_in_threadpool(source.close)
