"""/v1/ops: workers, machines, the queue, failures, timelines and live sessions, for holders of an admin key."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Path, Query
from pydantic import BaseModel, ConfigDict, Field

from service.access.depends import Admin, Parts
from service.schemas import ID, Cursor, JobId, Limit, Listing
from workers.fleet import AttemptLogView, Bar, Drain, Failure, LiveView, NodeView, Place, WorkerView

router = APIRouter(prefix="/v1/ops", tags=["ops"])

NAME = r"^[A-Za-z0-9][A-Za-z0-9_.:@-]{0,119}$"
WorkerId = Annotated[str, Path(pattern=NAME, description="A worker's id (`dsp_...`).")]
NodeName = Annotated[str, Path(pattern=NAME, description="A machine's name.")]
AttemptId = Annotated[str, Path(pattern=ID, description="An attempt's id (`att_...`).")]
SessionId = Annotated[str, Path(pattern=ID, description="A live session's id (`liv_...`).")]
OfJob = Annotated[str | None, Query(pattern=ID, description="Of this job only.")]
Bars = Annotated[int, Query(ge=1, le=2000, description="Items a page at most.")]


class ReasonIn(BaseModel):
    """Why, for the other operators."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    reason: str = Field(default="", max_length=300)


@dataclass(frozen=True)
class QueueOut:
    """Whether tasks are handed out."""

    paused: bool
    drain: Drain | None
    """Who has paused it, when and why; null while it is not paused."""


@router.get("/queue")
def get_queue(parts: Parts, _caller: Admin) -> QueueOut:
    """Whether tasks are handed out, and if not, who wanted that."""
    found = next((drain for drain in parts.farm.fleet.drains() if drain.place is Place.QUEUE), None)
    return QueueOut(found is not None, found)


@router.post("/queue/pause")
def pause_queue(parts: Parts, caller: Admin, body: ReasonIn | None = None) -> QueueOut:
    """Hand out no task, to nobody; those at work are finished. Jobs are accepted, and wait."""
    parts.farm.fleet.drain(Place.QUEUE, "", caller.owner, _reason(body))
    return get_queue(parts, caller)


@router.post("/queue/resume")
def resume_queue(parts: Parts, caller: Admin) -> QueueOut:
    """Hand out tasks again. Twice is the same as once."""
    parts.farm.fleet.resume(Place.QUEUE)
    return get_queue(parts, caller)


@router.get("/workers")
def list_workers(parts: Parts, _caller: Admin, cursor: Cursor = None, limit: Limit = 50) -> Listing[WorkerView]:
    """Processes that take tasks, the longest alive first, each with its slots and what they run."""
    page = parts.farm.fleet.workers(cursor, limit)
    return Listing(page.items, page.cursor)


@router.post("/workers/{worker_id}/drain")
def drain_worker(worker_id: WorkerId, parts: Parts, caller: Admin, body: ReasonIn | None = None) -> Drain:
    """Give this worker nothing new; what it runs is finished. Twice is the same as once."""
    return parts.farm.fleet.drain(Place.WORKER, worker_id, caller.owner, _reason(body))


@router.post("/workers/{worker_id}/resume", status_code=204)
def resume_worker(worker_id: WorkerId, parts: Parts, _caller: Admin) -> None:
    """Give this worker tasks again. Twice is the same as once."""
    parts.farm.fleet.resume(Place.WORKER, worker_id)


@router.get("/nodes")
def list_nodes(parts: Parts, _caller: Admin) -> Listing[NodeView]:
    """Machines where tasks run, or would if they were not drained."""
    return Listing(tuple(parts.farm.fleet.nodes()), None)


@router.post("/nodes/{node}/drain")
def drain_node(node: NodeName, parts: Parts, caller: Admin, body: ReasonIn | None = None) -> Drain:
    """Start nothing new on this machine, whoever's slots are there, until it is resumed: a restart does not end it."""
    return parts.farm.fleet.drain(Place.NODE, node, caller.owner, _reason(body))


@router.post("/nodes/{node}/resume", status_code=204)
def resume_node(node: NodeName, parts: Parts, _caller: Admin) -> None:
    """Use this machine again. Twice is the same as once."""
    parts.farm.fleet.resume(Place.NODE, node)


@router.get("/failures")
def list_failures(
    parts: Parts, _caller: Admin, job_id: OfJob = None, cursor: Cursor = None, limit: Limit = 50
) -> Listing[Failure]:
    """Attempts that failed or were cut off, of everyone's jobs, newest first."""
    page = parts.farm.fleet.failures(job_id, cursor, limit)
    return Listing(page.items, page.cursor)


@router.get("/attempts/{attempt_id}/log")
def get_attempt_log(attempt_id: AttemptId, parts: Parts, _caller: Admin) -> AttemptLogView:
    """What one attempt said."""
    return parts.farm.fleet.attempt_log(attempt_id)


@router.get("/jobs/{job_id}/timeline")
def get_timeline(job_id: JobId, parts: Parts, _caller: Admin, cursor: Cursor = None, limit: Bars = 500) -> Listing[Bar]:
    """Every attempt of the job: where it ran, from when to when, and how it ended; the latest begun first."""
    page = parts.farm.fleet.timeline(job_id, cursor, limit)
    return Listing(page.items, page.cursor)


@router.get("/live")
def list_live(parts: Parts, _caller: Admin, cursor: Cursor = None, limit: Limit = 50) -> Listing[LiveView]:
    """Live sessions of every process, oldest first, with figures that are a few seconds old."""
    page = parts.farm.fleet.live(cursor, limit)
    return Listing(page.items, page.cursor)


@router.post("/live/{session_id}/end", status_code=202)
def end_live(session_id: SessionId, parts: Parts, _caller: Admin) -> None:
    """End a live session within seconds: its client is told."""
    parts.farm.fleet.end_live(session_id)


def _reason(body: ReasonIn | None) -> str:
    return "" if body is None else body.reason
