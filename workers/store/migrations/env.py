"""Connection of Alembic: the one that `Database` passes, or, for developers, one to an empty SQLite database."""

from __future__ import annotations

from alembic import context

from workers.store.schema import metadata

connection = context.config.attributes["connection"]
context.configure(connection=connection, target_metadata=metadata)
with context.begin_transaction():
    context.run_migrations()
