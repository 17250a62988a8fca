"""Problem documents (RFC 9457) of the service as exceptions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from impasto_client.errors import BY_CODE, Conflict, ImpastoError, JobFailed, NotAllowed, NotFound, QuotaExceeded

if TYPE_CHECKING:
    import httpx

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


def _other(fault: dict[str, Any]) -> ImpastoError:
    kind = BY_CODE.get(str(fault.get("code")), ImpastoError)
    message, remedy = str(fault.get("message", "")), str(fault.get("remedy", ""))
    error = kind(message, field=str(fault.get("field", "")), value=fault.get("value"), remedy=remedy)
    error.code = str(fault.get("code") or error.code)
    return error


def job_failed(job: Mapping[str, Any]) -> JobFailed:
    """The exception for a job that ended without a result."""
    fault = job.get("error") or {}
    message = fault.get("message") or f"The job was {job['state']}."
    error = JobFailed(message, field=fault.get("field", ""), value=fault.get("value"), remedy=fault.get("remedy", ""))
    error.code = fault.get("code") or ("cancelled" if job["state"] == "cancelled" else error.code)
    error.job = job
    return error


def _problem(response: httpx.Response) -> dict[str, Any]:
    try:
        found = response.json()
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
