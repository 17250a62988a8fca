"""What the command takes from the environment (prefix `IMPASTO_`), read once at its start; flags win over it."""

from __future__ import annotations

from pathlib import Path

import platformdirs
from pydantic import Field, SecretStr
from pydantic_settings import BaseSettings, SettingsConfigDict

from impasto import DEFAULT_SERVER


class CommandSettings(BaseSettings):
    """Where the command keeps its work, and which service it talks to."""

    model_config = SettingsConfigDict(env_prefix="IMPASTO_", extra="ignore", frozen=True)

    home: Path = Field(default_factory=lambda: platformdirs.user_data_path("impasto"))
    server: str = DEFAULT_SERVER
    api_key: SecretStr = SecretStr("")
