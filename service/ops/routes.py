"""/healthz, /readyz, /v1/ops."""

from __future__ import annotations

from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

from fastapi import APIRouter, Response

from service.access.depends import Admin, Parts

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


@router.get("/v1/ops/snapshot")
def snapshot(parts: Parts, _caller: Admin) -> dict[str, Any]:
    """Queue, tasks, workers and throughput at this moment."""
    return parts.farm.snapshot()
