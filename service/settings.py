"""Settings of a service process, read once from the environment (prefix `IMPASTO_`)."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Literal
from urllib.parse import urlsplit

import platformdirs
from pydantic import Field, SecretStr, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from workers.settings import FarmSettings

MIB = 1 << 20


class Settings(BaseSettings, FarmSettings):
    """Settings of the farm (`FarmSettings`) and of the HTTP service. Sizes are in bytes, times in seconds."""

    model_config = SettingsConfigDict(env_prefix="IMPASTO_", extra="ignore", frozen=True, env_ignore_empty=True)

    home: Path = Field(default_factory=lambda: platformdirs.user_data_path("impasto"))

    host: str = "127.0.0.1"
    port: int = Field(default=8420, ge=0, le=65535)

    auth: Literal["auto", "required", "off"] = "auto"
    """"auto": a key is required unless the service is bound to loopback. "off": none is required; the service then
    answers requests to names of loopback, to IP addresses, and to `allowed_hosts`."""
    admin_key: SecretStr | None = None
    """A key with every scope that is not stored, for a new server without keys."""
    public_url: str = Field(default="", pattern=r"^$|^https?://[^/?#]+(/[^?#]*)?$")
    """The service's address in browsers, such as `https://paint.example` or `https://example/paint`; needed for signing
    in."""
    oidc_issuer: str = Field(default="", pattern=r"^$|^https?://[^?#]+$")
    """Address of the OpenID provider with which users sign in, as its discovery document has it; empty: none."""
    oidc_client_id: str = ""
    oidc_client_secret: SecretStr | None = None
    """None: a public client, which PKCE alone protects."""
    oidc_scopes: str = "openid profile email"
    """What is requested from the provider."""
    oidc_admins: str = ""
    """Users whose claim `groups` contains this name are operators; empty: nobody is by signing in."""
    session_s: float = Field(default=12 * 3600.0, gt=0)
    """A browser's user signs in again after this long."""

    allowed_hosts: frozenset[str] = frozenset()
    """Names, in addition to those of loopback, that are accepted as Host while no key is required."""

    requests_per_minute: int = Field(default=6000, ge=1)
    """Rate limit per owner, or per address without a key; a sixth of it may come at once. An owner may have its own."""
    quota_active_jobs: int = Field(default=1000, ge=1)
    """Unfinished jobs of an owner; an owner may have another limit, as of the next ones."""
    quota_asset_bytes: int | None = Field(default=None, ge=1)
    """Bytes of an owner's assets and unfinished uploads (None: unlimited)."""
    quota_document_bytes: int = Field(default=256 * MIB, ge=1)
    """Bytes that all versions of an owner's projects take in the database, compressed. Deleted projects count until
    they can be restored no more."""

    quota_open_uploads: int = Field(default=1000, ge=1)
    """Unfinished resumable uploads of an owner."""

    max_json_bytes: int = Field(default=1 * MIB, ge=1024)
    max_project_bytes: int = Field(default=32 * MIB, ge=1024)
    """Largest body of a request about a project, bytes: a preview may contain a painted frame."""
    upload_ttl_s: float = Field(default=24 * 3600.0, gt=0)
    """An unfinished resumable upload without new bytes for this long is deleted."""
    idle_s: float = Field(default=60.0, gt=0)
    """Time over which a request body must average 1 KiB per second; an answer that is not read for this long is
    dropped."""

    header_s: float = Field(default=15.0, gt=0)
    """A connection on which no whole request header has arrived after this long is closed."""
    max_connections: int = Field(default=4096, ge=1)
    """Maximum number of client connections; fewer if the limit of open files is lower, of which a quarter is reserved
    for files."""

    heartbeat_s: float = Field(default=15.0, gt=0)
    max_streams: int = Field(default=500, ge=1)
    """Maximum number of open event streams."""
    preview_slots: int = Field(default=2, ge=1)
    """Maximum number of previews rendered at once; further requests are answered with 503 and Retry-After."""
    frame_slots: int = Field(default=4, ge=1)
    """Maximum number of frames decoded at once; further requests wait, and are then answered with 503 and
    Retry-After."""

    live_hello_s: float = Field(default=10.0, gt=0)
    """The first message of a live connection must arrive within this time."""
    live_idle_s: float = Field(default=60.0, gt=0)
    """A live session without a frame for this long ends."""
    live_resume_s: float = Field(default=10.0, ge=0)
    """A live session waits this long for a lost client to reconnect."""
    live_slow_s: float = Field(default=90.0, gt=0)
    """A live client that reads nothing for this long is closed."""
    live_ping_s: float = Field(default=20.0, gt=0)
    """Interval of WebSocket pings; a client that sends nothing for as long after a ping is disconnected."""

    styles_dir: Path | None = None
    """Folder with paintings that the style library offers to every user; None: none but Impasto's own."""

    webhook_secret: SecretStr | None = Field(default=None, min_length=32)
    """Master secret of webhook signatures, the same for all processes of a service; None: a file in the home."""
    webhook_private: bool = False
    """Allow webhook targets on private and loopback addresses."""
    webhook_timeout_s: float = Field(default=10.0, gt=0)
    webhook_poll_s: float = Field(default=1.0, gt=0)

    @model_validator(mode="after")
    def _check_sign_in(self) -> Settings:
        if not self.oidc_issuer:
            return self
        for name in ("oidc_client_id", "public_url"):
            if not getattr(self, name):
                raise ValueError(f"Signing in with {self.oidc_issuer} needs IMPASTO_{name.upper()}.")
        if self.auth == "off":
            raise ValueError("With IMPASTO_AUTH=off nobody signs in: leave out IMPASTO_AUTH or IMPASTO_OIDC_ISSUER.")
        for name in ("oidc_issuer", "public_url"):
            url = urlsplit(getattr(self, name))
            if url.scheme != "https" and not is_loopback(url.hostname or ""):
                raise ValueError(f"IMPASTO_{name.upper()} begins with https://, except on loopback.")
        return self

    @property
    def loopback(self) -> bool:
        """Whether the service is bound to loopback."""
        return is_loopback(self.host)

    @property
    def open(self) -> bool:
        """Whether requests without a key are accepted, with every scope."""
        return self.auth == "off" or (self.auth == "auto" and self.loopback and not self.oidc_issuer)

    @property
    def uploads_dir(self) -> Path:
        return self.home / "uploads"


def is_loopback(host: str) -> bool:
    """Whether `host` (a name or address without port) always means this machine."""
    if host.lower().rstrip(".") == "localhost":
        return True
    return is_address(host) and ipaddress.ip_address(host.strip("[]")).is_loopback


def is_address(host: str) -> bool:
    """Whether `host` is an IP address, not a name."""
    try:
        ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        return False
    return True
