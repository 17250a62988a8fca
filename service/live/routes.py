"""/v1/live: capabilities (GET) and the WebSocket. docs/live.md describes the protocol."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from fastapi import Response
from starlette.websockets import WebSocket

from pipeline.errors import ImpastoError
from service.access.keys import Scope
from service.context.depends import Context, ServiceContext, Submitter
from service.errors import Busy, respond, retry_after
from service.live.connection import Connection
from service.live.handshake import caller, subprotocol
from service.live.messages import VERSION
from service.live.sessions import LiveSession, Sessions
from service.live.view_connection import ViewConnection
from service.routing import Router
from workers.errors import NotFound
from workers.live.sessions import RETRY_AFTER_S

router = Router(tags=["live"])


@dataclass(frozen=True)
class LimitsOut:
    width: int
    height: int
    fps: float
    frame_bytes: int


@dataclass(frozen=True)
class LiveOut:
    version: int
    methods: tuple[str, ...]
    """Methods that can run live."""
    filters: tuple[str, ...]
    """Methods that can filter what such a method paints."""
    receives: tuple[str, ...]
    """Codecs in which a client can send frames."""
    sends: tuple[str, ...]
    """Codecs in which a client can receive frames."""
    capacity: int
    sessions: int
    free: int
    limits: LimitsOut


@router.get("/v1/live")
def describe(response: Response, context: Context, _caller: Submitter) -> LiveOut:
    """Capabilities of live sessions, and the number of free ones. The WebSocket has the same URL: see docs/live.md."""
    live = context.farm.live
    if not live.free:
        response.headers.update(retry_after(RETRY_AFTER_S))
    limits = LimitsOut(live.limits.side_px, live.limits.side_px, live.limits.fps, live.limits.frame_bytes)
    return LiveOut(
        VERSION, live.methods(), live.filters(), live.receives, live.sends, live.capacity, live.sessions, live.free,
        limits,
    )  # fmt: skip


@router.websocket("/v1/live")
async def connect(socket: WebSocket, session: str | None = None) -> None:
    context, sessions = _context(socket)
    try:
        principal, protocol = caller(socket), subprotocol(socket)
        if context.closing.is_set():
            raise Busy("The service stops.", headers=retry_after(RETRY_AFTER_S), remedy="Connect again in a moment.")
        connection = Connection(socket, context, sessions, principal)
        claimed = await sessions.claim(session, principal, connection)
    except ImpastoError as error:
        await socket.send_denial_response(respond(error, socket.url.path))
        return
    await _run(socket, connection, claimed, protocol)


@router.websocket("/v1/live/view")
async def watch(socket: WebSocket, session: str | None = None, sound: bool = False) -> None:
    context, sessions = _context(socket)
    try:
        principal, protocol = caller(socket, Scope.READ), subprotocol(socket)
        if session is not None and sessions.watched(session, principal) is None:
            raise NotFound("Live session not found.", field="session", value=session, remedy="Leave it out.")
    except ImpastoError as error:
        await socket.send_denial_response(respond(error, socket.url.path))
        return
    await socket.accept(protocol)
    await ViewConnection(socket, context, sessions, principal, session, sound).run()


async def _run(socket: WebSocket, connection: Connection, session: LiveSession, protocol: str | None) -> None:
    try:
        await socket.accept(protocol)
    except BaseException:
        connection.abandon(session)
        raise
    await connection.run(session)


def _context(socket: WebSocket) -> tuple[ServiceContext, Sessions]:
    state = socket.app.state
    return cast(ServiceContext, state.service), cast(Sessions, state.live)
