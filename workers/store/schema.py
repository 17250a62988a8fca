"""The tables; those of owners and projects come from `schema_owners` and `schema_projects`.

Portable SQL only: SQLite and PostgreSQL run the same statements.

    assets --< asset_owners
    jobs --< job_inputs, job_labels, files, events, deliveries
         --< steps --< tasks --< attempts
                       tasks --< task_edges (which task waits for which)
    owners (users and groups) --< api_keys (jobs, asset_owners, projects, deliveries name the owner only)
           --< members (which user is in which group)
    audit (who did what), job_costs (of every job that has ended, also of deleted ones)
    retention_rules (which jobs are deleted by age)
    dispatchers (live workers) --< slots (where they run attempts)
    drains (places where nothing new may start)
    live_sessions (of every process, a few seconds old)
    shares (slot time that every owner has used), tallies (jobs and tasks by state)
    projects --< project_versions, project_assets (named by any version), project_jobs, project_comments

A job of a project has `jobs.base_id`: the earlier job whose results it may use, or empty if there is none. Traces of
tasks (their recorded reads) are kept for such jobs only.

`jobs.versions` are the versions of its steps, null if a program before versions has planned it; `planned_by` is the
version of the program. See `workers.jobs.plan_versions`.

Counts of tasks by state are kept in `steps`, updated in the transaction that moves a task, so that neither claiming
nor showing a job counts rows; `jobs.ready` repeats the current step's if the job may start tasks now, so that an index
contains only the jobs from which a claim may choose. `tallies` counts jobs and tasks by state over all jobs, in several
rows, so that transactions seldom wait for each other; their sums are the counts. Every write to a job locks its row
first, so that writes are serialised; rows of `shares` and `tallies` are locked after all jobs of a transaction, in that
order. Times are seconds since the epoch, by the server's clock where there is one.
"""

from __future__ import annotations

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    Double,
    ForeignKey,
    Index,
    Integer,
    String,
    Table,
    Text,
    UniqueConstraint,
    false,
)

from workers.contract.record import RunState, TaskState
from workers.store.schema_base import metadata as metadata
from workers.store.schema_base import rows_where
from workers.store.schema_owners import api_keys as api_keys
from workers.store.schema_owners import audit as audit
from workers.store.schema_owners import job_costs as job_costs
from workers.store.schema_owners import members as members
from workers.store.schema_owners import owners as owners
from workers.store.schema_owners import retention_rules as retention_rules
from workers.store.schema_projects import project_assets as project_assets
from workers.store.schema_projects import project_comments as project_comments
from workers.store.schema_projects import project_jobs as project_jobs
from workers.store.schema_projects import project_versions as project_versions
from workers.store.schema_projects import projects as projects

ACTIVE_TEXT = "state IN ('queued', 'running')"
"""SQL condition for jobs that are planned and run, used by partial indexes and their queries."""
UNFINISHED_TEXT = "state IN ('queued', 'running', 'paused')"


def _job_id(primary_key: bool = False) -> Column[str]:
    owner = ForeignKey("jobs.id", ondelete="CASCADE")
    return Column("job_id", String(40), owner, nullable=False, primary_key=primary_key)


assets = Table(
    "assets",
    metadata,
    Column("id", String(80), primary_key=True),
    Column("sha256", String(64), nullable=False),
    Column("size_bytes", BigInteger, nullable=False),
    Column("filename", Text, nullable=False),
    Column("media_type", String(120), nullable=False),
    Column("kind", String(20), nullable=False),
    Column("info", JSON, nullable=False),
    Column("created_at", Double, nullable=False),
    Column("owner", String(80), nullable=False),
    Index(None, "created_at", "id"),
)

asset_owners = Table(
    "asset_owners",
    metadata,
    Column("owner", String(80), primary_key=True),
    Column("asset_id", String(80), ForeignKey("assets.id", ondelete="CASCADE"), primary_key=True),
    Column("filename", Text, nullable=False),
    Column("created_at", Double, nullable=False),
    Index(None, "asset_id"),
    Index(None, "owner", "created_at"),
)

