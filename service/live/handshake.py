"""Checks before the WebSocket is accepted, which can be refused with an ordinary HTTP answer."""

from __future__ import annotations

from typing import cast

from starlette.websockets import WebSocket

from service.access.gate import KEY_PROTOCOL
from service.access.keys import Principal, Scope
from service.errors import BadRequest, Forbidden

PROTOCOL = "impasto.live.1"


def caller(socket: WebSocket, scope: Scope = Scope.SUBMIT) -> Principal:
    """The caller, if their key has the scope. Raises Forbidden."""
    principal = cast(Principal, socket.scope["state"]["principal"])
    if principal.may(scope):
        return principal
    raise Forbidden(
        f"This key lacks the scope {scope.value!r}.",
        field="Authorization",
        value=", ".join(sorted(principal.scopes)),
        remedy=f"Use a key with the scope {scope.value!r}.",
    )


def subprotocol(socket: WebSocket) -> str | None:
    """The subprotocol to accept; None if the client offers none. Raises BadRequest: it offers only others."""
    offered = [name for name in socket.scope.get("subprotocols", ()) if not name.startswith(KEY_PROTOCOL)]
    if PROTOCOL in offered:
        return PROTOCOL
    if not offered:
        return None
    raise BadRequest(
        "None of these subprotocols is supported.",
        field="Sec-WebSocket-Protocol",
        value=", ".join(offered),
        remedy=f"Offer {PROTOCOL}.",
    )
