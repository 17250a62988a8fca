"""Sends messages on a live connection, and closes it. A client that does not read delays only its own session."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from contextlib import suppress

from starlette.websockets import WebSocket, WebSocketDisconnect

from pipeline.errors import ImpastoError
from service.connections import ABORT
from service.errors import problem
from service.live.closing import Ending, Lost, close_code, shown
from service.live.messages import ErrorOut, Outgoing
from workers.live.worker import NoLiveWorker

CLOSE_WITHIN_S = 2.0
GONE_WITHIN_S = 1.0


class MessageSender:
    """Sends whole messages on an accepted WebSocket, from any task.

    Args:
        slow_s: how long sending one message may block before the client counts as too slow, seconds.
    """

    def __init__(self, socket: WebSocket, slow_s: float) -> None:
        self._socket, self._slow_s = socket, slow_s

    async def send_message(self, message: Outgoing) -> None:
        """Send a JSON message. Raises Ending: the client does not read."""
        await self._within(self._socket.send_text(message.model_dump_json(exclude_none=True)))

    async def send_frame(self, frame: bytes) -> None:
        """Send a binary message. Raises Ending: the client does not read."""
        await self._within(self._socket.send_bytes(frame))

    async def send_error(self, error: ImpastoError) -> None:
        """Report that a message was refused; the stream continues."""
        await self.send_message(ErrorOut(fatal=False, problem=problem(error, self._socket.url.path)))

    async def fail(self, failure: Exception) -> None:
        """Send the error, if the connection still works, then close."""
        error = shown(failure)
        wait_s = error.retry_after_s if isinstance(error, NoLiveWorker) else None
        message = ErrorOut(fatal=True, problem=problem(error, self._socket.url.path), retry_after_s=wait_s)
        with suppress(Exception):
            async with asyncio.timeout(CLOSE_WITHIN_S):
                await self._socket.send_text(message.model_dump_json(exclude_none=True))
        await self.close(close_code(error), error.code)

    async def close(self, code: int, reason: str) -> None:
        """Close with a closing handshake; drop the connection if the client does not answer in time."""
        try:
            async with asyncio.timeout(CLOSE_WITHIN_S):
                await self._socket.close(code, reason)
        except Exception:
            abort = self._socket.scope.get("extensions", {}).get(ABORT)
            if abort is not None:
                abort["call"]()

    async def _within(self, sending: Coroutine[object, None, None]) -> None:
        try:
            async with asyncio.timeout(self._slow_s):
                await sending
        except WebSocketDisconnect:
            await asyncio.sleep(GONE_WITHIN_S)  # the reader learns the close code and ends the session
            raise Lost from None
        except TimeoutError:
            raise Ending(
                "slow-reader", f"Answers were not read for {self._slow_s:g} s.", remedy="Connect again."
            ) from None
