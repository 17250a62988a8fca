"""Signed tokens of shared links, with the project, the key that made the link, and the time of expiry.

A token is base64url of its JSON claims, a dot, and base64url of their HMAC-SHA256. It is invalid after its expiry, once
the project's share epoch is raised, or once what made it no longer gives access: a key that is revoked, an admin key
that is replaced, or a service that was open and now requires keys.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import json
from dataclasses import asdict, dataclass

from workers.contract.request import Json


@dataclass(frozen=True)
class Claims:
    """Claims of a token."""

    project: str
    key: str
    """Origin of the link: the id of a key, `user:` and the id of a user who had signed in, the name of the admin key
    (`admin-` and its fingerprint), or "" for a service that required no key."""
    epoch: int
    """The project's share epoch when the link was made."""
    expires_at: int
    """Seconds since the epoch, UTC."""
    comments: bool = False
    """Whether people with the link may write comments and read all of them."""


def sign(claims: Claims, secret: bytes) -> str:
    """The token of these claims."""
    body = json.dumps(asdict(claims), sort_keys=True, separators=(",", ":")).encode()
    return f"{_text(body)}.{_text(_mac(body, secret))}"


def verify(token: str, secret: bytes, now: float) -> Claims | None:
    """The claims of a token that is signed with `secret` and has not expired, else None."""
    try:
        body_text, _, mac_text = token.partition(".")
        body, mac = _bytes(body_text), _bytes(mac_text)
    except ValueError:
        return None
    if not hmac.compare_digest(mac, _mac(body, secret)):
        return None
    payload: Json = json.loads(body)
    claims = Claims(**payload)
    return claims if now < claims.expires_at else None


def fingerprint(key: str, secret: bytes) -> str:
    """Names a key without telling anything of it: the start of an HMAC with the service's secret."""
    return hmac.new(secret, b"admin-key:" + key.encode(), hashlib.sha256).hexdigest()[:32]


def _mac(body: bytes, secret: bytes) -> bytes:
    return hmac.new(secret, b"share:" + body, hashlib.sha256).digest()


def _text(data: bytes) -> str:
    return base64.urlsafe_b64encode(data).decode().rstrip("=")


def _bytes(text: str) -> bytes:
    return base64.b64decode(text + "=" * (-len(text) % 4), altchars=b"-_", validate=True)
