"""The outermost middleware: headers, metrics and a log line for every answer; tus's X-HTTP-Method-Override."""

from __future__ import annotations

import logging
import secrets
import time

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.errors import SECURITY_HEADERS
from service.ops.metrics import HttpMetrics
from service.uploads.headers import VERSION
from workers.process.log_context import current_context, log_extra, working_for

PAGE_CSP = (
    "default-src 'self'; img-src 'self' blob: data:; media-src 'self' blob:; object-src 'none'; "
    "base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
"""Only this origin, no inline script or style. `blob:` serves thumbnails and local files before their upload."""
PERMISSIONS = (
    "camera=(self), display-capture=(self), fullscreen=(self), microphone=(), geolocation=(), payment=(), usb=()"
)
"""Browser features that pages may use: the live page needs a camera or the screen."""
LIVE_PERMISSIONS = PERMISSIONS.replace("microphone=()", "microphone=(self)")
"""Of the live page alone, whose recordings have the sound of a microphone if the user turns it on."""
TUS = "/v1/uploads"
_FACTS = {"job_id": "job", "task_id": "task", "asset_id": "asset", "key_id": "key", "upload_id": "upload"}
"""Path parameters -> their names in log lines."""
log = logging.getLogger(__name__)


class Edge:
    """Adds common headers to every answer unless its route has set them, counts the answer, and logs it."""

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
                MutableHeaders(scope=message)["X-Request-Id"] = str(current_context()["request"])
            await send(message)

        _override(scope)
        try:
            await self._app(scope, receive, send_with_headers)
        finally:
            self._metrics.record(verb, _route(scope), status, answered - began)
            _log(scope, verb, status, answered - began)


def _log(scope: Scope, verb: str, status: int, seconds: float) -> None:
    """One line per request. It has the route instead of the address, because a query may contain private values."""
    principal = scope.get("state", {}).get("principal")
    named = scope.get("path_params") or {}
    facts = {short: str(named[name]) for name, short in _FACTS.items() if name in named}
    if principal is not None:
        facts["owner"] = principal.owner
    log.info("%s %s", verb, _route(scope), extra=log_extra(status=status, seconds=round(seconds, 4), **facts))


def _route(scope: Scope) -> str:
    """The route's template; addresses would be an unbounded set of metric labels."""
    return str(getattr(scope.get("route"), "path", "") or "none")


def _add(headers: MutableHeaders, path: str) -> None:
    for name, value in SECURITY_HEADERS.items():
        headers.setdefault(name, value)
    if path.startswith(TUS):
        headers["Tus-Resumable"] = VERSION
    headers.setdefault("Content-Security-Policy", PAGE_CSP)
    headers.setdefault("Permissions-Policy", PERMISSIONS)
    headers.setdefault("Cache-Control", _caching(path))


def _caching(path: str) -> str:
    """The names of bundled files contain a hash of their bytes, so that they never change."""
    if path.startswith("/static/assets/"):
        return "public, max-age=31536000, immutable"
    return "no-store" if path.startswith("/v1/") else "no-cache"


def _override(scope: Scope) -> None:
    """Apply X-HTTP-Method-Override, which tus requires, on routes of uploads only."""
    if scope["method"] == "POST" and scope["path"].startswith(TUS):
        asked = Headers(scope=scope).get("x-http-method-override", "").upper()
        scope["method"] = asked if asked in ("PATCH", "DELETE", "HEAD") else "POST"
