"""How Alembic connects: with the connection that `Database` hands it, or, for developers, to an empty SQLite."""

from __future__ import annotations

from alembic import context

from workers.store.schema import metadata

connection = context.config.attributes["connection"]
context.configure(connection=connection, target_metadata=metadata)
with context.begin_transaction():
    context.run_migrations()
