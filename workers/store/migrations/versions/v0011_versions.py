"""Versions of a job's steps. Programs before them may not begin what newer ones have planned: they are drained."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None

_DRAIN = """INSERT INTO drains (place, name, at, by, reason)
    SELECT 'worker', id, seen_at, '', 'A newer version of Impasto has been started.' FROM dispatchers
    WHERE id NOT IN (SELECT name FROM drains WHERE place = 'worker')"""


def upgrade() -> None:
    op.add_column("jobs", sa.Column("versions", sa.JSON(), nullable=True))
    op.add_column("jobs", sa.Column("planned_by", sa.String(40), nullable=False, server_default=""))
    op.execute(_DRAIN)


def downgrade() -> None:
    op.drop_column("jobs", "planned_by")
    op.drop_column("jobs", "versions")
