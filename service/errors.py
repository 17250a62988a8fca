"""Conversion of exceptions to problem documents (RFC 9457).

ImpastoError
└── RequestError                errors of the HTTP request itself
    ├── BadRequest 400          ├── MethodNotAllowed 405     ├── RangeNotSatisfiable 416
    │   └── BadJson 400         ├── RequestTimeout 408       ├── Locked 423
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
from workers.errors import NotFound
from workers.live.worker import NoLiveWorker
from workers.model import Json
from workers.projects.faults import BadProject
from workers.projects.model import VersionMismatch

log = logging.getLogger(__name__)

PROBLEM_TYPE = "application/problem+json"
SECURITY_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class RequestError(ImpastoError):
    """An error of the request. `headers` are added to the answer."""

    code = "bad-request"

    def __init__(self, message: str, *, headers: Mapping[str, str] | None = None, **parts: Any) -> None:
        super().__init__(message, **parts)
        self.headers = dict(headers or {})


class BadRequest(RequestError):
    code = "bad-request"


class BadJson(BadRequest):
    code = "bad-json"


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
    "bad-request": (400, "The request cannot be understood"),
    "bad-json": (400, "The body is not JSON"),
    "bad-message": (400, "The message cannot be understood"),
    "unauthorized": (401, "A key is needed"),
    "forbidden": (403, "Not allowed"),
    "dismissed": (403, "An operator has ended it"),
    "not-found": (404, "There is no such thing"),
    "method-not-allowed": (405, "This address does not do that"),
    "request-timeout": (408, "The request took too long to arrive"),
    "hello-timeout": (408, "The first message did not come"),
    "idle": (408, "No frames came"),
    "slow-reader": (408, "Answers were not read"),
    "taken-over": (409, "Another connection has taken the session up"),
    "conflict": (409, "Not possible in this state"),
    "overtaken": (409, "A later request has replaced this one"),
    "cancelled": (409, "It was cancelled"),
    "offset-mismatch": (409, "The upload stands elsewhere"),
    "gone": (410, "It is no longer there"),
    "wrong-version": (412, "Another protocol version is spoken here"),
    "version-mismatch": (412, "Something newer is stored"),
    "body-too-large": (413, "The body is too large"),
    "too-large": (413, "The message is too large"),
    "media-too-large": (413, "The media are too large"),
    "unsupported-media-type": (415, "This type of body is not taken here"),
    "range-not-satisfiable": (416, "The range lies outside the file"),
    "bad-input": (422, "The input is wrong"),
    "bad-parameter": (422, "A parameter is wrong"),
    "bad-project": (422, "The project is wrong"),
    "bad-patch": (422, "The patch does not fit"),
    "bad-media": (422, "The media are wrong"),
    "unreadable-media": (422, "The media cannot be read"),
    "damaged-media": (422, "Frames of the file are missing or unreadable"),
    "no-video-stream": (422, "There is no video in it"),
    "bad-frame": (422, "A frame is wrong"),
    "idempotency-mismatch": (422, "The idempotency key was used for another request"),
    "locked": (423, "Another request is at work on it"),
    "precondition-required": (428, "A change needs the version that it was made on"),
    "quota-exceeded": (429, "A quota is used up"),
    "rate-limited": (429, "Too many requests"),
    "checksum-mismatch": (460, "The checksum does not match"),
    "internal-error": (500, "Something went wrong inside"),
    "claim-failed": (500, "A task could not be claimed"),
    "bad-plan": (500, "The method planned what cannot be run"),
    "bad-emission": (500, "The method made frames that it had not announced"),
    "not-installed": (501, "An optional part is not installed"),
    "busy": (503, "Busy"),
    "going-away": (503, "The service stops"),
    "worker-lost": (503, "The worker died"),
    "no-room": (503, "No machine has what this needs"),
    "worker-died": (500, "A worker process has ended"),
    "device-error": (503, "No compute device works"),
    "damaged-storage": (500, "Stored bytes are damaged"),
    "resources-exhausted": (503, "The machine has no resources left"),
    "storage-unavailable": (503, "Storage cannot be reached"),
    "storage-full": (507, "Storage is full"),
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
        return [ProblemPlace(**vars(fault)) for fault in error.errors]
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
    app.add_exception_handler(Exception, _on_surprise)


def _on_impasto(request: Request, error: Exception) -> Response:
    assert isinstance(error, ImpastoError)
    status, _ = TABLE.get(error.code, TABLE["internal-error"])
    if status == HTTPStatus.INTERNAL_SERVER_ERROR:
        return _on_surprise(request, error)
    if status > HTTPStatus.INTERNAL_SERVER_ERROR:
        log.warning("%s %s: %s", request.method, request.url.path, error)
    return respond(error, request.url.path)


def _on_validation(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    return respond(from_validation(error), request.url.path)


def from_validation(error: RequestValidationError) -> ImpastoError:
    """The errors of a validation: the first one, which contains the others."""
    return together([_from_detail(found) for found in error.errors()])


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
        return NotFound(
            "There is no such address.", field="path", value=request.url.path, remedy="See /docs for all addresses."
        )
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


def _on_surprise(request: Request, error: Exception) -> Response:
    log.error("%s %s failed", request.method, request.url.path, exc_info=error)
    unknown = ImpastoError(
        "The service failed to answer this request.",
        remedy="Try again; if it fails again, report the time and address to the operator.",
    )
    return respond(unknown, request.url.path)
