"""Middleware that records who changed what: every request that changed something and succeeded, by its operation."""

from __future__ import annotations

import logging
from dataclasses import asdict

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pipeline.errors import ImpastoError
from service.access.gate import SAFE, address_of
from workers.contract.owners import AuditEntry
from workers.process.log_context import log_extra
from workers.store.audit import Audit

log = logging.getLogger(__name__)

UNRECORDED = ("preview", "estimate_jobs", "patch_upload", "put_project", "patch_project")
"""Beginnings of operations that change nothing, add to an upload that is recorded when it begins, or save a version of
a project, which names its author."""
_MOST_CHARACTERS = 8000


def about(request: Request, *ids: str) -> None:
    """Name what an operation has changed, if neither its address nor the `Location` of its answer does."""
    request.state.about = ids


class AuditTrail:
    """Records an operation before its answer begins. One that cannot be recorded has still been done; the log says
    so."""

    def __init__(self, app: ASGIApp, audit: Audit) -> None:
        self._app, self._audit = app, audit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] in SAFE or scope["state"].get("principal") is None:
            await self._app(scope, receive, send)
            return

        async def recording(message: Message) -> None:
            if message["type"] == "http.response.start" and message["status"] < 400:
                await self._record(scope, Headers(raw=message["headers"]))
            await send(message)

        await self._app(scope, receive, recording)

    async def _record(self, scope: Scope, headers: Headers) -> None:
        action = str(getattr(scope.get("route"), "name", ""))
        if not action or action.startswith(UNRECORDED):
            return
        entry = _entry(action, scope, headers)
        try:
            await run_in_threadpool(self._audit.add, entry)
        except ImpastoError:
            log.exception("an action could not be recorded", extra=log_extra(**asdict(entry)))


def _entry(action: str, scope: Scope, headers: Headers) -> AuditEntry:
    caller = scope["state"]["principal"]
    made = headers.get("location", "").rpartition("/")[2]
    named = [*(str(value) for value in scope.get("path_params", {}).values()), made, *scope["state"].get("about", ())]
    return AuditEntry(
        action,
        " ".join(dict.fromkeys(filter(None, named)))[:_MOST_CHARACTERS],
        caller.user,
        caller.key,
        caller.owner,
        address_of(scope).removeprefix("@"),
    )
