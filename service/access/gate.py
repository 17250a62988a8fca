"""Middleware before every request: Host and Origin checks, authentication, the group, rate limit."""

from __future__ import annotations

import asyncio
import hmac
import math
import re
from dataclasses import replace

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.requests import cookie_parser
from starlette.types import ASGIApp, Receive, Scope, Send

from pipeline.errors import ImpastoError
from service.access.keys import EVERYONE, OPERATOR, Principal
from service.access.keys import Scope as KeyScope
from service.access.rates import Rates
from service.errors import BadRequest, Forbidden, RateLimited, Unauthorized, respond, retry_after
from service.settings import Settings, is_address, is_loopback
from workers.contract.record import ApiKey
from workers.errors import NotFound
from workers.farm import Farm

GUARDED = ("/v1/", "/metrics")
"""Paths that need a key where keys are required. Pages, health and the OpenAPI document contain no user data."""

SHARED = "/v1/shared/"
"""Prefix of shared links: their routes check the token in the address."""

SIGN_IN = "/sign-in"
"""The address where a browser's user signs in, if the service has an OpenID provider."""

COOKIE = "impasto_session"
"""The cookie of a browser whose user has signed in: the secret of a key that is a session."""

KEY_PROTOCOL = "impasto.key."
"""Prefix of a WebSocket subprotocol that carries a key."""

SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
"""Methods that change nothing."""

_HOST = re.compile(r"(?P<name>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(:\d{1,5})?")


