"""Many dispatchers: their leases in a table of their own, and small indexes for what claims and plans look for."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

_ACTIVE = "state IN ('queued', 'running')"
_UNFINISHED = "state IN ('queued', 'running', 'paused')"


def upgrade() -> None:
    _dispatchers()
    _ready()
    _index("ix_jobs_ready", ["priority", "owner", "id"], "ready > 0")
    _index("ix_jobs_unplanned", ["priority", "id"], f"NOT planned AND {_ACTIVE}", f"planned = 0 AND {_ACTIVE}")
    _index("ix_jobs_unfinished", ["owner"], _UNFINISHED)
    op.drop_index(op.f("ix_attempts_job_id"), table_name="attempts")
    op.create_index(op.f("ix_attempts_job_id_finished_at"), "attempts", ["job_id", "finished_at"], unique=False)


def _dispatchers() -> None:
    """Dispatchers that run attempts now keep their present leases."""
    op.create_table(
        "dispatchers",
        sa.Column("id", sa.String(length=80), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=False),
        sa.Column("lease_until", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_dispatchers")),
    )
    op.execute(
        "INSERT INTO dispatchers (id, started_at, lease_until)"
        " SELECT dispatcher, min(started_at), max(lease_until) FROM attempts WHERE outcome = 'running'"
        " GROUP BY dispatcher"
    )
    op.drop_column("attempts", "lease_until")


def _ready() -> None:
    op.add_column("jobs", sa.Column("ready", sa.Integer(), nullable=False, server_default="0"))
    op.execute(
        "UPDATE jobs SET ready ="
        " (SELECT steps.ready FROM steps WHERE steps.job_id = jobs.id AND steps.step = jobs.step)"
        " WHERE planned AND NOT doomed AND state IN ('queued', 'running')"
    )


def _index(name: str, columns: list[str], where: str, in_sqlite: str = "") -> None:
    sqlite_where = sa.text(in_sqlite or where)
    op.create_index(name, "jobs", columns, unique=False, postgresql_where=sa.text(where), sqlite_where=sqlite_where)


def downgrade() -> None:
    op.drop_index(op.f("ix_attempts_job_id_finished_at"), table_name="attempts")
    op.create_index(op.f("ix_attempts_job_id"), "attempts", ["job_id"], unique=False)
    for name in ("ix_jobs_unfinished", "ix_jobs_unplanned", "ix_jobs_ready"):
        op.drop_index(name, table_name="jobs")
    op.drop_column("jobs", "ready")
    op.add_column("attempts", sa.Column("lease_until", sa.Double(), nullable=False, server_default="0"))
    op.drop_table("dispatchers")
