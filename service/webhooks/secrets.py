"""Signing secrets of webhooks: one per owner, all derived from one master secret."""

from __future__ import annotations

import base64
import hashlib
import hmac
import os
import secrets
from pathlib import Path

SECRET_BYTES = 32


class WebhookSecrets:
    """Secrets in the form of Standard Webhooks 1.0.0 (`whsec_` and base64).

    Args:
        path: file with the master secret; created with mode 0600 on first use.
        given: the master secret, if it comes from a setting.
    """

    def __init__(self, path: Path, given: str = "") -> None:
        self._path = path
        self._given = given

    def of(self, owner: str) -> str:
        """The secret that signs the messages of `owner`."""
        digest = hmac.new(self.master(), b"webhook:" + owner.encode(), hashlib.sha256).digest()
        return "whsec_" + base64.b64encode(digest).decode()

    def master(self) -> bytes:
        """The secret from which others are derived. Signed data is prefixed with its purpose."""
        if self._given:
            return self._given.encode()
        try:
            return self._path.read_bytes()
        except FileNotFoundError:
            return self._make()

    def _make(self) -> bytes:
        """Write a temporary file, then link it: if two processes start at once, both use the first one's secret."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        fresh = self._path.with_name(f"{self._path.name}.{secrets.token_hex(8)}")
        fresh.touch(mode=0o600)
        fresh.write_bytes(secrets.token_bytes(SECRET_BYTES))
        try:
            os.link(fresh, self._path)
        except FileExistsError:
            pass
        finally:
            fresh.unlink()
        return self._path.read_bytes()
