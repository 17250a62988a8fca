"""/healthz, /readyz, /metrics, /v1/ops."""

from __future__ import annotations

from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from service.access.depends import Admin, Parts, Reader

router = APIRouter(tags=["ops"])


@dataclass(frozen=True)
class Health:
    status: str


@dataclass(frozen=True)
class Ready:
    status: str
    """"ok" or "unavailable"."""
    parts: dict[str, str]
    """Part -> "ok" or what is wrong."""


@router.get("/healthz")
def healthz() -> Health:
    """The process answers."""
    return Health("ok")


@router.get("/readyz", responses={503: {"model": Ready, "description": "A part does not work"}})
def readyz(response: Response, parts: Parts) -> Ready:
    """Every part works: store, blobs, pool."""
    found = parts.farm.ready()
    if all(word == "ok" for word in found.values()):
        return Ready("ok", found)
    response.status_code = HTTPStatus.SERVICE_UNAVAILABLE
    return Ready("unavailable", found)


@router.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
def metrics(parts: Parts, _caller: Reader) -> Response:
    """Prometheus metrics: sums over everyone, no one's data."""
    return Response(generate_latest(parts.registry), headers={"Content-Type": CONTENT_TYPE_LATEST})


@router.get("/v1/ops/snapshot")
def snapshot(parts: Parts, _caller: Admin) -> dict[str, Any]:
    """Queue, tasks, workers and throughput at this moment."""
    return parts.farm.snapshot()
