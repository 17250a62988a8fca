"""The live sessions of this process, connected or waiting for a lost client to reconnect.

A session outlives its connection by `resume_s` seconds: it keeps its stream, its worker and its slot.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable, Mapping
from typing import Protocol

from service.access.keys import EVERYONE, LIVE_SESSIONS, Principal, Scope
from service.live.closing import Ending
from service.live.viewers import Viewers
from service.ops.metrics import LiveMetrics
from workers.contract.request import Json
from workers.ids import new_id
from workers.live.sessions import LiveSessions, SessionSlot
from workers.live.stream import Stream
from workers.operator_views import LiveView

log = logging.getLogger(__name__)


class Connected(Protocol):
    """The part of a connection that sessions use."""

    async def stop(self, ending: Ending) -> None:
        """End the connection. Returns when it has released its session."""
        ...

    async def wait_closed(self) -> None:
        """Wait until its WebSocket is closed."""
        ...


class LiveSession:
    """A live session: its slot, its stream, and the connection that it serves."""

    def __init__(self, place: SessionSlot, owner: str, session_id: str) -> None:
        self.id = session_id
        self.owner = owner
        self.place = place
        self.stream: Stream | None = None
        self.inputs: Mapping[str, str] = {}
        """Asset ids by input name."""
        self.connection: Connected | None = None
        self.expiry: asyncio.TimerHandle | None = None
        self.opened_at = time.time()
        self.viewers = Viewers()
        self.counted = (0, 0, 0)
        """(received, painted, dropped) frames that metrics have counted."""


class Sessions:
    """Sessions by id. Use it on the event loop only; `count` may run elsewhere.

    Args:
        live: the farm's live sessions.
        resume_s: how long a session waits for a lost client, seconds.
    """

    def __init__(self, live: LiveSessions, metrics: LiveMetrics, resume_s: float) -> None:
        self.live, self.metrics = live, metrics
        self._resume_s = resume_s
        self._sessions: dict[str, LiveSession] = {}
        self._closing = False
        self.closers: list[Callable[[], Awaitable[None]]] = []
        """Called by `close`, for connections that have no session."""
        self._ends: set[asyncio.Task[None]] = set()

    def check_free(self) -> None:
        """Raise NoLiveWorker if `claim` would raise it for a new session now."""
        self.live.place().release()

    async def claim(
        self, session_id: str | None, principal: Principal, connection: Connected, named: str = ""
    ) -> LiveSession:
        """The caller's session of that id, whose present connection is closed; otherwise a new session, whose id is
        `named` if that is not empty.

        Raises NoLiveWorker.
        """
        known = self._sessions.get(session_id or "")
        if known is None or known.owner != principal.owner:
            owner = None if principal is EVERYONE else principal.owner
            place = self.live.place(owner, principal.quotas.get(LIVE_SESSIONS))
            known = LiveSession(place, principal.owner, named or new_id("liv_"))
            self._sessions[known.id] = known
        before, known.connection = known.connection, connection
        if known.expiry is not None:
            known.expiry.cancel()
            known.expiry = None
        if before is not None:
            await before.stop(Ending("taken-over", "Another connection has resumed this session."))
        return known

    def leave(self, session: LiveSession, connection: Connected) -> None:
        """The connection was lost: let the session wait for a new one. No effect if a new one has taken the session
        over."""
        if session.connection is not connection or session.id not in self._sessions:
            return
        session.connection = None
        self.count(session)
        if session.stream is None or self._closing:
            self.end(session)
            return
        session.stream.detach()
        session.expiry = asyncio.get_running_loop().call_later(self._resume_s, self.end, session)

    def views(self) -> list[LiveView]:
        """Sessions that have a stream, for operators. The caller fills in the process."""
        return [_view(session, session.stream) for session in self._sessions.values() if session.stream is not None]

    def watched(self, session_id: str | None, principal: Principal) -> LiveSession | None:
        """The session of that id, or the newest, among those that the caller may watch and that have a stream."""
        allowed = (
            s for s in reversed(self._sessions.values()) if s.owner == principal.owner or principal.may(Scope.ADMIN)
        )
        return next((s for s in allowed if s.stream is not None and session_id in (None, s.id)), None)

    async def dismiss(self, session_id: str) -> None:
        """End a session at an operator's command. No effect if there is no such session."""
        session = self._sessions.get(session_id)
        if session is None:
            return
        if session.connection is not None:
            await session.connection.stop(Ending("dismissed", "An operator has ended this session."))
        self.end(session)

    def end(self, session: LiveSession) -> None:
        """Remove the session. In the background its worker is released, then its slot is freed."""
        if self._sessions.pop(session.id, None) is None:
            return
        session.viewers.end()
        task = asyncio.create_task(self._end(session))
        self._ends.add(task)
        task.add_done_callback(self._ends.discard)

    async def _end(self, session: LiveSession) -> None:
        try:
            if session.stream is not None:
                self.count(session)
                await session.stream.aclose()
        except Exception:
            log.exception("a live session did not end cleanly")
        finally:
            session.place.release()

    async def close(self) -> None:
        """Stop: close every connection with "going-away" and end every session."""
        self._closing = True
        await asyncio.gather(*(close() for close in self.closers))
        ending = Ending("going-away", "The service stops.", remedy="Connect again in a moment.")
        connected = [s.connection for s in self._sessions.values() if s.connection is not None]
        await asyncio.gather(*(connection.stop(ending) for connection in connected))
        await asyncio.gather(*(connection.wait_closed() for connection in connected))
        for session in tuple(self._sessions.values()):
            self.end(session)
        await asyncio.gather(*self._ends, return_exceptions=True)

    def count(self, session: LiveSession) -> None:
        """Add the stream's frames since the last call to the metrics."""
        if session.stream is None:
            return
        now = _counts(session.stream.figures())
        for counter, after, before in zip(
            (self.metrics.received, self.metrics.painted, self.metrics.dropped), now, session.counted, strict=True
        ):
            counter.inc(after - before)
        session.counted = now


def _counts(figures: Json) -> tuple[int, int, int]:
    return figures["received"], figures["painted"], figures["dropped"]


def _view(session: LiveSession, stream: Stream) -> LiveView:
    order = stream.order
    return LiveView(
        id=session.id,
        process="",
        owner=session.owner,
        method=order.method,
        width=order.size[0],
        height=order.size[1],
        opened_at=session.opened_at,
        connected=session.connection is not None,
        figures=dict(stream.figures()),
    )
