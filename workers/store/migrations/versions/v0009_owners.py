"""Owners: what a key made belongs to its owner, who may have several keys. A key of before is the first key of an
owner with the key's id, so that jobs, assets and projects keep their owner.

`api_keys.owner` is NULL, and `api_keys.quotas` is kept, for programs of before this version that run beside it.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "owners",
        sa.Column("id", sa.String(length=80), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("quotas", sa.JSON(), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_owners")),
    )
    op.execute("INSERT INTO owners (id, name, quotas, created_at) SELECT id, name, quotas, created_at FROM api_keys")
    op.add_column("api_keys", sa.Column("owner", sa.String(length=80), nullable=True))
    op.execute("UPDATE api_keys SET owner = id")


def downgrade() -> None:
    op.drop_column("api_keys", "owner")
    op.drop_table("owners")
