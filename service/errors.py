"""Conversion of exceptions to problem documents (RFC 9457).

ImpastoError
└── RequestError                errors of the HTTP request itself
    ├── BadRequest 400          ├── MethodNotAllowed 405     ├── RangeNotSatisfiable 416
    │                           ├── RequestTimeout 408       ├── Locked 423
    ├── Unauthorized 401        ├── OffsetMismatch 409       ├── RateLimited 429
    ├── Forbidden 403           ├── WrongVersion 412         ├── ChecksumMismatch 460
    ├── Gone 410                ├── UnsupportedMediaType 415 ├── Busy 503
    └── BodyTooLarge 413        └── PreconditionRequired 428 └── BadMessage 400 (live)
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import JSONResponse, Response

from pipeline.errors import BadParameter, ImpastoError, together
from workers.contract.project import VersionMismatch
from workers.contract.request import Json
from workers.errors import NotFound
from workers.live.worker import NoLiveWorker
from workers.projects.faults import BadProject
from workers.strict_json import BadJson

log = logging.getLogger(__name__)

PROBLEM_TYPE = "application/problem+json"
SECURITY_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}

MAX_PLACES = 100
"""Faults of a request or a document that an answer contains."""


class RequestError(ImpastoError):
    """An error of the request. `headers` are added to the answer."""

    code = "bad-request"

    def __init__(self, message: str, *, headers: Mapping[str, str] | None = None, **parts: Any) -> None:
        super().__init__(message, **parts)
        self.headers = dict(headers or {})


class BadRequest(RequestError):
    code = "bad-request"


class BadMessage(RequestError):
    """A message of a live session cannot be understood."""

    code = "bad-message"


class Unauthorized(RequestError):
    code = "unauthorized"


class Forbidden(RequestError):
    code = "forbidden"


class MethodNotAllowed(RequestError):
    code = "method-not-allowed"


class RequestTimeout(RequestError):
    code = "request-timeout"


class OffsetMismatch(RequestError):
    code = "offset-mismatch"


class Gone(RequestError):
    code = "gone"


class WrongVersion(RequestError):
    code = "wrong-version"


class NotInstalled(RequestError):
    """An optional part of Impasto is missing in this installation."""

    code = "not-installed"


class BodyTooLarge(RequestError):
    code = "body-too-large"


class PreconditionRequired(RequestError):
    code = "precondition-required"


class UnsupportedMediaType(RequestError):
    code = "unsupported-media-type"


class RangeNotSatisfiable(RequestError):
    code = "range-not-satisfiable"


class Locked(RequestError):
    code = "locked"


class ChecksumMismatch(RequestError):
    code = "checksum-mismatch"


class RateLimited(RequestError):
    code = "rate-limited"


class Busy(RequestError):
    code = "busy"


TABLE: dict[str, tuple[int, str]] = {
    "bad-request": (400, "Bad request"),
    "bad-json": (400, "Invalid JSON"),
    "bad-message": (400, "Invalid message"),
    "unauthorized": (401, "Authentication required"),
    "forbidden": (403, "Forbidden"),
    "dismissed": (403, "Session ended by an operator"),
    "not-found": (404, "Not found"),
    "method-not-allowed": (405, "Method not allowed"),
    "request-timeout": (408, "Request timeout"),
    "hello-timeout": (408, "No hello message in time"),
    "idle": (408, "No frames received in time"),
    "slow-reader": (408, "Client reads too slowly"),
    "taken-over": (409, "Session resumed by another connection"),
    "conflict": (409, "Not possible in the current state"),
    "overtaken": (409, "Replaced by a later request"),
    "cancelled": (409, "Cancelled"),
    "offset-mismatch": (409, "Upload offset does not match"),
    "gone": (410, "No longer available"),
    "wrong-version": (412, "Unsupported protocol version"),
    "version-mismatch": (412, "The resource has changed since you read it"),
    "body-too-large": (413, "Request body too large"),
    "too-large": (413, "Message too large"),
    "media-too-large": (413, "Media too large"),
    "unsupported-media-type": (415, "Unsupported media type"),
    "range-not-satisfiable": (416, "Range not satisfiable"),
    "bad-input": (422, "Invalid input"),
    "bad-parameter": (422, "Invalid parameter"),
    "bad-project": (422, "Invalid project"),
    "bad-patch": (422, "Patch does not apply"),
    "bad-media": (422, "Invalid media"),
    "unreadable-media": (422, "Media cannot be decoded"),
    "not-a-sequence": (422, "Not an image sequence"),
    "damaged-media": (422, "Frames are missing or cannot be decoded"),
    "no-video-stream": (422, "No video stream"),
    "bad-frame": (422, "Invalid frame"),
    "idempotency-mismatch": (422, "Idempotency key used with another request"),
    "locked": (423, "Locked by another request"),
    "precondition-required": (428, "If-Match header required"),
    "quota-exceeded": (429, "Quota exceeded"),
    "rate-limited": (429, "Too many requests"),
    "checksum-mismatch": (460, "Checksum mismatch"),
    "internal-error": (500, "Internal server error"),
    "claim-failed": (500, "Task could not be claimed"),
    "other-version": (503, "Planned by another version of the program"),
    "bad-plan": (500, "The method's plan is invalid"),
    "bad-emission": (500, "The method emitted frames outside its plan"),
    "not-installed": (501, "Optional dependency not installed"),
    "busy": (503, "Service busy"),
    "going-away": (503, "Service is shutting down"),
    "worker-lost": (503, "Worker lost"),
    "no-room": (503, "No machine has enough resources"),
    "worker-died": (500, "Worker process died"),
    "device-error": (503, "Compute device failed"),
    "damaged-storage": (500, "Stored bytes are damaged"),
    "resources-exhausted": (503, "The machine is out of resources"),
    "storage-unavailable": (503, "Storage unavailable"),
    "storage-full": (507, "Storage full"),
}
"""Code -> (status, title), for all codes of the error tree."""


class ProblemPlace(BaseModel):
    """One fault of a request or document. `path`: JSON Pointer (RFC 6901); `field`: the same place with dots."""

    path: str
    field: str
    code: str
    message: str
    value: str | None
    remedy: str


class Problem(BaseModel):
    """A problem (RFC 9457) with Impasto's stable code, the faulty field, its value, and the remedy."""

    type: str
    title: str
    status: int
    detail: str
    code: str
    field: str
    value: str | None
    remedy: str
    instance: str
    errors: list[ProblemPlace] | None = None
    """Every fault of the request or document, if it has several; absent otherwise."""


