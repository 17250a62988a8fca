"""Parts of the installation that only some users need: extras of the package."""

from __future__ import annotations

import importlib.util

from pipeline.errors import BadParameter
from workers.settings import FarmSettings

MODULES = {"cluster": "ray", "cuts": "opentimelineio", "s3": "boto3", "postgresql": "psycopg", "oidc": "authlib"}
"""Extra -> the module that it installs."""


def check_installed(settings: FarmSettings) -> None:
    """Raise BadParameter if a setting needs an extra that is not installed."""
    if settings.pool == "ray":
        require_extra("cluster", "pool", "ray")
    if settings.blob_url:
        require_extra("s3", "blob_url", settings.blob_url)
    if not settings.url.startswith("sqlite"):
        require_extra("postgresql", "database_url", settings.url.partition(":")[0])


def require_extra(extra: str, field: str, value: str) -> None:
    """Raise BadParameter unless the extra is installed. `field` and `value` name the setting that needs it."""
    if importlib.util.find_spec(MODULES[extra]) is None:
        raise BadParameter(
            f"This needs the package {MODULES[extra]}, which is not installed.",
            field=field,
            value=value,
            remedy=f"pip install 'impasto[{extra}]'",
        )
