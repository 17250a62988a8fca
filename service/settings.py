"""Settings of a service process, read once at its entry (prefix `IMPASTO_`) and passed down."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Literal

import platformdirs
from pydantic import Field, SecretStr
from pydantic_settings import BaseSettings, SettingsConfigDict

from workers.settings import FarmSettings

MIB = 1 << 20


class Settings(BaseSettings, FarmSettings):
    """What an operator may choose: how the farm works (`FarmSettings`) and how the service answers.

    Sizes are in bytes, times in seconds.
    """

    model_config = SettingsConfigDict(env_prefix="IMPASTO_", extra="ignore", frozen=True)

    home: Path = Field(default_factory=lambda: platformdirs.user_data_path("impasto"))

    host: str = "127.0.0.1"
    port: int = Field(default=8420, ge=0, le=65535)

    auth: Literal["auto", "required", "off"] = "auto"
    """"auto": no key is needed while bound to loopback, one is needed otherwise."""
    admin_key: SecretStr | None = None
    """A key with every scope that is kept nowhere: the way in to a fresh server."""
    allowed_hosts: frozenset[str] = frozenset()
    """More names that a request may give as its Host while no key is needed (loopback names always may)."""

    requests_per_minute: int = Field(default=6000, ge=1)
    """In the long run, a key (or an address without one); a sixth of it may come at once. A key may have its own."""
    quota_active_jobs: int = Field(default=1000, ge=1)
    """Unfinished jobs an owner may have; a key may have its own bound."""
    quota_asset_bytes: int | None = Field(default=None, ge=1)
    """Bytes of assets an owner may keep (None: any); a key may have its own bound."""

    max_json_bytes: int = Field(default=1 * MIB, ge=1024)
    upload_ttl_s: float = Field(default=24 * 3600.0, gt=0)
    """An unfinished resumable upload is forgotten after this long without a byte."""
    idle_s: float = Field(default=60.0, gt=0)
    """A request body that brings nothing for this long is given up."""

    heartbeat_s: float = Field(default=15.0, gt=0)
    max_streams: int = Field(default=100, ge=1)
    """Event streams open at once."""
    preview_slots: int = Field(default=2, ge=1)
    """Previews made at once; more are told to come back."""
    frame_slots: int = Field(default=4, ge=1)
    """Single frames of assets decoded at once; more wait a moment, then are told to come back."""

    live_hello_s: float = Field(default=10.0, gt=0)
    """A live connection says hello within this time."""
    live_idle_s: float = Field(default=60.0, gt=0)
    """A live session without a frame for this long ends."""
    live_resume_s: float = Field(default=10.0, ge=0)
    """A live session waits this long for a client that was lost."""
    live_slow_s: float = Field(default=90.0, gt=0)
    """A live client that reads nothing for this long is closed."""
    live_ping_s: float = Field(default=20.0, gt=0)
    """WebSocket clients are pinged this often; one that is silent for as long after it is lost."""

    webhook_secret: SecretStr | None = Field(default=None, min_length=32)
    """What webhooks are signed from, the same for all processes of a service; None: a file in the home, made once."""
    webhook_private: bool = False
    """Allow webhook targets on private and loopback addresses."""
    webhook_timeout_s: float = Field(default=10.0, gt=0)
    webhook_poll_s: float = Field(default=1.0, gt=0)

    @property
    def loopback(self) -> bool:
        """Whether the service is bound to this machine only."""
        return is_loopback(self.host)

    @property
    def open(self) -> bool:
        """Whether requests without a key are let in, with every scope."""
        return self.auth == "off" or (self.auth == "auto" and self.loopback)

    @property
    def uploads_dir(self) -> Path:
        return self.home / "uploads"


def is_loopback(host: str) -> bool:
    """Whether `host` (a name or an address, no port) can only mean this machine."""
    if host.lower().rstrip(".") == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False
