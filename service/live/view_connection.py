"""A viewer's WebSocket: painted frames of a live session go out, requests for key frames come in."""

from __future__ import annotations

import asyncio

from starlette.websockets import WebSocket

from service.access.keys import Principal
from service.context.depends import ServiceContext
from service.errors import BadMessage
from service.live.closing import NORMAL, Ending, Left, Lost
from service.live.frames import pack
from service.live.message_sender import MessageSender
from service.live.messages import KeyframeIn, ViewReadyOut, ViewWaitingOut, parse, receiving
from service.live.sessions import LiveSession, Sessions
from service.live.viewers import ViewedSound, Viewer, ViewFormat

MAX_VIEWERS = 16
"""Maximum number of viewers of a session."""
SEARCH_INTERVAL_S = 0.25
"""Seconds between searches for a session while there is none."""


class ViewConnection:
    """
    Args:
        socket: accepted.
        session_id: the session to show; None: the caller's newest one, and after its end the next one.
        sound: whether the viewer gets the sound of the session, too.
    """

    def __init__(
        self,
        socket: WebSocket,
        context: ServiceContext,
        sessions: Sessions,
        principal: Principal,
        session_id: str | None,
        sound: bool = False,
    ) -> None:
        self._socket, self._context, self._sessions = socket, context, sessions
        self._principal, self._session_id, self._sound = principal, session_id, sound
        self._sender = MessageSender(socket, context.settings.live_slow_s)
        self._viewer: Viewer | None = None

    async def run(self) -> None:
        """Serve until the viewer leaves, the service stops, or the session of that id has ended."""
        works = [asyncio.create_task(work) for work in (self._watch_sessions(), self._read())]
        try:
            done, _ = await asyncio.wait(works, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for work in works:
                work.cancel()
            await asyncio.gather(*works, return_exceptions=True)
        try:
            for work in done:
                work.result()
            await self._sender.close(NORMAL, "bye")
        except (Lost, Left):
            return
        except Exception as error:
            await self._sender.fail(error)

    async def _watch_sessions(self) -> None:
        while True:
            session = self._sessions.watched(self._session_id, self._principal)
            if session is None:
                if self._session_id is not None:
                    return
                session = await self._next_session()
            await self._watch(session)

    async def _next_session(self) -> LiveSession:
        await self._sender.send_message(ViewWaitingOut())
        while (found := self._sessions.watched(None, self._principal)) is None:
            if self._context.closing.is_set():
                raise Ending("going-away", "The service stops.", remedy="Connect again in a moment.")
            await asyncio.sleep(SEARCH_INTERVAL_S)
        return found

    async def _watch(self, session: LiveSession) -> None:
        """Send the session's frames until it ends."""
        if len(session.viewers) >= MAX_VIEWERS:
            raise Ending("rate-limited", f"A session has at most {MAX_VIEWERS} viewers.", remedy="Close another one.")
        with session.viewers.watch(self._sound) as viewer:
            self._viewer = viewer
            while (item := await viewer.next()) is not None:
                if isinstance(item, ViewFormat):
                    await self._sender.send_message(_ready(session, item))
                elif isinstance(item, ViewedSound):
                    await self._sender.send_frame(item.message)
                else:
                    await self._sender.send_frame(pack(item.header, item.payload))

    async def _read(self) -> None:
        """Handle the viewer's messages until it leaves."""
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                raise Left
            if not isinstance(parse(str(message.get("text") or "")), KeyframeIn):
                raise BadMessage("A viewer sends only keyframe.", field="type", remedy="See docs/live.md, Watching.")
            if self._viewer is not None:
                self._viewer.request_key()


def _ready(session: LiveSession, form: ViewFormat) -> ViewReadyOut:
    width, height = form.size
    return ViewReadyOut(
        session=session.id, receive=receiving(form.codec, form.size, form.fps), width=width, height=height, fps=form.fps
    )