class Gate:
    """Sets `request.state.principal`, or answers with 401, 403 or 429."""

    def __init__(self, app: ASGIApp, settings: Settings, farm: Farm, rates: Rates) -> None:
        self._app, self._settings, self._rates = app, settings, rates
        self._keys, self._owners = farm.keys, farm.owners
        self._asked: dict[str, asyncio.Future[ApiKey | None]] = {}
        """Queries for keys that are being answered, by secret."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        try:
            scope.setdefault("state", {})["principal"] = await self._admit(scope)
        except ImpastoError as error:
            await respond(error, scope["path"])(scope, receive, send)
            return
        await self._app(scope, receive, send)

    async def _admit(self, scope: Scope) -> Principal | None:
        headers = Headers(scope=scope)
        _check_framing(headers)
        secret = _bearer(headers) or _offered(scope)
        if secret is None and self._settings.open:
            self._check_local(headers, scope["scheme"])
        if scope["path"].startswith(SIGN_IN):
            self._check_rate(None, address_of(scope))
        if not scope["path"].startswith(GUARDED):
            return None
        principal = await (self._signed_in(scope, headers) if secret is None else self._known(secret))
        self._check_rate(principal, address_of(scope))
        if scope["path"].startswith(SHARED):
            return None
        if principal is None:
            raise self._unauthorized(secret)
        return await self._in_group(principal, scope.get("group"))

    def _unauthorized(self, secret: str | None) -> Unauthorized:
        """The answer 401. With an OpenID provider, its header names the address at which users sign in."""
        offered = {"WWW-Authenticate": f'Bearer sign_in="{SIGN_IN}"'} if self._settings.oidc_issuer else {}
        return Unauthorized(
            "An API key is required." if secret is None else "Unknown API key.",
            headers=offered,
            field="Authorization",
            remedy="Send the header 'Authorization: Bearer <key>' with a valid key"
            + (f", or sign in at {SIGN_IN} with a browser." if offered else "."),
        )

    async def _signed_in(self, scope: Scope, headers: Headers) -> Principal | None:
        """The caller without a key: the user of a browser's session, or anyone of an open service."""
        if self._settings.open:
            return EVERYONE
        secret = cookie_parser(headers.get("cookie", "")).get(COOKIE)
        key = await self._verified(secret) if secret else None
        if key is None or not key.session:
            return None
        if scope["type"] == "websocket" or scope["method"] not in SAFE:
            check_origin(headers, scope["scheme"], self._settings.public_url)
        return _principal(key)

    async def _in_group(self, principal: Principal, group: str | None) -> Principal:
        """The caller under the address of a group: acts for it, with the scopes of the role, as far as the key has
        them. Raises NotFound for strangers, as if there were no such group."""
        if group is None:
            return principal
        found = await run_in_threadpool(self._owners.role, principal.user, group)
        role, quotas = found or (None, {})
        if found is None or (role is None and not principal.may(KeyScope.ADMIN)):
            raise NotFound("Group not found.", field="group", value=group, remedy="GET /v1/me lists your groups.")
        scopes = principal.scopes if role is None else principal.scopes & (role.scopes | {KeyScope.ADMIN})
        return replace(principal, owner=group, scopes=scopes, quotas=quotas)

    async def _known(self, secret: str) -> Principal | None:
        fixed = self._settings.admin_key
        if fixed and hmac.compare_digest(secret.encode(), fixed.get_secret_value().encode()):
            return OPERATOR
        key = await self._verified(secret)
        return _principal(key) if key else None

    async def _verified(self, secret: str) -> ApiKey | None:
        """The key of the secret. Requests that come meanwhile with the same secret share the query, so that a thousand
        requests of one key do not delay the check of another."""
        asked = self._asked.get(secret)
        if asked is None:
            asked = self._asked[secret] = asyncio.ensure_future(run_in_threadpool(self._keys.verify, secret))
            asked.add_done_callback(lambda _: self._asked.pop(secret, None))
        return await asyncio.shield(asked)

    def _check_rate(self, principal: Principal | None, address: str) -> None:
        caller = (principal and principal.owner) or address
        own = principal.quotas.get("requests_per_minute") if principal else None
        per_minute = self._settings.requests_per_minute if own is None else max(1, own)
        wait_s = self._rates.take(caller, per_minute / 60, max(1, per_minute // 6))
        if wait_s > 0:
            raise RateLimited(
                "Too many requests in a short time.",
                headers=retry_after(wait_s),
                field="Authorization",
                remedy=f"Wait {math.ceil(wait_s * 10) / 10:.1f} s.",
            )

    def _check_local(self, headers: Headers, scheme: str) -> None:
        """Without keys, pages of other origins must not reach the service, neither directly nor by DNS rebinding."""
        host = headers.get("host", "")
        if not self._trusted(host):
            raise Forbidden(
                "This service does not answer requests to this name without a key.",
                field="Host",
                value=host,
                remedy="Use http://127.0.0.1, add the name to IMPASTO_ALLOWED_HOSTS, or use an API key.",
            )
        if headers.get("origin") is not None:
            check_origin(headers, scheme)

    def _trusted(self, host: str) -> bool:
        """Whether a Host header is a name that nobody else can point at this machine: of loopback, allowed by the
        operator, or with `auth` "off" the address itself, which DNS does not resolve."""
        found = _HOST.fullmatch(host)
        if found is None:
            return False
        name = found["name"].strip("[]").lower().rstrip(".")
        allowed = {one.lower() for one in self._settings.allowed_hosts}
        return is_loopback(name) or name in allowed or (self._settings.auth == "off" and is_address(name))


def _principal(key: ApiKey) -> Principal:
    return Principal(key.owner, key.scopes, key.quotas, key.id, key.owner, key.session)


def check_origin(headers: Headers, scheme: str, public_url: str = "") -> None:
    """Raise Forbidden unless a page of this service sent the request: browsers name the origin of each page that may
    change something.

    Args:
        public_url: the service's address for browsers, if a proxy changes it.
    """
    origin, scheme = headers.get("origin", ""), {"ws": "http", "wss": "https"}.get(scheme, scheme)
    own = {f"{scheme}://{headers.get('host', '')}".lower(), "/".join(public_url.lower().split("/")[:3])}
    if not origin or origin.lower() not in own:
        raise Forbidden(
            "Pages of other origins may not use this service.",
            field="Origin",
            value=origin,
            remedy="Use the service's own page, or an API key from a program.",
        )


def _check_framing(headers: Headers) -> None:
    """Refuse a request whose length a proxy may read differently (RFC 9112, 6.1), and close its connection."""
    if "transfer-encoding" in headers and "content-length" in headers:
        raise BadRequest(
            "A body has a length or is chunked, not both.", headers={"Connection": "close"},
            field="Content-Length", value=headers["content-length"], remedy="Leave one of the two headers out.",
        )  # fmt: skip


def _bearer(headers: Headers) -> str | None:
    kind, _, secret = headers.get("authorization", "").partition(" ")
    return (secret.strip() or None) if kind.lower() == "bearer" else None


def _offered(scope: Scope) -> str | None:
    """The key among a WebSocket's subprotocols: browsers cannot set headers there."""
    names = scope.get("subprotocols", ()) if scope["type"] == "websocket" else ()
    keys = (name.removeprefix(KEY_PROTOCOL) for name in names if name.startswith(KEY_PROTOCOL))
    return next(keys, None) or None


def address_of(scope: Scope) -> str:
    """The client's network address, behind an @, which no id of an owner contains."""
    client = scope.get("client")
    return f"@{client[0]}" if client else "@"