jobs = Table(
    "jobs",
    metadata,
    Column("id", String(40), primary_key=True),
    Column("owner", String(80), nullable=False),
    Column("method", String(80), nullable=False),
    Column("state", String(12), nullable=False),
    Column("priority", Integer, nullable=False),
    Column("request", JSON, nullable=False),
    Column("params", JSON, nullable=False),
    Column("step", Integer, nullable=False),
    Column("step_count", Integer, nullable=False),
    Column("planned", Boolean, nullable=False),
    Column("doomed", Boolean, nullable=False),
    Column("ready", Integer, nullable=False, default=0, server_default="0"),
    Column("error", JSON(none_as_null=True)),
    Column("warnings", JSON(none_as_null=True)),
    Column("base_id", String(40)),
    Column("versions", JSON(none_as_null=True)),
    Column("planned_by", String(40), nullable=False, default="", server_default=""),
    Column("last_seq", BigInteger, nullable=False),
    Column("idempotency_key", String(255)),
    Column("digest", String(64), nullable=False),
    Column("created_at", Double, nullable=False),
    Column("updated_at", Double, nullable=False),
    Column("started_at", Double),
    Column("finished_at", Double),
    UniqueConstraint("owner", "idempotency_key"),
    Index(None, "state", "id"),
    Index(None, "owner", "id"),
    Index(None, "owner", "state", "id"),
    Index(None, "owner", "method", "id"),
    Index(None, "method", "id"),
    Index(None, "method", "state", "id"),
    # Few of all jobs are active, so these indexes stay small. Queries must repeat the conditions literally.
    Index("ix_jobs_ready", "priority", "owner", "id", **rows_where("ready > 0")),
    Index(
        "ix_jobs_unplanned",
        "priority",
        "owner",
        "id",
        **rows_where(f"NOT planned AND {ACTIVE_TEXT}", f"planned = 0 AND {ACTIVE_TEXT}"),
    ),
    Index("ix_jobs_active", "priority", "owner", "id", **rows_where(ACTIVE_TEXT)),
    Index("ix_jobs_unfinished", "owner", "id", **rows_where(UNFINISHED_TEXT)),
    Index("ix_jobs_unfinished_id", "id", **rows_where(UNFINISHED_TEXT)),
)

job_inputs = Table(
    "job_inputs",
    metadata,
    _job_id(primary_key=True),
    Column("name", String(80), primary_key=True),
    Column("asset_id", String(80), nullable=False),
    Index(None, "asset_id"),
)

job_labels = Table(
    "job_labels",
    metadata,
    _job_id(primary_key=True),
    Column("name", String(80), primary_key=True),
    Column("value", String(255), nullable=False),
    Index(None, "name", "value", "job_id"),
)

steps = Table(
    "steps",
    metadata,
    _job_id(primary_key=True),
    Column("step", Integer, primary_key=True),
    Column("name", String(80), nullable=False),
    Column("title", Text, nullable=False),
    Column("waiting", Integer, nullable=False, default=0),
    Column("ready", Integer, nullable=False, default=0),
    Column("running", Integer, nullable=False, default=0),
    Column("succeeded", Integer, nullable=False, default=0),
    Column("failed", Integer, nullable=False, default=0),
    Column("cancelled", Integer, nullable=False, default=0),
    Column("expected", Double, nullable=False, server_default="1"),
    Column("weight", Double, nullable=False, default=0.0),
    Column("weight_done", Double, nullable=False, default=0.0),
    Column("busy_s", Double, nullable=False, default=0.0),
    Column("stages", JSON, nullable=False, default=dict),
    Column("reused", Integer, nullable=False, default=0, server_default="0"),
    Column("pace_s", Double),
)

tasks = Table(
    "tasks",
    metadata,
    Column("id", String(40), primary_key=True),
    _job_id(),
    Column("step", Integer, nullable=False),
    Column("position", BigInteger, nullable=False),
    Column("key", String(200), nullable=False),
    Column("args", JSON, nullable=False),
    Column("emit_start", Integer),
    Column("emit_stop", Integer),
    Column("weight", Double, nullable=False),
    Column("chained", Boolean, nullable=False),
    Column("needs", JSON(none_as_null=True)),
    Column("state", String(12), nullable=False),
    Column("blockers", Integer, nullable=False),
    Column("failures", Integer, nullable=False, default=0),
    Column("interruptions", Integer, nullable=False, default=0),
    Column("ready_at", Double, nullable=False, default=0.0),
    Column("progress", Double, nullable=False, default=0.0),
    Column("attempt_id", String(40)),
    Column("note", JSON, key="result"),
    Column("artefacts", JSON),
    Column("segment", Text),
    Column("trace", JSON(none_as_null=True)),
    Column("reused", Boolean, nullable=False, default=False, server_default=false()),
    UniqueConstraint("job_id", "position"),
    Index(None, "job_id", "state", "position"),
)

