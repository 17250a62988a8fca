"""All errors that Impasto raises on purpose, in this process and over HTTP.

    ImpastoError                    code, message, field, value, remedy
    ├── BadInput                    the user's input is invalid: HTTP 4xx, exit status 2
    │   ├── BadParameter            a parameter is out of range, of the wrong type, or unknown
    │   ├── BadMedia                the bytes of a media file are invalid
    │   │   ├── UnreadableMedia     truncated, empty, wrong file extension, or unknown codec
    │   │   │   └── NotASequence    images that are not one numbered sequence without gaps
    │   │   ├── DamagedMedia        frames are missing or unreadable, and the job demands a failure then
    │   │   ├── NoVideoStream       a valid container without a video stream
    │   │   └── MediaTooLarge       more bytes, pixels or seconds than the limits allow
    │   └── BadFrame                an array is not a frame (wrong type, dtype, shape or size)
    ├── Cancelled                   the user asked to stop
    ├── DeviceError                 no compute device works, or the device failed during a task
    ├── StorageError                the blob store or the database is unreachable
    │   └── StorageFull
    ├── NotFound                    no such job, task, asset, result                                  404
    ├── Conflict                    not in this state                                                 409
    │   └── IdempotencyMismatch     the same key with another request                                 422
    ├── QuotaExceeded               a key's quota or rate is used up                                  429
    ├── ServiceUnreachable          no service answers at that address
    ├── NotAllowed                  no key, a wrong key, or one without that right                    401, 403
    └── JobFailed                   the job ended without a result; `job` is its last state

`code` is a stable identifier that the API returns; the message names the field, the value and the remedy. The server
raises the same classes: they are here because everyone who uses Impasto, in process or over HTTP, has this package.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_LONGEST_COLLECTION = 80
"""Maximum length, in characters, of a list or object that an error quotes in full."""


class ImpastoError(Exception):
    """Base class of all errors: a stable `code`, and a message with the remedy.

    Args:
        message: one sentence that describes the error to the user.
        field: the invalid input, parameter or setting, as the user wrote it (dotted path).
        value: the invalid value, shortened to 200 characters. Large lists, objects and byte strings are replaced by
            their size, since they may come from a private file.
        remedy: one sentence that tells the user how to correct the error.

    Attributes:
        others: further errors in the same request, so that the user can correct all of them at once.
    """

    code = "internal-error"

    def __init__(self, message: str, *, field: str = "", value: object = None, remedy: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.field = field
        self.value = None if value is None else _shown(value)
        self.remedy = remedy
        self.others: tuple[ImpastoError, ...] = ()

    def __str__(self) -> str:
        parts = [self.message]
        if self.field:
            parts.append(f"(field: {self.field}" + (f", value: {self.value})" if self.value is not None else ")"))
        if self.remedy:
            parts.append(self.remedy)
        return " ".join(parts)

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle all attributes, so that errors can cross process boundaries."""
        return _rebuild, (type(self), self.message, self.field, self.value, self.remedy, self.others)


def _rebuild(
    kind: type[ImpastoError], message: str, field: str, value: object, remedy: str, others: tuple[ImpastoError, ...]
) -> ImpastoError:
    error = kind(message, field=field, value=value, remedy=remedy)
    error.others = others
    return error


def _shown(value: object) -> str:
    text = str(value)
    if isinstance(value, bytes | bytearray):
        return f"{len(value)} bytes"
    if len(text) > _LONGEST_COLLECTION and isinstance(value, Mapping):
        return f"an object with {len(value)} fields"
    if len(text) > _LONGEST_COLLECTION and isinstance(value, list | tuple | set | frozenset):
        return f"a list of {len(value)} items"
    return text[:200]


class BadInput(ImpastoError):
    code = "bad-input"


class BadParameter(BadInput):
    code = "bad-parameter"


class BadMedia(BadInput):
    code = "bad-media"


class UnreadableMedia(BadMedia):
    code = "unreadable-media"


class NotASequence(UnreadableMedia):
    code = "not-a-sequence"


class DamagedMedia(BadMedia):
    code = "damaged-media"


class NoVideoStream(BadMedia):
    code = "no-video-stream"


class MediaTooLarge(BadMedia):
    code = "media-too-large"


class BadFrame(BadInput):
    code = "bad-frame"


class Cancelled(ImpastoError):
    code = "cancelled"


class DeviceError(ImpastoError):
    code = "device-error"


class StorageError(ImpastoError):
    code = "storage-unavailable"


class StorageFull(StorageError):
    code = "storage-full"


class NotFound(ImpastoError):
    code = "not-found"


class Conflict(ImpastoError):
    code = "conflict"


class IdempotencyMismatch(Conflict):
    code = "idempotency-mismatch"


class QuotaExceeded(ImpastoError):
    code = "quota-exceeded"


class ServiceUnreachable(ImpastoError):
    code = "service-unreachable"


class NotAllowed(ImpastoError):
    code = "not-allowed"


class JobFailed(ImpastoError):
    """A job failed or was cancelled. `job`: its last state; `log`: the logs of its failed tasks."""

    code = "job-failed"

    def __init__(self, message: str, *, field: str = "", value: object = None, remedy: str = "") -> None:
        super().__init__(message, field=field, value=value, remedy=remedy)
        self.job: Any = {}
        self.log = ""


OVER_HTTP = (
    *(BadInput, BadParameter, BadMedia, UnreadableMedia, NotASequence, DamagedMedia, NoVideoStream, MediaTooLarge),
    *(BadFrame, Cancelled, DeviceError, StorageError, StorageFull),
    *(NotFound, Conflict, IdempotencyMismatch, QuotaExceeded),
)
"""Classes whose codes mean the same in process and over HTTP."""
BY_CODE: dict[str, type[ImpastoError]] = {kind.code: kind for kind in OVER_HTTP}
