"""/sign-in: users of browsers sign in with an OpenID provider (authorization code with PKCE); /sign-out.

Authlib does the protocol: discovery, state, nonce, PKCE, the exchange of the code, and the checks of the ID token with
the provider's keys. A user who has signed in gets a key of the kind "session", whose secret is in a cookie that pages
cannot read. See `service.access.gate` for the checks of requests with the cookie.
"""

from __future__ import annotations

import time
from typing import Annotated, Any
from urllib.parse import urljoin, urlsplit

import httpx
from fastapi import Query, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from service.access.gate import COOKIE, SIGN_IN, address_of, check_origin
from service.access.keys import Scope
from service.access.provider import STATE_COOKIE, STATE_S, Provider
from service.context.depends import Context, ServiceContext
from service.errors import Busy, Forbidden, Unauthorized
from service.routing import Router
from workers.contract.owners import AuditEntry
from workers.errors import NotFound

router = Router(include_in_schema=False)

_AGAIN = f"Begin again at {SIGN_IN}."
Next = Annotated[str, Query(max_length=2000, description="The page to show afterwards.")]


@router.get(SIGN_IN)
async def sign_in(request: Request, context: Context, next: Next = "") -> Response:  # noqa: A002
    """Go to the provider's page, and come back to `next`, a path of this host."""
    provider = _provider(context)
    state = request.scope["session"] = {"next": next if _is_path(next) else ""}
    try:
        answer: Response = await provider.client.authorize_redirect(request, _address(context, f"{SIGN_IN}/callback"))
    except (httpx.HTTPError, ValueError) as error:
        raise _silent() from error
    _set_cookie(context, answer, STATE_COOKIE, provider.save(state), STATE_S)
    return answer


@router.get(f"{SIGN_IN}/callback")
async def signed_in(request: Request, context: Context) -> Response:
    """The way back from the provider, with a code that is exchanged for the user's ID token."""
    provider = _provider(context)
    state = request.scope["session"] = provider.load(request)
    claims = await _claims(provider, request)
    secret = await run_in_threadpool(_session, context, claims, address_of(request.scope))
    home = _address(context, "/")
    answer = RedirectResponse(urljoin(home, state["next"]) if state["next"] else home, 303)
    _set_cookie(context, answer, COOKIE, secret, int(context.settings.session_s))
    _set_cookie(context, answer, STATE_COOKIE, "", 0)
    return answer


@router.post("/sign-out")
async def sign_out(request: Request, context: Context) -> Response:
    """End the session of this browser."""
    check_origin(request.headers, request.url.scheme, context.settings.public_url)
    await run_in_threadpool(_end, context, request.cookies.get(COOKIE, ""), address_of(request.scope))
    answer = Response(status_code=204)
    _set_cookie(context, answer, COOKIE, "", 0)
    return answer


def _provider(context: ServiceContext) -> Provider:
    if context.provider is None:
        remedy = "Use an API key, or ask the operator to set IMPASTO_OIDC_ISSUER."
        raise NotFound("Nobody signs in here: the service has no OpenID provider.", field="path", remedy=remedy)
    return context.provider


async def _claims(provider: Provider, request: Request) -> dict[str, Any]:
    """The claims of the user's ID token, which has been checked."""
    from authlib.integrations.starlette_client import OAuthError
    from joserfc.errors import JoseError

    try:
        token = await provider.client.authorize_access_token(request)
    except (OAuthError, JoseError) as error:
        raise Unauthorized(f"You are not signed in: {error}", field="code", remedy=_AGAIN) from error
    except (httpx.HTTPError, ValueError) as error:
        raise _silent() from error
    if not token.get("userinfo"):
        raise Unauthorized("The provider has sent no ID token.", field="code", remedy="Request the scope openid.")
    return dict(token["userinfo"])


def _silent() -> Busy:
    return Busy("The OpenID provider does not answer as it should.", remedy="Try again in a minute.")


def _session(context: ServiceContext, claims: dict[str, Any], address: str) -> str:
    """The secret of a new session. Raises Forbidden: an operator has disabled the user."""
    settings, farm = context.settings, context.farm
    names = (claims.get(name) for name in ("name", "preferred_username", "email", "sub"))
    user = farm.owners.signed_in(f"{claims['iss']} {claims['sub']}", str(next(filter(None, names))))
    if user.disabled_at is not None:
        raise Forbidden("An operator has disabled you.", field="user", value=user.id, remedy="Ask the operator.")
    groups = claims.get("groups") or ()
    admin = {Scope.ADMIN} if settings.oidc_admins and settings.oidc_admins in groups else set()
    key, secret = farm.keys.create(
        "Browser", {Scope.READ, Scope.SUBMIT, *admin}, owner=user.id,
        expires_at=time.time() + settings.session_s, session=True,
    )  # fmt: skip
    farm.audit.add(AuditEntry("sign_in", key.id, user.id, key.id, user.id, address.removeprefix("@")))
    return secret


def _end(context: ServiceContext, secret: str, address: str) -> None:
    key = context.farm.keys.verify(secret)
    if key is not None and key.session:
        context.farm.keys.revoke(key.id)
        context.farm.audit.add(AuditEntry("sign_out", key.id, key.owner, key.id, key.owner, address.removeprefix("@")))


def _is_path(text: str) -> bool:
    """Whether a browser understands the text as a path of this host: no scheme, host, or anything that becomes one."""
    return text.startswith("/") and not text.startswith(("//", "/\\")) and text.isprintable() and "\\" not in text


def _address(context: ServiceContext, path: str) -> str:
    return context.settings.public_url.rstrip("/") + path


def _set_cookie(context: ServiceContext, answer: Response, name: str, value: str, max_age_s: int) -> None:
    url = urlsplit(context.settings.public_url)
    path = url.path.rstrip("/") or "/"
    secure = url.scheme == "https"
    answer.set_cookie(name, value, max_age=max_age_s, path=path, secure=secure, httponly=True, samesite="lax")
