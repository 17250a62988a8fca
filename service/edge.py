"""The outermost layer: headers and figures of every answer, and tus's way around proxies that know no PATCH."""

from __future__ import annotations

import time

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.errors import SECURITY_HEADERS
from service.ops.metrics import HttpMetrics
from service.uploads.headers import VERSION

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


class Edge:
    """Adds what every answer bears, unless its route has said otherwise, and counts it."""

    def __init__(self, app: ASGIApp, metrics: HttpMetrics) -> None:
        self._app, self._metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        began, verb, status = time.perf_counter(), scope["method"], 500
        answered = began

        async def send_with_headers(message: Message) -> None:
            nonlocal status, answered
            if message["type"] == "http.response.start":
                status, answered = message["status"], time.perf_counter()
                _add(MutableHeaders(scope=message), scope["path"])
            await send(message)

        _override(scope)
        try:
            await self._app(scope, receive, send_with_headers)
        finally:
            self._metrics.note(verb, _route(scope), status, answered - began)


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
