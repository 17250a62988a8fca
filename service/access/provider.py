"""The OpenID provider with which users sign in, by Authlib."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fastapi import Request

from service.settings import Settings
from workers.extras import require_extra

if TYPE_CHECKING:
    from authlib.integrations.starlette_client import StarletteOAuth2App

STATE_COOKIE = "impasto_sign_in"
STATE_S = 600
"""Time for signing in at the provider, seconds."""
_CALL_S = 10.0
"""Limit of each call to the provider, seconds."""


class Provider:
    """The OpenID provider of the settings, and the signed cookie that holds state, nonce and PKCE's verifier meanwhile.

    Args:
        secret: signs the cookie.

    Raises:
        BadParameter: the extra `oidc` is not installed.
    """

    def __init__(self, settings: Settings, secret: bytes) -> None:
        require_extra("oidc", "oidc_issuer", settings.oidc_issuer)
        from authlib.integrations.starlette_client import OAuth
        from itsdangerous import URLSafeTimedSerializer

        self._cookies = URLSafeTimedSerializer(secret, salt="sign-in")
        given = settings.oidc_client_secret
        self.client: StarletteOAuth2App = OAuth().register(
            "provider",
            client_id=settings.oidc_client_id,
            client_secret=given.get_secret_value() if given else None,
            server_metadata_url=f"{settings.oidc_issuer.rstrip('/')}/.well-known/openid-configuration",
            client_kwargs={
                "scope": settings.oidc_scopes,
                "code_challenge_method": "S256",
                "timeout": _CALL_S,
                **({} if given else {"token_endpoint_auth_method": "none"}),
            },
        )

    def load(self, request: Request) -> dict[str, Any]:
        """The state of a sign-in that `save` stored in this browser; empty: none, or older than ten minutes."""
        from itsdangerous import BadData

        try:
            found: dict[str, Any] = self._cookies.loads(request.cookies.get(STATE_COOKIE, ""), max_age=STATE_S)
            return found
        except BadData:
            return {}

    def save(self, value: dict[str, Any]) -> str:
        return str(self._cookies.dumps(value))
