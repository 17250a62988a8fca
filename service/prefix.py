"""The path prefix under which a proxy serves the service, for example "/paint".

It comes from the proxy's header X-Forwarded-Prefix or from uvicorn's root path. A proxy may remove it from addresses or
leave it. The address of a group, `/groups/grp_...`, is such a prefix, too: everything under it is done for the group,
whose id is `scope["group"]`. Pages, redirects, `Location`, `Address`es in answers and the servers of the OpenAPI
document carry it.
"""

from __future__ import annotations

import re
from contextvars import ContextVar
from typing import Annotated

from pydantic import PlainSerializer
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

HEADER = "X-Forwarded-Prefix"
_PREFIX = re.compile(r"(?:/[A-Za-z0-9._~-]{1,64}){1,8}")
_GROUP = re.compile(r"/groups/(grp_[0-9a-z]{26})(?=/|$)")
_LINK = re.compile(r'((?:href|src)=")/(?!/)')

_current: ContextVar[str] = ContextVar("prefix", default="")
"""The prefix of the request that is being answered."""


def _behind_prefix(path: str) -> str:
    return _current.get() + path


Address = Annotated[str, PlainSerializer(_behind_prefix, return_type=str)]
"""A path of this service in a response, which is sent with the request's prefix."""


def prefix_of(scope: Scope) -> str:
    """The prefix of a request, without a slash at its end; "" = none, or one that is no path."""
    given = Headers(scope=scope).get(HEADER, "") or str(scope.get("root_path", ""))
    prefix = given.split(",")[0].strip().rstrip("/")
    return prefix if _PREFIX.fullmatch(prefix) and ".." not in prefix.split("/") else ""


class OutsidePrefix:
    """The outermost layer: takes the prefix off the address, and puts it before the paths of `Location`."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        proxied = prefix_of(scope) if scope["type"] in ("http", "websocket") else ""
        path = str(scope.get("path", ""))
        path = path.removeprefix(proxied) if path.startswith(f"{proxied}/") else path
        group = _GROUP.match(path)
        prefix = proxied + (group[0] if group else "")
        _current.set(prefix)
        if not prefix:
            await self._app(scope, receive, send)
            return
        if group:
            path, scope = path[group.end() :] or "/", {**scope, "group": group[1]}

        async def send_with_prefix(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                if headers.get("location", "").startswith("/"):
                    headers["Location"] = prefix + headers["Location"]
                headers.add_vary_header(HEADER)
            await send(message)

        await self._app({**scope, "path": path, "root_path": "", "prefix": prefix}, receive, send_with_prefix)


class InsidePrefix:
    """The innermost layer: tells routes the prefix as ASGI does, as the root path at the beginning of the path."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        prefix = scope.get("prefix")
        if not prefix:
            await self._app(scope, receive, send)
            return
        inside = {**scope, "root_path": prefix, "path": prefix + scope["path"]}
        try:
            await self._app(inside, receive, send)
        finally:  # for logs and metrics
            scope.update({name: inside[name] for name in ("route", "path_params") if name in inside})


def with_prefix(page: str, prefix: str) -> str:
    """The text of a page, its links to this host behind the prefix."""
    return _LINK.sub(rf"\g<1>{prefix}/", page)
