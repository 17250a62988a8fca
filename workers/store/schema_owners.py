"""Tables of who uses the service and what that has cost: owners, keys, the audit trail, costs and retention."""

from __future__ import annotations

from sqlalchemy import JSON, BigInteger, Boolean, Column, Double, ForeignKey, Index, String, Table, Text, false

from workers.store.schema_base import metadata

owners = Table(
    "owners",
    metadata,
    Column("id", String(80), primary_key=True),
    Column("name", Text, nullable=False),
    Column("quotas", JSON, nullable=False),
    Column("created_at", Double, nullable=False),
    Column("kind", String(8), nullable=False, default="user", server_default="user"),
    Column("subject", String(500)),
    Column("disabled_at", Double),
    Index(None, "subject", unique=True),
)

members = Table(
    "members",
    metadata,
    Column("group_id", String(80), ForeignKey("owners.id", ondelete="CASCADE"), primary_key=True),
    Column("user_id", String(80), ForeignKey("owners.id", ondelete="CASCADE"), primary_key=True),
    Column("role", String(8), nullable=False),
    Index(None, "user_id"),
)

audit = Table(
    "audit",
    metadata,
    Column("id", String(40), primary_key=True),
    Column("at", Double, nullable=False),
    Column("user", String(80), nullable=False),
    Column("key", String(40), nullable=False),
    Column("owner", String(80), nullable=False),
    Column("action", String(80), nullable=False),
    Column("object", Text, nullable=False),
    Column("address", String(80), nullable=False),
    Index(None, "user", "id"),
)

job_costs = Table(
    "job_costs",
    metadata,
    Column("job_id", String(40), primary_key=True),
    Column("owner", String(80), nullable=False),
    Column("labels", JSON, nullable=False),
    Column("ended_at", Double, nullable=False),
    Column("cpu_s", Double, nullable=False),
    Column("busy_s", Double, nullable=False),
    Column("bytes", BigInteger),
    Index(None, "ended_at"),
)

retention_rules = Table(
    "retention_rules",
    metadata,
    Column("id", String(40), primary_key=True),
    Column("days", Double, nullable=False),
    Column("owner", String(80)),
    Column("label", String(80)),
    Column("value", String(255)),
    Column("created_at", Double, nullable=False),
)

api_keys = Table(
    "api_keys",
    metadata,
    Column("id", String(40), primary_key=True),
    Column("owner", String(80)),
    Column("name", Text, nullable=False),
    Column("hash", String(64), nullable=False),
    Column("scopes", JSON, nullable=False),
    Column("quotas", JSON, nullable=False),
    Column("created_at", Double, nullable=False),
    Column("revoked_at", Double),
    Column("expires_at", Double),
    Column("used_at", Double),
    Column("session", Boolean, nullable=False, default=False, server_default=false()),
    Index(None, "owner"),
)
