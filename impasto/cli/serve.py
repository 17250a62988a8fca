"""`impasto serve`: the service, its web page and its workers, in one command."""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from impasto.cli.console import say
from impasto.cli.options import HomeOption, home_of

if TYPE_CHECKING:
    from service.settings import Settings
    from workers.settings import FarmSettings

EPILOG = """[bold]Examples[/bold]

impasto serve

impasto serve --port 9000 --workers 4

impasto keys create alice && impasto serve --host 0.0.0.0

impasto serve --farm ray --ray-address auto --workers 16

Every setting can come from the environment as well: IMPASTO_PORT, IMPASTO_HOME, IMPASTO_MAX_UPLOAD_BYTES, ...
"""


class FarmKind(StrEnum):
    """Where tasks run."""

    LOCAL = "local"
    RAY = "ray"


class Auth(StrEnum):
    """Who is let in without a key."""

    AUTO = "auto"
    REQUIRED = "required"
    OFF = "off"


def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen at; 0.0.0.0 for every network.")] = None,
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="Port; 0 takes a free one.")] = None,
    home: HomeOption = None,
    farm: Annotated[FarmKind, typer.Option(help="Workers in this process, or on a Ray cluster.")] = FarmKind.LOCAL,
    workers: Annotated[
        int | None, typer.Option(min=1, max=256, help="Tasks that run at once; else one for each core.")
    ] = None,
    ray_address: Annotated[str, typer.Option(help="A Ray cluster's address; local starts one here.")] = "local",
    database: Annotated[str, typer.Option(metavar="URL", help="Database; else SQLite in the home folder.")] = "",
    auth: Annotated[
        Auth | None, typer.Option(help="auto: keys are needed unless it listens on this machine only.")
    ] = None,
) -> None:
    """Start the service: the API at /v1, its documentation at /docs, the web page at /."""
    from service.server import serve as run

    settings = _settings(host, port, home, auth)
    say(f"Impasto keeps everything in {settings.home}")
    run(settings, _farm_settings(settings.home, farm, workers, ray_address, database))


def _settings(host: str | None, port: int | None, home: Path | None, auth: Auth | None) -> Settings:
    """What the flags say, then the environment, then the defaults."""
    from service.settings import Settings

    flags = {"host": host, "port": port, "home": home_of(home), "auth": auth and auth.value}
    return Settings.model_validate({name: value for name, value in flags.items() if value is not None})


def _farm_settings(home: Path, farm: FarmKind, workers: int | None, ray_address: str, database: str) -> FarmSettings:
    from workers.settings import FarmSettings

    return FarmSettings(
        home=home,
        pool=farm.value,
        workers=workers or os.cpu_count() or 1,
        ray_address=ray_address,
        database_url=database,
    )
