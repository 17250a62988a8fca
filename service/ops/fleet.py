"""/v1/ops: queue, workers, machines, failures, timelines and live sessions, for admin keys."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import Path, Query
from pydantic import BaseModel, ConfigDict, Field

from service.context.depends import Admin, Context
from service.routing import Router
from service.schemas import ID, Cursor, JobId, Limit, Listing
from workers.operator_views import (
    AttemptLogView,
    Drain,
    DrainScope,
    Failure,
    LiveView,
    NodeView,
    TimelineBar,
    WorkerView,
)

router = Router(prefix="/v1/ops", tags=["ops"])

NAME = r"^[A-Za-z0-9][A-Za-z0-9_.:@-]{0,119}$"
WorkerId = Annotated[str, Path(pattern=NAME, description="A worker's id (`dsp_...`).")]
NodeName = Annotated[str, Path(pattern=NAME, description="A machine's name.")]
AttemptId = Annotated[str, Path(pattern=ID, description="An attempt's id (`att_...`).")]
SessionId = Annotated[str, Path(pattern=ID, description="A live session's id (`liv_...`).")]
OfJob = Annotated[str | None, Query(pattern=ID, description="Of this job only.")]
Bars = Annotated[int, Query(ge=1, le=2000, description="Items a page at most.")]


class ReasonIn(BaseModel):
    """Reason, shown to other operators."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    reason: str = Field(default="", max_length=300)


@dataclass(frozen=True)
class QueueOut:
    """State of the queue."""

    paused: bool
    drain: Drain | None
    """The pause of the queue: operator, time and reason; null while it is not paused."""


@router.get("/queue")
def get_queue(context: Context, _caller: Admin) -> QueueOut:
    """Whether the queue is paused, and by whom."""
    found = next((drain for drain in context.farm.workers.drains() if drain.place is DrainScope.QUEUE), None)
    return QueueOut(found is not None, found)


@router.post("/queue/pause")
def pause_queue(context: Context, caller: Admin, body: ReasonIn | None = None) -> QueueOut:
    """Pause the queue: no further task starts, running tasks finish, new jobs are accepted and wait."""
    context.farm.workers.drain(DrainScope.QUEUE, "", caller.user, _reason(body))
    return get_queue(context, caller)


@router.post("/queue/resume")
def resume_queue(context: Context, caller: Admin) -> QueueOut:
    """Resume the queue. Idempotent."""
    context.farm.workers.resume(DrainScope.QUEUE)
    return get_queue(context, caller)


@router.get("/workers")
def list_workers(context: Context, _caller: Admin, cursor: Cursor = None, limit: Limit = 50) -> Listing[WorkerView]:
    """Processes that run tasks, oldest first, each with its slots and running tasks."""
    page = context.farm.workers.workers(cursor, limit)
    return Listing(page.items, page.cursor)


@router.post("/workers/{worker_id}/drain")
def drain_worker(worker_id: WorkerId, context: Context, caller: Admin, body: ReasonIn | None = None) -> Drain:
    """Drain a worker: no further task starts there, running tasks finish. Idempotent."""
    return context.farm.workers.drain(DrainScope.WORKER, worker_id, caller.user, _reason(body))


@router.post("/workers/{worker_id}/resume", status_code=204)
def resume_worker(worker_id: WorkerId, context: Context, _caller: Admin) -> None:
    """Resume a drained worker. Idempotent."""
    context.farm.workers.resume(DrainScope.WORKER, worker_id)


@router.get("/nodes")
def list_nodes(context: Context, _caller: Admin) -> Listing[NodeView]:
    """Machines that run tasks, drained ones included."""
    return Listing(tuple(context.farm.workers.nodes()), None)


@router.post("/nodes/{node}/drain")
def drain_node(node: NodeName, context: Context, caller: Admin, body: ReasonIn | None = None) -> Drain:
    """Drain a machine: no further task starts there until it is resumed, also after a restart."""
    return context.farm.workers.drain(DrainScope.NODE, node, caller.user, _reason(body))


@router.post("/nodes/{node}/resume", status_code=204)
def resume_node(node: NodeName, context: Context, _caller: Admin) -> None:
    """Resume a drained machine. Idempotent."""
    context.farm.workers.resume(DrainScope.NODE, node)


@router.get("/failures")
def list_failures(
    context: Context, _caller: Admin, job_id: OfJob = None, cursor: Cursor = None, limit: Limit = 50
) -> Listing[Failure]:
    """Failed and interrupted attempts of all owners' jobs, newest first."""
    page = context.farm.workers.failures(job_id, cursor, limit)
    return Listing(page.items, page.cursor)


@router.get("/attempts/{attempt_id}/log")
def get_attempt_log(attempt_id: AttemptId, context: Context, _caller: Admin) -> AttemptLogView:
    """The log of an attempt."""
    return context.farm.workers.attempt_log(attempt_id)


@router.get("/jobs/{job_id}/timeline")
def get_timeline(
    job_id: JobId, context: Context, _caller: Admin, cursor: Cursor = None, limit: Bars = 500
) -> Listing[TimelineBar]:
    """Every attempt of the job: place, start, end and outcome; newest first."""
    page = context.farm.workers.timeline(job_id, cursor, limit)
    return Listing(page.items, page.cursor)


@router.get("/live")
def list_live(context: Context, _caller: Admin, cursor: Cursor = None, limit: Limit = 50) -> Listing[LiveView]:
    """Live sessions of all processes, oldest first. Figures are a few seconds old."""
    page = context.farm.workers.live(cursor, limit)
    return Listing(page.items, page.cursor)


@router.post("/live/{session_id}/end", status_code=202)
def end_live(session_id: SessionId, context: Context, _caller: Admin) -> None:
    """End a live session within seconds. Its connection is closed with the code `dismissed`."""
    context.farm.workers.end_live(session_id)


def _reason(body: ReasonIn | None) -> str:
    return "" if body is None else body.reason
