"""Comments on frames of projects."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "project_comments",
        sa.Column(
            "project_id", sa.String(40), sa.ForeignKey("projects.id", ondelete="CASCADE"),
            nullable=False, primary_key=True,
        ),
        sa.Column("id", sa.String(40), primary_key=True),
        sa.Column("shot", sa.String(80), nullable=False),
        sa.Column("frame", sa.Integer(), nullable=False),
        sa.Column("author", sa.String(80), nullable=False),
        sa.Column("by_link", sa.Boolean(), nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.Column("at", sa.Double(), nullable=False),
    )  # fmt: skip


def downgrade() -> None:
    op.drop_table("project_comments")
