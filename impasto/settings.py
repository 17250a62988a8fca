"""Settings of the command from the environment (prefix `IMPASTO_`). Flags override them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

import platformdirs
from pydantic import Field, SecretStr, ValidationError
from pydantic_settings import BaseSettings, SettingsConfigDict

from impasto_client import DEFAULT_SERVER
from pipeline.errors import BadInput

S = TypeVar("S", bound=BaseSettings)


class CommandSettings(BaseSettings):
    """The command's data folder, and the service that it uses."""

    model_config = SettingsConfigDict(env_prefix="IMPASTO_", extra="ignore", frozen=True, env_ignore_empty=True)

    home: Path = Field(default_factory=lambda: platformdirs.user_data_path("impasto"))
    server: str = DEFAULT_SERVER
    api_key: SecretStr = SecretStr("")


def load(kind: type[S], **flags: Any) -> S:
    """Settings from flags that were given (not None), then the environment, then defaults.

    Raises: BadInput that names the setting.
    """
    try:
        return kind(**{name: value for name, value in flags.items() if value is not None})
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(str(part) for part in first["loc"])
        raise BadInput(
            f"{first['msg']}.",
            field=f"IMPASTO_{name.upper()}",
            value=first.get("input"),
            remedy=f"Correct the environment variable, or the flag --{name.replace('_', '-')}.",
        ) from None
