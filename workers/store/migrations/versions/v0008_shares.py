"""Slot time used by every owner, counts over all jobs, recent pace of steps; indexes for listings and turns."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

JOB_STATES = ("queued", "running", "paused", "succeeded", "failed", "cancelled")
TASK_STATES = ("waiting", "ready", "running", "succeeded", "failed", "cancelled")
ACTIVE = "state IN ('queued', 'running')"
UNFINISHED = "state IN ('queued', 'running', 'paused')"
OLD = {
    "ix_jobs_state_priority_id": (("state", "priority", "id"), ""),
    "ix_jobs_unplanned": (("priority", "id"), f"planned = false AND {ACTIVE}"),
    "ix_jobs_unfinished": (("owner",), UNFINISHED),
}
NEW = {
    "ix_jobs_state_id": (("state", "id"), ""),
    "ix_jobs_owner_state_id": (("owner", "state", "id"), ""),
    "ix_jobs_owner_method_id": (("owner", "method", "id"), ""),
    "ix_jobs_method_state_id": (("method", "state", "id"), ""),
    "ix_jobs_unplanned": (("priority", "owner", "id"), f"planned = false AND {ACTIVE}"),
    "ix_jobs_active": (("priority", "owner", "id"), ACTIVE),
    "ix_jobs_unfinished": (("owner", "id"), UNFINISHED),
    "ix_jobs_unfinished_id": (("id",), UNFINISHED),
}


def upgrade() -> None:
    op.create_table(
        "shares",
        sa.Column("owner", sa.String(80), primary_key=True),
        sa.Column("used_s", sa.Double(), nullable=False),
        sa.Column("floor_s", sa.Double(), nullable=False),
    )
    op.create_index("ix_shares_floor_s", "shares", ["floor_s"])
    counts = [*(f"jobs_{state}" for state in JOB_STATES), *(f"tasks_{state}" for state in TASK_STATES), "startable"]
    op.create_table(
        "tallies",
        sa.Column("shard", sa.Integer(), primary_key=True, autoincrement=False),
        *(sa.Column(name, sa.BigInteger(), nullable=False) for name in counts),
    )
    _count(counts)
    op.add_column("steps", sa.Column("pace_s", sa.Double(), nullable=True))
    _replace(OLD, NEW)


def downgrade() -> None:
    _replace(NEW, OLD)
    op.drop_column("steps", "pace_s")
    op.drop_table("tallies")
    op.drop_table("shares")


def _count(names: list[str]) -> None:
    """One row with the present counts; further rows are added with the first changes."""
    connection = op.get_bind()
    by_state = connection.execute(sa.text("SELECT 'jobs_' || state, count(*) FROM jobs GROUP BY state"))
    found: dict[str, int] = {name: int(count) for name, count in by_state}
    steps = sa.table("steps", *(sa.column(state) for state in TASK_STATES))
    tasks = connection.execute(sa.select(*(sa.func.coalesce(sa.func.sum(column), 0) for column in steps.c))).one()
    found |= {f"tasks_{state}": int(count) for state, count in zip(TASK_STATES, tasks, strict=True)}
    found["startable"] = int(connection.execute(sa.text("SELECT coalesce(sum(ready), 0) FROM jobs")).scalar_one())
    tallies = sa.table("tallies", sa.column("shard"), *(sa.column(name) for name in names))
    connection.execute(sa.insert(tallies).values(shard=0, **{name: found.get(name, 0) for name in names}))


def _replace(old: dict[str, tuple[tuple[str, ...], str]], new: dict[str, tuple[tuple[str, ...], str]]) -> None:
    for name in old:
        op.drop_index(name, "jobs")
    is_sqlite = op.get_bind().dialect.name == "sqlite"
    for name, (columns, condition) in new.items():
        if condition:
            text = condition.replace("planned = false", "planned = 0" if is_sqlite else "NOT planned")
            op.create_index(name, "jobs", list(columns), sqlite_where=sa.text(text), postgresql_where=sa.text(text))
        else:
            op.create_index(name, "jobs", list(columns))
