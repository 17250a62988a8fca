"""Options that several commands share, so that they read and mean the same everywhere."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from impasto.client import Client


class Damage(StrEnum):
    WARN = "warn"
    FAIL = "fail"


WHERE, WHAT = "Where", "What to paint"

MethodOption = Annotated[str, typer.Option("--method", "-m", help="See `impasto methods`.", rich_help_panel=WHAT)]
ParamOption = Annotated[
    list[str] | None,
    typer.Option(
        "--param", "-p", metavar="NAME=VALUE", help="A parameter of the method; repeatable.", rich_help_panel=WHAT
    ),
]
InputOption = Annotated[
    list[str] | None,
    typer.Option("--input", "-i", metavar="NAME=PATH", help="Another input: a file or a folder.", rich_help_panel=WHAT),
]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of all random choices.", rich_help_panel=WHAT)]
QualityOption = Annotated[
    int, typer.Option(min=0, max=51, help="Rate factor of the video codec: lower is better.", rich_help_panel=WHAT)
]
DamageOption = Annotated[
    Damage,
    typer.Option(
        help="If frames of an input are missing or unreadable: use what can be read, or fail.", rich_help_panel=WHAT
    ),
]
HomeOption = Annotated[
    Path | None,
    typer.Option(help="Folder for data; else IMPASTO_HOME, else your data folder.", rich_help_panel=WHERE),
]
DatabaseOption = Annotated[
    str | None,
    typer.Option(
        metavar="URL",
        help="postgresql://...; else IMPASTO_DATABASE_URL, else SQLite in the home.",
        rich_help_panel=WHERE,
    ),
]
ServerOption = Annotated[
    str | None,
    typer.Option(metavar="URL", help="The service; else IMPASTO_SERVER, else this machine.", rich_help_panel=WHERE),
]
KeyOption = Annotated[str | None, typer.Option(help="API key; else IMPASTO_API_KEY.", rich_help_panel=WHERE)]
QuietFlag = Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")]
JsonFlag = Annotated[bool, typer.Option("--json", help="Print one JSON object on the last line of stdout.")]


def home_of(given: Path | None) -> Path:
    """The home folder: from the flag, else from the environment, else the user's data folder."""
    from impasto.settings import CommandSettings, load

    return load(CommandSettings, home=given).home.expanduser().absolute()


def client_of(server: str | None, api_key: str | None) -> Client:
    """A client for the service that flags or the environment name."""
    from impasto.client import Client
    from impasto.settings import CommandSettings, load

    settings = load(CommandSettings, server=server, api_key=api_key)
    return Client(settings.server, settings.api_key.get_secret_value())
