"""Projects: documents with all their versions, the assets that they name, the jobs made of them."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "projects",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("owner", sa.String(length=80), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("updated_at", sa.Double(), nullable=False),
        sa.Column("deleted_at", sa.Double(), nullable=True),
        sa.Column("share_epoch", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_projects")),
    )
    op.create_index(op.f("ix_projects_owner_updated_at_id"), "projects", ["owner", "updated_at", "id"])
    op.create_index(op.f("ix_projects_updated_at_id"), "projects", ["updated_at", "id"])
    op.create_table(
        "project_versions",
        _project_id(),
        sa.Column("version", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("at", sa.Double(), nullable=False),
        sa.Column("author", sa.String(length=80), nullable=False),
        sa.Column("label", sa.Text(), nullable=False),
        sa.Column("size_bytes", sa.Integer(), nullable=False),
        sa.Column("body", sa.LargeBinary(), nullable=False),
        sa.Column("thinned", sa.Boolean(), nullable=False),
        *_keys("project_versions", "version"),
    )
    op.create_index(
        op.f("ix_project_versions_at"), "project_versions", ["at"],
        postgresql_where=sa.text("NOT thinned"), sqlite_where=sa.text("thinned = 0"),
    )  # fmt: skip
    op.create_table(
        "project_assets",
        _project_id(),
        sa.Column("asset_id", sa.String(length=80), nullable=False),
        *_keys("project_assets", "asset_id"),
    )
    op.create_index(op.f("ix_project_assets_asset_id"), "project_assets", ["asset_id"])
    op.create_table(
        "project_jobs",
        _project_id(),
        sa.Column("job_id", sa.String(length=40), nullable=False),
        sa.Column("shot", sa.String(length=40), nullable=False),
        sa.Column("variant", sa.String(length=40), nullable=True),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column("at", sa.Double(), nullable=False),
        *_keys("project_jobs", "job_id"),
    )


def _project_id() -> sa.Column[str]:
    return sa.Column("project_id", sa.String(length=40), nullable=False)


def _keys(table: str, second: str) -> tuple[sa.ForeignKeyConstraint, sa.PrimaryKeyConstraint]:
    owner = sa.ForeignKeyConstraint(
        ["project_id"], ["projects.id"], name=op.f(f"fk_{table}_project_id"), ondelete="CASCADE"
    )
    return owner, sa.PrimaryKeyConstraint("project_id", second, name=op.f(f"pk_{table}"))


def downgrade() -> None:
    for table in ("project_jobs", "project_assets", "project_versions", "projects"):
        op.drop_table(table)
