"""Adds the expected weight of a step before it is planned."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("steps", sa.Column("expected", sa.Double(), nullable=False, server_default="1"))


def downgrade() -> None:
    op.drop_column("steps", "expected")