PROBLEM_RESPONSES: dict[int | str, Json] = {
    family: {
        "description": text,
        "content": {PROBLEM_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
    }
    for family, text in (("4XX", "The request is wrong"), ("5XX", "The service cannot do it now"))
}
"""For `APIRouter(responses=...)`: every route may answer with a problem."""


def problem(error: ImpastoError, instance: str) -> Problem:
    """The problem document of `error` at the path `instance`."""
    status, title = TABLE.get(error.code, TABLE["internal-error"])
    return Problem(
        type=f"urn:impasto:problem:{error.code}",
        title=title,
        status=status,
        detail=error.message,
        code=error.code,
        field=error.field,
        value=error.value,
        remedy=error.remedy,
        instance=instance,
        errors=_places(error),
    )


def _places(error: ImpastoError) -> list[ProblemPlace] | None:
    if isinstance(error, BadProject):
        return [ProblemPlace(**vars(fault)) for fault in error.errors[:MAX_PLACES]]
    return [_place(one) for one in (error, *error.others)] if error.others else None


def _place(error: ImpastoError) -> ProblemPlace:
    return ProblemPlace(
        path="/" + error.field.replace(".", "/"),
        field=error.field,
        code=error.code,
        message=error.message,
        value=error.value,
        remedy=error.remedy,
    )


def respond(error: ImpastoError, instance: str) -> Response:
    """The answer to a request that failed with `error`."""
    body = problem(error, instance)
    headers = SECURITY_HEADERS | {"Cache-Control": "no-store"} | _headers(error, body.status)
    left_out = None if body.errors else {"errors"}
    return JSONResponse(body.model_dump(exclude=left_out), body.status, headers, PROBLEM_TYPE)


def _headers(error: ImpastoError, status: int) -> dict[str, str]:
    own = dict(error.headers) if isinstance(error, RequestError) else {}
    if isinstance(error, NoLiveWorker):
        own |= retry_after(error.retry_after_s)
    if isinstance(error, VersionMismatch):
        own["ETag"] = f'"{error.stored}"'
    if status == HTTPStatus.UNAUTHORIZED:
        own.setdefault("WWW-Authenticate", "Bearer")
    if status in (429, 503):
        own.setdefault("Retry-After", "5")
    return own


def retry_after(seconds: float) -> dict[str, str]:
    """The `Retry-After` header: whole seconds, at least one."""
    return {"Retry-After": str(max(1, math.ceil(seconds)))}


def install(app: FastAPI) -> None:
    """Answer every exception in `app` with a problem document."""
    app.add_exception_handler(ImpastoError, _on_impasto)
    app.add_exception_handler(RequestValidationError, _on_validation)
    app.add_exception_handler(HTTPException, _on_http)
    app.add_exception_handler(ClientDisconnect, _on_disconnect)
    app.add_exception_handler(Exception, _on_unhandled_error)


def _on_impasto(request: Request, error: Exception) -> Response:
    assert isinstance(error, ImpastoError)
    status, _ = TABLE.get(error.code, TABLE["internal-error"])
    if status == HTTPStatus.INTERNAL_SERVER_ERROR:
        return _on_unhandled_error(request, error)
    if status > HTTPStatus.INTERNAL_SERVER_ERROR:
        log.warning("%s %s: %s", request.method, request.url.path, error)
    return respond(error, request.url.path)


def _on_validation(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    return respond(from_validation(error), request.url.path)


def from_validation(error: RequestValidationError) -> ImpastoError:
    """The errors of a validation: the first one, which contains the others, at most `MAX_PLACES`."""
    return together([_from_detail(found) for found in error.errors()[:MAX_PLACES]])


def _from_detail(found: Json) -> ImpastoError:
    where, *names = (str(part) for part in found["loc"])
    field = ".".join(names) or where
    if found["type"] == "json_invalid":
        return BadJson("The body is not JSON.", field="body", remedy=f"Correct it: {found['ctx']['error']}.")
    if found["type"] == "missing":
        return _validation(f"{field} is missing.", field, None, f"Add {field} ({where}).")
    if found["type"] == "extra_forbidden":
        return _validation(f"Unknown field {field!r}.", field, found["input"], "Remove it; see /docs for the fields.")
    return _validation(f"{field} is not valid.", field, found["input"], f"{found['msg']}.")


def _validation(message: str, field: str, value: object, remedy: str) -> ImpastoError:
    return BadParameter(message, field=field, value=value, remedy=remedy)


def _on_http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return respond(from_http(error, request), request.url.path)


def from_http(error: HTTPException, request: Request) -> ImpastoError:
    """An error of the framework (unknown route, wrong method) as an `ImpastoError`."""
    headers = dict(error.headers or {})
    if error.status_code == HTTPStatus.NOT_FOUND:
        return NotFound("Unknown path.", field="path", value=request.url.path, remedy="See /docs for all paths.")
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        return MethodNotAllowed(
            f"{request.method} is not allowed here.",
            headers=headers,
            field="method",
            value=request.method,
            remedy=f"Use {headers.get('Allow', 'another method')}.",
        )
    if error.status_code == HTTPStatus.REQUEST_ENTITY_TOO_LARGE:
        return BodyTooLarge(str(error.detail), field="body", remedy="Send less.")
    return BadRequest(str(error.detail), field="body", remedy="See /docs for the expected request.")


def _on_disconnect(_request: Request, _error: Exception) -> Response:
    return Response(status_code=400)  # the client has disconnected


def _on_unhandled_error(request: Request, error: Exception) -> Response:
    return respond(internal_error(f"{request.method} {request.url.path}", error), request.url.path)


def internal_error(what: str, error: Exception) -> ImpastoError:
    """Log an unexpected error; returns the error for the answer, which contains no details."""
    log.error("%s failed", what, exc_info=error)
    return ImpastoError(
        "The service failed to answer this request.",
        remedy="Try again; if it fails again, report the time and address to the operator.",
    )
