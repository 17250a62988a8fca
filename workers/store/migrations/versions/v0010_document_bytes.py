"""Bytes that the versions of a project take, for the quota of its owner."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("projects", sa.Column("stored_bytes", sa.BigInteger(), nullable=False, server_default="0"))
    stored = "SELECT COALESCE(SUM(LENGTH(body)), 0) FROM project_versions WHERE project_id = projects.id"
    op.execute(sa.text(f"UPDATE projects SET stored_bytes = ({stored})"))  # noqa: S608  (constants)


def downgrade() -> None:
    op.drop_column("projects", "stored_bytes")
