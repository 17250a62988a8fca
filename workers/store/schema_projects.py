"""Tables of projects: their versions, comments, and the assets and jobs that belong to them."""

from __future__ import annotations

from sqlalchemy import BigInteger, Boolean, Column, Double, ForeignKey, Index, Integer, LargeBinary, String, Table, Text

from workers.store.schema_base import metadata, rows_where


def _project_id() -> Column[str]:
    owner = ForeignKey("projects.id", ondelete="CASCADE")
    return Column("project_id", String(40), owner, nullable=False, primary_key=True)


projects = Table(
    "projects",
    metadata,
    Column("id", String(40), primary_key=True),
    Column("owner", String(80), nullable=False),
    Column("name", Text, nullable=False),
    Column("version", Integer, nullable=False),
    Column("created_at", Double, nullable=False),
    Column("updated_at", Double, nullable=False),
    Column("deleted_at", Double),
    Column("share_epoch", Integer, nullable=False),
    Column("stored_bytes", BigInteger, nullable=False, server_default="0"),
    Index(None, "owner", "updated_at", "id"),
    Index(None, "updated_at", "id"),
)

project_versions = Table(
    "project_versions",
    metadata,
    _project_id(),
    Column("version", Integer, primary_key=True, autoincrement=False),
    Column("at", Double, nullable=False),
    Column("author", String(80), nullable=False),
    Column("label", Text, nullable=False),
    Column("size_bytes", Integer, nullable=False),
    Column("body", LargeBinary, nullable=False),
    Column("thinned", Boolean, nullable=False),
    Index(None, "at", **rows_where("NOT thinned", "thinned = 0")),
)

project_assets = Table(
    "project_assets",
    metadata,
    _project_id(),
    Column("asset_id", String(80), primary_key=True),
    Index(None, "asset_id"),
)

project_jobs = Table(
    "project_jobs",
    metadata,
    _project_id(),
    Column("job_id", String(40), primary_key=True),
    Column("shot", String(40), nullable=False),
    Column("variant", String(40)),
    Column("version", Integer, nullable=False),
    Column("at", Double, nullable=False),
)

project_comments = Table(
    "project_comments",
    metadata,
    _project_id(),
    Column("id", String(40), primary_key=True),
    Column("shot", String(80), nullable=False),
    Column("frame", Integer, nullable=False),
    Column("author", String(80), nullable=False),
    Column("by_link", Boolean, nullable=False),
    Column("text", Text, nullable=False),
    Column("at", Double, nullable=False),
)
