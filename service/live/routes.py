"""/v1/live: what there is (GET), and the WebSocket itself. The protocol is docs/live.md."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from fastapi import APIRouter, Response
from starlette.websockets import WebSocket

from pipeline.errors import ImpastoError
from service.access.depends import Parts, Service, Submitter
from service.errors import Busy, respond, retry_after
from service.live.connection import Connection
from service.live.handshake import caller, subprotocol
from service.live.messages import VERSION
from service.live.sessions import LiveSession, Sessions
from workers.live.live import RETRY_AFTER_S

router = APIRouter(tags=["live"])


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
    """Those that can run live."""
    receives: tuple[str, ...]
    """Codecs that a client may send."""
    sends: tuple[str, ...]
    """Codecs that a client may ask for."""
    capacity: int
    sessions: int
    free: int
    limits: LimitsOut


@router.get("/v1/live")
def describe(response: Response, parts: Parts, _caller: Submitter) -> LiveOut:
    """What live sessions can do, and whether there is room for one. The WebSocket at this address is docs/live.md."""
    live = parts.farm.live
    if not live.free:
        response.headers.update(retry_after(RETRY_AFTER_S))
    limits = LimitsOut(live.limits.side_px, live.limits.side_px, live.limits.fps, live.limits.frame_bytes)
    return LiveOut(VERSION, live.methods(), live.receives, live.sends, live.capacity, live.sessions, live.free, limits)


@router.websocket("/v1/live")
async def connect(socket: WebSocket, session: str | None = None) -> None:
    parts, sessions = _parts(socket)
    try:
        principal, protocol = caller(socket), subprotocol(socket)
        if parts.closing.is_set():
            raise Busy("The service stops.", headers=retry_after(RETRY_AFTER_S), remedy="Connect again in a moment.")
        connection = Connection(socket, parts, sessions, principal)
        claimed = await sessions.claim(session, principal, connection)
    except ImpastoError as error:
        await socket.send_denial_response(respond(error, socket.url.path))
        return
    await _run(socket, connection, claimed, protocol)


async def _run(socket: WebSocket, connection: Connection, session: LiveSession, protocol: str | None) -> None:
    try:
        await socket.accept(protocol)
    except BaseException:
        connection.abandon(session)
        raise
    await connection.run(session)


def _parts(socket: WebSocket) -> tuple[Service, Sessions]:
    state = socket.app.state
    return cast(Service, state.service), cast(Sessions, state.live)
