"""Users and groups: every owner of before is a user. Keys expire, and say when they were used. Who did what, what jobs
have cost, and rules that delete old jobs."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None

_NO_OWNER = """INSERT INTO owners (id, name, quotas, created_at, kind)
    SELECT id, name, quotas, created_at, 'user' FROM api_keys
    WHERE owner IS NULL AND id NOT IN (SELECT id FROM owners)"""
"""Keys that a program of before version 9 made beside a newer one."""


def upgrade() -> None:
    op.add_column("owners", sa.Column("kind", sa.String(length=8), nullable=False, server_default="user"))
    op.add_column("owners", sa.Column("subject", sa.String(length=500), nullable=True))
    op.add_column("owners", sa.Column("disabled_at", sa.Double(), nullable=True))
    op.create_index("ix_owners_subject", "owners", ["subject"], unique=True)
    op.add_column("api_keys", sa.Column("expires_at", sa.Double(), nullable=True))
    op.add_column("api_keys", sa.Column("used_at", sa.Double(), nullable=True))
    op.add_column("api_keys", sa.Column("session", sa.Boolean(), nullable=False, server_default=sa.false()))
    op.create_index("ix_api_keys_owner", "api_keys", ["owner"])
    op.execute(_NO_OWNER)
    op.execute("UPDATE api_keys SET owner = id WHERE owner IS NULL")
    _create_tables()


def _create_tables() -> None:
    op.create_table(
        "members",
        sa.Column("group_id", sa.String(length=80), nullable=False),
        sa.Column("user_id", sa.String(length=80), nullable=False),
        sa.Column("role", sa.String(length=8), nullable=False),
        sa.ForeignKeyConstraint(["group_id"], ["owners.id"], name=op.f("fk_members_group_id"), ondelete="CASCADE"),
        sa.ForeignKeyConstraint(["user_id"], ["owners.id"], name=op.f("fk_members_user_id"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("group_id", "user_id", name=op.f("pk_members")),
    )
    op.create_index("ix_members_user_id", "members", ["user_id"])
    op.create_table(
        "audit",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("at", sa.Double(), nullable=False),
        sa.Column("user", sa.String(length=80), nullable=False),
        sa.Column("key", sa.String(length=40), nullable=False),
        sa.Column("owner", sa.String(length=80), nullable=False),
        sa.Column("action", sa.String(length=80), nullable=False),
        sa.Column("object", sa.Text(), nullable=False),
        sa.Column("address", sa.String(length=80), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_audit")),
    )
    op.create_index("ix_audit_user_id", "audit", ["user", "id"])
    op.create_table(
        "job_costs",
        sa.Column("job_id", sa.String(length=40), nullable=False),
        sa.Column("owner", sa.String(length=80), nullable=False),
        sa.Column("labels", sa.JSON(), nullable=False),
        sa.Column("ended_at", sa.Double(), nullable=False),
        sa.Column("cpu_s", sa.Double(), nullable=False),
        sa.Column("busy_s", sa.Double(), nullable=False),
        sa.Column("bytes", sa.BigInteger(), nullable=True),
        sa.PrimaryKeyConstraint("job_id", name=op.f("pk_job_costs")),
    )
    op.create_index("ix_job_costs_ended_at", "job_costs", ["ended_at"])
    op.create_table(
        "retention_rules",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("days", sa.Double(), nullable=False),
        sa.Column("owner", sa.String(length=80), nullable=True),
        sa.Column("label", sa.String(length=80), nullable=True),
        sa.Column("value", sa.String(length=255), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_retention_rules")),
    )


def downgrade() -> None:
    for table in ("retention_rules", "job_costs", "audit", "members"):
        op.drop_table(table)
    op.drop_index("ix_api_keys_owner", "api_keys")
    op.drop_index("ix_owners_subject", "owners")
    for column in ("session", "used_at", "expires_at"):
        op.drop_column("api_keys", column)
    for column in ("disabled_at", "subject", "kind"):
        op.drop_column("owners", column)
