"""Reuse of task results by later jobs."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("jobs", sa.Column("base_id", sa.String(40), nullable=True))
    op.add_column("tasks", sa.Column("trace", sa.JSON(), nullable=True))
    op.add_column("tasks", sa.Column("reused", sa.Boolean(), nullable=False, server_default=sa.false()))
    op.add_column("steps", sa.Column("reused", sa.Integer(), nullable=False, server_default="0"))


def downgrade() -> None:
    op.drop_column("steps", "reused")
    op.drop_column("tasks", "reused")
    op.drop_column("tasks", "trace")
    op.drop_column("jobs", "base_id")