task_edges = Table(
    "task_edges",
    metadata,
    Column("before_id", String(40), ForeignKey("tasks.id", ondelete="CASCADE"), primary_key=True),
    Column("task_id", String(40), ForeignKey("tasks.id", ondelete="CASCADE"), primary_key=True),
    Index(None, "task_id"),
)

attempts = Table(
    "attempts",
    metadata,
    Column("id", String(40), primary_key=True),
    Column("task_id", String(40), ForeignKey("tasks.id", ondelete="CASCADE"), nullable=False),
    _job_id(),
    Column("number", Integer, nullable=False),
    Column("dispatcher", String(80), nullable=False),
    Column("worker", String(120), nullable=False, default=""),
    Column("outcome", String(12), nullable=False),
    Column("started_at", Double, nullable=False),
    Column("finished_at", Double),
    Column("fault", JSON(none_as_null=True)),
    Column("log", Text, nullable=False, default=""),
    UniqueConstraint("task_id", "number"),
    Index(None, "outcome", "dispatcher"),
    Index(None, "outcome", "finished_at"),
    Index(None, "job_id", "finished_at"),
    Index(None, "job_id", "started_at"),
)

dispatchers = Table(
    "dispatchers",
    metadata,
    Column("id", String(80), primary_key=True),
    Column("started_at", Double, nullable=False),
    Column("lease_until", Double, nullable=False),
    Column("seen_at", Double, nullable=False, server_default="0"),
    Column("host", String(120), nullable=False, server_default=""),
    Column("role", String(12), nullable=False, server_default=""),
    Column("kind", String(12), nullable=False, server_default=""),
    Column("version", String(40), nullable=False, server_default=""),
)

slots = Table(
    "slots",
    metadata,
    Column("dispatcher", String(80), ForeignKey("dispatchers.id", ondelete="CASCADE"), primary_key=True),
    Column("name", String(120), primary_key=True),
    Column("node", String(120), nullable=False),
    Column("cpus", Double, nullable=False),
    Column("gpus", Double, nullable=False),
    Column("memory_bytes", BigInteger, nullable=False),
)

drains = Table(
    "drains",
    metadata,
    Column("place", String(12), primary_key=True),
    Column("name", String(120), primary_key=True),
    Column("at", Double, nullable=False),
    Column("by", String(80), nullable=False),
    Column("reason", Text, nullable=False),
)

shares = Table(
    "shares",
    metadata,
    Column("owner", String(80), primary_key=True),
    Column("used_s", Double, nullable=False),
    Column("floor_s", Double, nullable=False),
    Index(None, "floor_s"),
)

tallies = Table(
    "tallies",
    metadata,
    Column("shard", Integer, primary_key=True, autoincrement=False),
    *(Column(f"jobs_{state.value}", BigInteger, nullable=False, default=0) for state in RunState),
    *(Column(f"tasks_{state.value}", BigInteger, nullable=False, default=0) for state in TaskState),
    Column("startable", BigInteger, nullable=False, default=0),
)

live_sessions = Table(
    "live_sessions",
    metadata,
    Column("id", String(40), primary_key=True),
    Column("process", String(120), nullable=False),
    Column("owner", String(80), nullable=False),
    Column("method", String(80), nullable=False),
    Column("width", Integer, nullable=False),
    Column("height", Integer, nullable=False),
    Column("opened_at", Double, nullable=False),
    Column("connected", Boolean, nullable=False),
    Column("figures", JSON, nullable=False),
    Column("ending", Boolean, nullable=False),
    Column("seen_at", Double, nullable=False),
)

files = Table(
    "files",
    metadata,
    _job_id(primary_key=True),
    Column("name", String(200), primary_key=True),
    Column("key", Text, nullable=False),
    Column("media_type", String(120), nullable=False),
    Column("created_at", Double, nullable=False),
)

events = Table(
    "events",
    metadata,
    _job_id(primary_key=True),
    Column("seq", BigInteger, primary_key=True, autoincrement=False),
    Column("at", Double, nullable=False),
    Column("type", String(40), nullable=False),
    Column("data", JSON, nullable=False),
)

deliveries = Table(
    "deliveries",
    metadata,
    Column("id", String(40), primary_key=True),
    _job_id(),
    Column("owner", String(80), nullable=False),
    Column("url", Text, nullable=False),
    Column("body", JSON, nullable=False),
    Column("created_at", Double, nullable=False),
    Column("tries", Integer, nullable=False, default=0),
    Column("state", String(12), nullable=False),
    Column("next_at", Double),
    Column("last_error", Text, nullable=False, default=""),
    Index(None, "state", "next_at"),
    Index(None, "job_id"),
)
