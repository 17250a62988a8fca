"""WHIP at /v1/live/whip and WHEP at /v1/live/whep: docs/live.md, WebRTC."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Annotated, cast

from fastapi import Query, Request, Response
from starlette.concurrency import run_in_threadpool

from pipeline.errors import BadParameter
from pipeline.method_names import DEFAULT
from service.bodies import chunks
from service.context.depends import Context, Reader, ServiceContext, Submitter
from service.errors import NotInstalled, UnsupportedMediaType
from service.live.messages import MAX_VALUES
from service.live.sessions import Sessions
from service.routing import Router
from workers.contract.request import MAX_SEED, Json
from workers.errors import NotFound
from workers.ids import new_id
from workers.strict_json import BadJson, strict_json

if TYPE_CHECKING:
    from service.live.webrtc.peers import Peers

router = Router(include_in_schema=False)

SDP = "application/sdp"
MAX_SDP_BYTES = 64 * 1024


@router.post("/v1/live/whip")
async def publish(
    request: Request, context: Context, caller: Submitter, method: str = DEFAULT, params: str = "{}",
    behind: Annotated[str, Query(alias="filter")] = "", prefer: str = "fluent",
    seed: Annotated[int, Query(ge=0, le=MAX_SEED)] = 0,
) -> Response:  # fmt: skip
    """Open a session whose frames come over WebRTC."""
    peers = await _peers(request)
    from service.live.webrtc.publisher import PaintedFrame, Publisher

    offer, sessions = await _offer(request, context), _sessions(request)
    live = sessions.live
    if method not in live.methods():
        remedy = f"Use one of: {', '.join(live.methods())}."
        raise BadParameter("This method cannot run live.", field="method", value=method, remedy=remedy)
    if prefer not in ("fluent", "sharp"):
        raise BadParameter("Unknown preference.", field="prefer", value=prefer, remedy="Write fluent, or sharp.")
    checked = live.params(method, _object(params))
    painting = PaintedFrame(method, checked, seed, live.filter(behind, {}) if behind else None, prefer == "fluent")
    sessions.check_free()
    peer, session_id = peers.open(caller.owner, sends=True), new_id("liv_")
    publisher = Publisher(peer, sessions, painting, context.settings.live_idle_s)
    answer = await peer.answer(offer)
    peers.run(publisher.run(caller, session_id))
    return _created(answer, peer.id, session_id)


@router.post("/v1/live/whep")
async def watch(request: Request, context: Context, caller: Reader, session: str | None = None) -> Response:
    """Send the painting of a session over WebRTC."""
    peers = await _peers(request)
    from service.live.webrtc.playback import play

    offer, sessions = await _offer(request, context), _sessions(request)
    found = sessions.watched(session, caller)
    form = found.viewers.form if found else None
    if found is None or form is None:
        raise NotFound(
            "No live session is running.", field="session", value=session, remedy="Start one, then try again."
        )
    peer = peers.open(caller.owner)
    play(peer, found.viewers, form, offer, sessions.live.limits.side_px)
    return _created(await peer.answer(offer), peer.id, found.id)


@router.delete("/v1/live/peers/{peer_id}")
async def leave(request: Request, caller: Reader, peer_id: str) -> Response:
    """End a WebRTC connection of the caller."""
    peer = (await _peers(request)).find(peer_id, caller)
    if peer is None:
        raise NotFound("Connection not found.", field="peer", value=peer_id, remedy="It may have ended.")
    await peer.close()
    return Response(status_code=200)


async def _peers(request: Request) -> Peers:
    """This process's WebRTC connections. Raises NotInstalled."""
    try:
        await run_in_threadpool(import_module, "service.live.webrtc.peers")  # takes a second, in which others wait
        from service.live.webrtc.peers import Peers
        from service.live.webrtc.receiving import install
    except ModuleNotFoundError as missing:
        raise NotInstalled(
            f"WebRTC needs {missing.name}.", field="address", value=request.url.path,
            remedy="Install it on the service's machine: pip install 'impasto[webrtc]'.",
        ) from None  # fmt: skip
    state = request.app.state
    if not hasattr(state, "peers"):
        state.peers = Peers()
        install(_sessions(request).live.limits.side_px)
        _sessions(request).closers.append(state.peers.close)
    return cast("Peers", state.peers)


def _sessions(request: Request) -> Sessions:
    return cast(Sessions, request.app.state.live)


def _created(answer: str, peer_id: str, session_id: str) -> Response:
    headers = {"Location": f"/v1/live/peers/{peer_id}", "Impasto-Session": session_id}
    return Response(answer, 201, headers, SDP)


async def _offer(request: Request, context: ServiceContext) -> str:
    """The SDP offer. Raises UnsupportedMediaType, BodyTooLarge, RequestTimeout."""
    kind = request.headers.get("Content-Type", "").partition(";")[0].strip()
    if kind != SDP:
        raise UnsupportedMediaType("The body is an SDP offer.", field="Content-Type", value=kind, remedy=f"Send {SDP}.")
    parts = [chunk async for chunk in chunks(request, MAX_SDP_BYTES, context.settings.idle_s)]
    return b"".join(parts).decode("utf-8", "replace")


def _object(text: str) -> Json:
    try:
        found = strict_json(text.encode("utf-8", "replace"), MAX_VALUES)
    except BadJson:
        found = None
    if not isinstance(found, dict):
        raise BadParameter(
            "Parameters are a JSON object.", field="params", value=text, remedy='Write {"lines": "off"}.'
        )
    return found
