"""The outermost layer: headers and figures of every answer, and tus's way around proxies that know no PATCH."""

from __future__ import annotations

import logging
import secrets
import time

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.errors import SECURITY_HEADERS
from service.ops.metrics import HttpMetrics
from service.uploads.headers import VERSION
from workers.about import about, here, working_for

PAGE_CSP = (
    "default-src 'self'; img-src 'self' blob: data:; media-src 'self' blob:; object-src 'none'; "
    "base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
"""Nothing from elsewhere, no inline script or style. Blobs: thumbnails and a local file before its upload."""
PERMISSIONS = (
    "camera=(self), display-capture=(self), fullscreen=(self), microphone=(), geolocation=(), payment=(), usb=()"
)
"""What pages may ask the browser for: the live page needs a camera or a screen, and nothing hears anyone."""
TUS = "/v1/uploads"
_FACTS = {"job_id": "job", "task_id": "task", "asset_id": "asset", "key_id": "key", "upload_id": "upload"}
"""Parameters of an address, as logs call them."""
log = logging.getLogger(__name__)


class Edge:
    """Adds what every answer bears, unless its route has said otherwise, and counts it."""

    def __init__(self, app: ASGIApp, metrics: HttpMetrics) -> None:
        self._app, self._metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        with working_for({"request": secrets.token_hex(8)}):
            if scope["type"] == "http":
                await self._answer(scope, receive, send)
            else:
                await self._app(scope, receive, send)

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        began, verb, status = time.perf_counter(), scope["method"], 500
        answered = began

        async def send_with_headers(message: Message) -> None:
            nonlocal status, answered
            if message["type"] == "http.response.start":
                status, answered = message["status"], time.perf_counter()
                _add(MutableHeaders(scope=message), scope["path"])
                MutableHeaders(scope=message)["X-Request-Id"] = str(here()["request"])
            await send(message)

        _override(scope)
        try:
            await self._app(scope, receive, send_with_headers)
        finally:
            self._metrics.note(verb, _route(scope), status, answered - began)
            _log(scope, verb, status, answered - began)


def _log(scope: Scope, verb: str, status: int, seconds: float) -> None:
    """One line a request. The route, not the address: a query may hold what is nobody's business."""
    principal = scope.get("state", {}).get("principal")
    named = scope.get("path_params") or {}
    facts = {short: str(named[name]) for name, short in _FACTS.items() if name in named}
    if principal is not None:
        facts["owner"] = principal.owner
    log.info("%s %s", verb, _route(scope), extra=about(status=status, seconds=round(seconds, 4), **facts))


def _route(scope: Scope) -> str:
    """The template of the route, never the address itself: that would be a label without bound."""
    return str(getattr(scope.get("route"), "path", "") or "none")


def _add(headers: MutableHeaders, path: str) -> None:
    for name, value in SECURITY_HEADERS.items():
        headers.setdefault(name, value)
    if path.startswith(TUS):
        headers["Tus-Resumable"] = VERSION
    headers.setdefault("Content-Security-Policy", PAGE_CSP)
    headers.setdefault("Permissions-Policy", PERMISSIONS)
    headers.setdefault("Cache-Control", "no-store" if path.startswith("/v1/") else "no-cache")


def _override(scope: Scope) -> None:
    """X-HTTP-Method-Override, which tus requires; nowhere else."""
    if scope["method"] == "POST" and scope["path"].startswith(TUS):
        asked = Headers(scope=scope).get("x-http-method-override", "").upper()
        scope["method"] = asked if asked in ("PATCH", "DELETE", "HEAD") else "POST"
