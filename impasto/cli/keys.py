"""`impasto keys`: API keys of a service. Works on its home, so only its operator can."""

from __future__ import annotations

import getpass
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from impasto.cli.console import emit, out, print_status, print_table, table
from impasto.cli.options import DatabaseOption, HomeOption, JsonFlag, home_of
from workers.contract.owners import AuditEntry
from workers.contract.request import Json
from workers.process.starting import keep_files_private

if TYPE_CHECKING:
    from workers.contract.record import ApiKey
    from workers.store.keys import Keys

app = typer.Typer(no_args_is_help=True, help="Create, list, replace and revoke API keys of the service with this home.")


@app.command()
def create(
    name: Annotated[str, typer.Argument(help="Name of the key's user, for your own reference.")],
    scope: Annotated[list[str] | None, typer.Option(help="read, submit or admin; several are possible.")] = None,
    owner: Annotated[str | None, typer.Option(help="An existing user, who gets a further key; else a new one.")] = None,
    days: Annotated[float | None, typer.Option(min=0, help="The key ends by itself after so many days.")] = None,
    home: HomeOption = None,
    database: DatabaseOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Create a key and show its secret, which cannot be shown again."""
    ends = None if days is None else time.time() + days * 86400
    with _keys(home, database) as (keys, record):
        key, secret = keys.create(name, scope or ["read", "submit"], owner=owner, expires_at=ends)
        record("create_key", key)
    _show_secret(key, secret, as_json)


@app.command()
def rotate(
    key_id: Annotated[str, typer.Argument(metavar="KEY", help="The key's id.")],
    home: HomeOption = None,
    database: DatabaseOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Replace a key: show the secret of a new one with the same owner and scopes, and revoke the old one."""
    with _keys(home, database) as (keys, record):
        key, secret = keys.rotate(key_id)
        record("rotate_key", key)
    _show_secret(key, secret, as_json)


def _show_secret(key: ApiKey, secret: str, as_json: bool) -> None:
    if as_json:
        emit(_row(key) | {"secret": secret})
        return
    out.print(secret, markup=False)
    scopes = ", ".join(sorted(key.scopes))
    print_status(f"{key.id} for {key.name}, owner {key.owner}: {scopes}. The secret is not stored: copy it now.")


@app.command("list")
def list_(home: HomeOption = None, database: DatabaseOption = None, as_json: JsonFlag = False) -> None:
    """List every key, revoked ones too; secrets are not kept."""
    with _keys(home, database) as (keys, _):
        rows = [_row(key) for key in keys.list()]
    if as_json:
        emit(rows)
        return
    listed = table("key", "owner", "name", "scopes", "created", "last used", "expires", "revoked")
    for row in rows:
        listed.add_row(
            row["id"],
            row["owner"],
            row["name"],
            ", ".join(row["scopes"]),
            _day(row["created_at"]),
            _day(row["used_at"]),
            _day(row["expires_at"]),
            _day(row["revoked_at"]),
        )
    print_table(listed)


@app.command()
def revoke(
    key_id: Annotated[str, typer.Argument(metavar="KEY", help="The key's id.")],
    home: HomeOption = None,
    database: DatabaseOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Revoke a key at once."""
    with _keys(home, database) as (keys, record):
        key = keys.revoke(key_id)
        record("revoke_key", key)
    emit(_row(key)) if as_json else print_status(f"{key.id} ({key.name}) is revoked.")


@contextmanager
def _keys(home: Path | None, database: str | None) -> Iterator[tuple[Keys, Callable[[str, ApiKey], None]]]:
    """The keys of the home, or of its database, and what records a change of one in the audit trail. The farm has no
    pool, so that it does not disturb a running service."""
    from impasto.settings import load
    from service.settings import Settings
    from workers.farm import open_farm

    before = keep_files_private()
    try:
        farm = open_farm(load(Settings, home=home_of(home), database_url=database, pool="none"))
        try:
            yield farm.keys, lambda action, key: farm.audit.add(_entry(action, key))
        finally:
            farm.stop()
    finally:
        os.umask(before)


def _entry(action: str, key: ApiKey) -> AuditEntry:
    return AuditEntry(action, key.id, f"command:{getpass.getuser()}"[:80], owner=key.owner)


def _row(key: ApiKey) -> Json:
    return {
        "id": key.id,
        "owner": key.owner,
        "name": key.name,
        "scopes": sorted(key.scopes),
        "quotas": key.quotas,
        "created_at": key.created_at,
        "revoked_at": key.revoked_at,
        "expires_at": key.expires_at,
        "used_at": key.used_at,
    }


def _day(at: float | None) -> str:
    return "" if at is None else datetime.fromtimestamp(at).astimezone().strftime("%Y-%m-%d")
