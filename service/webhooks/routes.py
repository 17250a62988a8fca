"""What a receiver needs to verify webhooks, and what became of those of a job."""

from __future__ import annotations

from dataclasses import dataclass

from fastapi import APIRouter

from service.access.depends import Parts, Reader, Submitter
from service.jobs.lookup import find_job
from service.schemas import JobId, Listing
from workers.farm import Delivery

router = APIRouter(prefix="/v1", tags=["webhooks"])


@dataclass(frozen=True)
class SecretOut:
    secret: str
    """As Standard Webhooks libraries take it: `whsec_...`."""


@router.get("/webhooks/secret")
def get_webhook_secret(parts: Parts, caller: Submitter) -> SecretOut:
    """The secret that your webhooks are signed with (Standard Webhooks 1.0.0)."""
    return SecretOut(parts.webhook_secrets.of(caller.owner))


@router.get("/jobs/{job_id}/webhooks")
def list_webhooks(job_id: JobId, parts: Parts, caller: Reader) -> Listing[Delivery]:
    """The job's messages: tried how often, delivered or not, and the last error."""
    find_job(parts, caller, job_id)
    return Listing(tuple(parts.farm.webhooks.of_job(job_id)), None)
