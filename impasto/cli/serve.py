"""`impasto serve`: the service, its web page and its workers, in one command."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated
from urllib.parse import urlsplit

import typer

from impasto.cli.console import print_status
from impasto.cli.option_classes import takes_options
from impasto.cli.options import BlobsOption, DatabaseOption, HomeOption, S3EndpointOption, home_of
from workers.process.starting import keep_files_private, readable_by_others, without_garbage_collection

if TYPE_CHECKING:
    from service.settings import Settings

EPILOG = """[bold]Examples[/bold]

impasto serve

impasto serve --port 9000 --workers 4

impasto keys create alice && impasto serve --host 0.0.0.0

impasto serve --farm ray --ray-address auto --workers 16

impasto serve --database postgresql://impasto@db/impasto --blobs s3://films/impasto --s3-endpoint http://s3:9000

Every setting can come from the environment as well: IMPASTO_PORT, IMPASTO_HOME, IMPASTO_MAX_ASSET_BYTES, ...
Secrets should: IMPASTO_DATABASE_URL, IMPASTO_S3_ACCESS_KEY and IMPASTO_S3_SECRET_KEY, IMPASTO_ADMIN_KEY.
"""


class FarmKind(StrEnum):
    """Backend that runs the tasks."""

    LOCAL = "local"
    RAY = "ray"


class Auth(StrEnum):
    """Conditions under which a key is required."""

    AUTO = "auto"
    REQUIRED = "required"
    OFF = "off"


@dataclass(frozen=True, kw_only=True)
class ServeOptions:
    """Options of `impasto serve`."""

    host: Annotated[str | None, typer.Option(help="Address to listen on; 0.0.0.0 for all networks.")] = None
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="Port; default: 8420; 0 selects a free one.")] = (
        None
    )
    home: HomeOption = None
    farm: Annotated[FarmKind | None, typer.Option(help="Workers in this process, or on a Ray cluster.")] = None
    workers: Annotated[
        int | None, typer.Option(min=1, max=256, help="Simultaneous tasks; default: as many as fit.")
    ] = None
    ray_address: Annotated[str | None, typer.Option(help="Address of a Ray cluster; default: start one here.")] = None
    database: DatabaseOption = None
    blobs: BlobsOption = None
    s3_endpoint: S3EndpointOption = None
    auth: Annotated[Auth | None, typer.Option(help="auto: keys are required unless it listens on loopback only.")] = (
        None
    )


@takes_options(ServeOptions)
def serve(options: ServeOptions) -> None:
    """Start the service: the API at /v1, its documentation at /docs, the web page at /.

    Its address is the one line on stdout, printed once it answers. Ctrl-C stops it; unfinished jobs continue at the
    next start.
    """
    with without_garbage_collection():
        from impasto.settings import load
        from service.server import serve as run
        from service.settings import Settings

    settings = load(
        Settings,
        host=options.host,
        port=options.port,
        home=home_of(options.home),
        pool=options.farm and options.farm.value,
        workers=options.workers,
        ray_address=options.ray_address,
        database_url=options.database,
        blob_url=options.blobs,
        s3_endpoint_url=options.s3_endpoint,
        auth=options.auth and options.auth.value,
    )
    keep_files_private()
    if mode := readable_by_others(settings.home):
        print_status(f"Other users of this machine can enter {settings.home} (mode {mode}): chmod 700 it.")
    print_status(f"{_places(settings)} Ctrl-C stops it.")
    run(settings, typer.echo)


def _places(settings: Settings) -> str:
    """The places of the service's data, without passwords."""
    database, blobs = settings.database_url, settings.blob_url or settings.blob_root
    if not database and not blobs:
        return f"Impasto keeps everything in {settings.home}."
    jobs = urlsplit(database)._replace(netloc=urlsplit(database).netloc.rpartition("@")[2], query="").geturl()
    return (
        f"Impasto keeps jobs and projects in {jobs or settings.home}, files in {blobs or settings.blobs_at}, and "
        f"unfinished uploads and its secret in {settings.home}."
    )
