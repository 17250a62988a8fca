"""Bring a database to the newest schema version.

Alembic takes 0.2 s of CPU time to import and 10 ms to find that nothing is to be done, and most processes find the
database up to date. The version is therefore compared first.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from sqlalchemy import Connection, inspect, text

from pipeline.errors import StorageError

FOLDER = Path(__file__).parent / "migrations"


def migrate(connection: Connection) -> None:
    """Upgrade to the newest version, in the transaction of `connection`.

    Raises:
        StorageError: the database is of a newer version than this program.
    """
    if version_of(connection) == newest_version():
        return
    from alembic import command
    from alembic.config import Config
    from alembic.util.exc import CommandError

    config = Config()
    config.set_main_option("script_location", str(FOLDER))
    config.attributes["connection"] = connection
    try:
        command.upgrade(config, "head")
    except CommandError as error:  # it does not know the revision that the database is at
        remedy = "Start the newer version again, or restore the backup from before the upgrade."
        raise StorageError("The database belongs to a newer version of Impasto.", remedy=remedy) from error


def version_of(connection: Connection) -> str | None:
    """The schema version of a database; None for an empty one."""
    if not inspect(connection).has_table("alembic_version"):
        return None
    found = connection.execute(text("SELECT version_num FROM alembic_version")).scalar()
    return None if found is None else str(found)


@cache
def newest_version() -> str:
    """The last revision in migrations/versions, whose files are named v<revision>_<subject>.py."""
    return max(path.name[1:5] for path in (FOLDER / "versions").glob("v[0-9]*.py"))
