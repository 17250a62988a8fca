"""What all tables share: their metadata, and restrictions of indexes to some rows."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Connection, MetaData, event, text

metadata = MetaData(
    naming_convention={
        "pk": "pk_%(table_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "uq": "uq_%(table_name)s_%(column_0_name)s",
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    }
)

_ROWS = "rows"
"""Key of an index's `info`: the condition for its rows in PostgreSQL, see `restrict_indexes`."""


def rows_where(condition: str, in_sqlite: str = "") -> dict[str, Any]:
    """Restriction of a partial index to these rows."""
    return {"sqlite_where": text(in_sqlite or condition), "info": {_ROWS: condition}}


def restrict_indexes() -> None:
    """Give the partial indexes their conditions for PostgreSQL.

    SQLAlchemy imports all drivers of a database whose options it meets, which would delay every start.
    """
    for table in metadata.tables.values():
        for index in table.indexes:
            if _ROWS in index.info:
                index.dialect_kwargs["postgresql_where"] = text(index.info[_ROWS])


@event.listens_for(metadata, "before_create")
def _before_create(_target: MetaData, connection: Connection, **_options: Any) -> None:
    if connection.dialect.name == "postgresql":
        restrict_indexes()
