"""The signing secret of webhooks, and the deliveries of a job."""

from __future__ import annotations

from dataclasses import dataclass

from service.context.depends import Context, Reader, Submitter
from service.jobs.lookup import find_job
from service.routing import Router
from service.schemas import JobId, Listing
from workers.contract.record import Delivery

router = Router(prefix="/v1", tags=["webhooks"])


@dataclass(frozen=True)
class SecretOut:
    secret: str
    """The secret in the format of Standard Webhooks libraries: `whsec_...`."""


@router.get("/webhooks/secret")
def get_webhook_secret(context: Context, caller: Submitter) -> SecretOut:
    """The secret that your webhooks are signed with (Standard Webhooks 1.0.0)."""
    return SecretOut(context.webhook_secrets.of(caller.owner))


@router.get("/jobs/{job_id}/webhooks")
def list_webhooks(job_id: JobId, context: Context, caller: Reader) -> Listing[Delivery]:
    """The job's messages: number of attempts, whether delivered, last error."""
    find_job(context, caller, job_id)
    return Listing(tuple(context.farm.webhooks.of_job(job_id)), None)
