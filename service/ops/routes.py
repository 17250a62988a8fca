"""/healthz, /readyz, /metrics, /v1/ops."""

from __future__ import annotations

from dataclasses import dataclass
from http import HTTPStatus

from fastapi import Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from service.access.admission import Cost, costs
from service.context.depends import Admin, Context, Reader
from service.routing import Router
from service.schemas import Cursor
from workers.contract.request import Json
from workers.operator_views import Violation

router = Router(tags=["ops"])


@dataclass(frozen=True)
class Health:
    status: str


@dataclass(frozen=True)
class Ready:
    status: str
    """"ok" or "unavailable"."""
    parts: dict[str, str]
    """Component -> "ok" or its error."""


@router.get("/healthz")
async def healthz() -> Health:
    """Liveness: the process answers."""
    return Health("ok")


@router.get("/readyz", responses={503: {"model": Ready, "description": "A part does not work"}})
@costs(Cost.HEALTH)
def readyz(response: Response, context: Context) -> Ready:
    """Readiness: database, blob store and pool work."""
    found = context.farm.ready()
    if all(word == "ok" for word in found.values()):
        return Ready("ok", found)
    response.status_code = HTTPStatus.SERVICE_UNAVAILABLE
    return Ready("unavailable", found)


@router.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
@costs(Cost.HEALTH)
def metrics(context: Context, _caller: Reader) -> Response:
    """Prometheus metrics: totals over all owners, without user data."""
    return Response(generate_latest(context.registry), headers={"Content-Type": CONTENT_TYPE_LATEST})


@dataclass(frozen=True)
class CheckOut:
    """Violated invariants of the database."""

    violations: tuple[Violation, ...]


@router.get("/v1/ops/check")
@costs(Cost.HEAVY)
def check(context: Context, _caller: Admin) -> CheckOut:
    """Check the database's invariants: read-only and bounded."""
    return CheckOut(tuple(context.farm.validate_state()))


@dataclass(frozen=True)
class BlobsCheckOut:
    """Damaged or missing bytes of assets; `cursor` continues, and is null at the end."""

    violations: tuple[Violation, ...]
    cursor: str | None


@router.get("/v1/ops/check/blobs")
def check_blobs(context: Context, _caller: Admin, cursor: Cursor = None) -> BlobsCheckOut:
    """Read the stored bytes of assets and compare them with their hashes, about 1 GiB a request."""
    found, left = context.farm.assets.damage(cursor)
    return BlobsCheckOut(tuple(found), left)


@router.get("/v1/ops/snapshot")
def snapshot(context: Context, _caller: Admin) -> Json:
    """Current state of queue, tasks, workers and throughput."""
    return context.farm.snapshot()
