"""Errors of the client, on the tree of `pipeline.errors`.

ImpastoError
├── ServiceUnreachable          no service answers at that address
├── NotAllowed                  no key, a wrong key, or one without that right   401, 403
└── JobFailed                   the job ended without a result; `job` is its last state

Every other problem document becomes the class with its `code`, so that `except BadParameter` works over HTTP as well.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pipeline.errors import (
    BadFrame,
    BadInput,
    BadMedia,
    BadParameter,
    Cancelled,
    DamagedMedia,
    DeviceError,
    ImpastoError,
    MediaTooLarge,
    NoVideoStream,
    StorageError,
    StorageFull,
    UnreadableMedia,
)
from workers.contract.request import Json
from workers.errors import Conflict, IdempotencyMismatch, NotFound, QuotaExceeded

if TYPE_CHECKING:
    import httpx


class ServiceUnreachable(ImpastoError):
    code = "service-unreachable"


class NotAllowed(ImpastoError):
    code = "not-allowed"


class JobFailed(ImpastoError):
    """A job failed or was cancelled. `job`: its last state; `log`: the logs of its failed tasks."""

    code = "job-failed"

    def __init__(self, message: str, *, field: str = "", value: object = None, remedy: str = "") -> None:
        super().__init__(message, field=field, value=value, remedy=remedy)
        self.job: Json = {}
        self.log = ""


SHARED = (
    *(BadInput, BadParameter, BadMedia, UnreadableMedia, DamagedMedia, NoVideoStream, MediaTooLarge, BadFrame),
    *(Cancelled, DeviceError, StorageError, StorageFull),
    *(NotFound, Conflict, IdempotencyMismatch, QuotaExceeded),
)
"""Classes shared with local rendering: the same codes mean the same over HTTP."""
BY_CODE: dict[str, type[ImpastoError]] = {kind.code: kind for kind in SHARED}
BY_STATUS: dict[int, type[ImpastoError]] = {
    401: NotAllowed,
    403: NotAllowed,
    404: NotFound,
    409: Conflict,
    429: QuotaExceeded,
}
"""Error classes by HTTP status. Used for codes without a class, and for answers without a code (of a proxy)."""


def error_of(response: httpx.Response) -> ImpastoError:
    """The problem document of a 4xx or 5xx answer as an exception with code, field, value and remedy."""
    problem = _problem(response)
    code = str(problem.get("code") or "")
    kind = BY_CODE.get(code) or BY_STATUS.get(response.status_code, ImpastoError)
    error = kind(
        str(problem.get("detail") or problem.get("title") or f"The service answered {response.status_code}."),
        field=str(problem.get("field") or ""),
        value=problem.get("value"),
        remedy=str(problem.get("remedy") or ""),
    )
    error.code = code or error.code
    error.others = tuple(_other(fault) for fault in (problem.get("errors") or [])[1:])
    return error


def _other(fault: Json) -> ImpastoError:
    kind = BY_CODE.get(str(fault.get("code")), ImpastoError)
    message, remedy = str(fault.get("message", "")), str(fault.get("remedy", ""))
    error = kind(message, field=str(fault.get("field", "")), value=fault.get("value"), remedy=remedy)
    error.code = str(fault.get("code") or error.code)
    return error


def job_failed(job: Json) -> JobFailed:
    """The exception for a job that ended without a result."""
    fault = job.get("error") or {}
    message = fault.get("message") or f"The job was {job['state']}."
    error = JobFailed(message, field=fault.get("field", ""), value=fault.get("value"), remedy=fault.get("remedy", ""))
    error.code = fault.get("code") or ("cancelled" if job["state"] == "cancelled" else error.code)
    error.job = job
    return error


def _problem(response: httpx.Response) -> Json:
    try:
        found = response.json()
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
