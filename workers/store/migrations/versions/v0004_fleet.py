"""The fleet: who each dispatcher is and its slots, what operators have drained, and live sessions of every process."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


_OF_A_WORKER: tuple[tuple[str, Any, str], ...] = (
    ("seen_at", sa.Double(), "0"),
    ("host", sa.String(length=120), ""),
    ("role", sa.String(length=12), ""),
    ("kind", sa.String(length=12), ""),
    ("version", sa.String(length=40), ""),
)


def upgrade() -> None:
    for name, kind, default in _OF_A_WORKER:
        op.add_column("dispatchers", sa.Column(name, kind, nullable=False, server_default=default))
    op.create_table(
        "slots",
        sa.Column("dispatcher", sa.String(length=80), nullable=False),
        sa.Column("name", sa.String(length=120), nullable=False),
        sa.Column("node", sa.String(length=120), nullable=False),
        sa.Column("cpus", sa.Double(), nullable=False),
        sa.Column("gpus", sa.Double(), nullable=False),
        sa.Column("memory_bytes", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["dispatcher"], ["dispatchers.id"], name=op.f("fk_slots_dispatcher"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("dispatcher", "name", name=op.f("pk_slots")),
    )
    op.create_table(
        "drains",
        sa.Column("place", sa.String(length=12), nullable=False),
        sa.Column("name", sa.String(length=120), nullable=False),
        sa.Column("at", sa.Double(), nullable=False),
        sa.Column("by", sa.String(length=80), nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("place", "name", name=op.f("pk_drains")),
    )
    op.create_table(
        "live_sessions",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("process", sa.String(length=120), nullable=False),
        sa.Column("owner", sa.String(length=80), nullable=False),
        sa.Column("method", sa.String(length=80), nullable=False),
        sa.Column("width", sa.Integer(), nullable=False),
        sa.Column("height", sa.Integer(), nullable=False),
        sa.Column("opened_at", sa.Double(), nullable=False),
        sa.Column("connected", sa.Boolean(), nullable=False),
        sa.Column("figures", sa.JSON(), nullable=False),
        sa.Column("ending", sa.Boolean(), nullable=False),
        sa.Column("seen_at", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_live_sessions")),
    )
    op.add_column("tasks", sa.Column("needs", sa.JSON(), nullable=True))
    op.create_index(op.f("ix_attempts_job_id_started_at"), "attempts", ["job_id", "started_at"])


def downgrade() -> None:
    op.drop_index(op.f("ix_attempts_job_id_started_at"), "attempts")
    op.drop_column("tasks", "needs")
    for table in ("live_sessions", "drains", "slots"):
        op.drop_table(table)
    for name, _, _ in _OF_A_WORKER:
        op.drop_column("dispatchers", name)
