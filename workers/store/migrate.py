"""Bring a database to the newest schema version.

Alembic takes 0.2 s of CPU time to import, and the upgrade of an empty database 0.2 s more. An empty database therefore
gets its tables from `schema.metadata`, the version of a database is compared first, and Alembic upgrades the others.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from sqlalchemy import Column, Connection, MetaData, PrimaryKeyConstraint, String, Table, insert, inspect, select

from pipeline.errors import StorageError
from workers.store.schema import metadata

FOLDER = Path(__file__).parent / "migrations"
_VERSION = Table(
    "alembic_version",
    MetaData(),
    Column("version_num", String(32), nullable=False),
    PrimaryKeyConstraint("version_num", name="alembic_version_pkc"),
)
"""Alembic's own table, of one row."""


def migrate(connection: Connection) -> None:
    """Upgrade to the newest version, in the transaction of `connection`.

    Raises:
        StorageError: the database is of a newer version than this program.
    """
    if not inspect(connection).get_table_names():
        metadata.create_all(connection)
        _VERSION.create(connection)
        connection.execute(insert(_VERSION).values(version_num=newest_version()))
    elif version_of(connection) != newest_version():
        _upgrade(connection)


def _upgrade(connection: Connection) -> None:
    from alembic import command
    from alembic.config import Config
    from alembic.util.exc import CommandError

    config = Config()
    config.set_main_option("script_location", str(FOLDER))
    config.attributes["connection"] = connection
    try:
        command.upgrade(config, "head")
    except CommandError as error:  # this program does not know the database's revision
        remedy = "Start the newer version again, or restore the backup from before the upgrade."
        raise StorageError("The database belongs to a newer version of Impasto.", remedy=remedy) from error


def version_of(connection: Connection) -> str | None:
    """The schema version of a database; None if it has none."""
    if not inspect(connection).has_table(_VERSION.name):
        return None
    found = connection.execute(select(_VERSION.c.version_num)).scalar()
    return None if found is None else str(found)


@cache
def newest_version() -> str:
    """The last revision in migrations/versions, whose files are named v<revision>_<subject>.py."""
    return max(path.name[1:5] for path in (FOLDER / "versions").glob("v[0-9]*.py"))
