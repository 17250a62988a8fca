"""What goes out on a live connection, and how it is closed. A client that does not read holds up nobody but itself."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from contextlib import suppress
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from pipeline.errors import ImpastoError
from service.errors import problem
from service.live.closing import Ending, Lost, close_code, shown
from service.live.messages import ErrorOut, Outgoing
from service.sockets import ABORT
from workers.live.seats import NoSeat

CLOSE_WITHIN_S = 2.0
GONE_WITHIN_S = 1.0


class Voice:
    """Sends on an accepted WebSocket. Whole messages, from any task.

    Args:
        slow_s: how long the client may take to make room for a message.
    """

    def __init__(self, socket: WebSocket, slow_s: float) -> None:
        self._socket, self._slow_s = socket, slow_s

    async def say(self, message: Outgoing) -> None:
        """Raises Ending: the client does not read."""
        await self._within(self._socket.send_text(message.model_dump_json(exclude_none=True)))

    async def show(self, frame: bytes) -> None:
        """Send a binary message. Raises Ending: the client does not read."""
        await self._within(self._socket.send_bytes(frame))

    async def refuse(self, error: ImpastoError) -> None:
        """Say that a message was refused; the stream goes on."""
        await self.say(ErrorOut(fatal=False, problem=problem(error, self._socket.url.path)))

    async def fail(self, failure: Exception) -> None:
        """The error, if the connection can still carry it, and the close."""
        error = shown(failure)
        wait_s = error.retry_after_s if isinstance(error, NoSeat) else None
        message = ErrorOut(fatal=True, problem=problem(error, self._socket.url.path), retry_after_s=wait_s)
        with suppress(Exception):
            async with asyncio.timeout(CLOSE_WITHIN_S):
                await self._socket.send_text(message.model_dump_json(exclude_none=True))
        await self.close(close_code(error), error.code)

    async def close(self, code: int, reason: str) -> None:
        """Close in order if the client lets us, else drop the connection."""
        try:
            async with asyncio.timeout(CLOSE_WITHIN_S):
                await self._socket.close(code, reason)
        except Exception:
            abort = self._socket.scope.get("extensions", {}).get(ABORT)
            if abort is not None:
                abort["call"]()

    async def _within(self, sending: Coroutine[Any, Any, None]) -> None:
        try:
            async with asyncio.timeout(self._slow_s):
                await sending
        except WebSocketDisconnect:
            await asyncio.sleep(GONE_WITHIN_S)  # who reads knows how it went, and ends this
            raise Lost from None
        except TimeoutError:
            raise Ending(
                "slow-reader", f"Answers were not read for {self._slow_s:g} s.", remedy="Connect again."
            ) from None
