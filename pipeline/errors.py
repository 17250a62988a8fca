"""Every error Impasto raises on purpose.

    ImpastoError                    code, message, field, value, remedy
    ├── BadInput                    what the user gave is wrong: HTTP 4xx, exit status 2
    │   ├── BadParameter            a parameter is out of range, of the wrong type, or unknown
    │   ├── BadMedia                the bytes are not what they should be
    │   │   ├── UnreadableMedia     truncated, empty, renamed, of an unknown codec
    │   │   ├── NoVideoStream       a real container without pictures
    │   │   └── MediaTooLarge       more bytes, pixels or seconds than the limits allow
    │   └── BadFrame                an array is not a frame (shape, dtype, finite)
    ├── Cancelled                   the user asked to stop
    ├── DeviceError                 no compute device works, or one failed
    └── StorageError                blobs or the database cannot be reached or are full (workers raise these)
        └── StorageFull

A `code` is stable and shown by the API; the message names the field, the value and the remedy.
"""

from __future__ import annotations


class ImpastoError(Exception):
    """The root: a stable `code`, and a message that says what to do.

    Args:
        message: one sentence, for a person.
        field: the input, parameter or setting that is wrong, as the user wrote it (dotted path).
        value: what it was, shortened to 200 characters.
        remedy: one sentence: what to do instead.
    """

    code = "internal-error"

    def __init__(self, message: str, *, field: str = "", value: object = None, remedy: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.field = field
        self.value = None if value is None else str(value)[:200]
        self.remedy = remedy

    def __str__(self) -> str:
        parts = [self.message]
        if self.field:
            parts.append(f"(field: {self.field}" + (f", value: {self.value})" if self.value is not None else ")"))
        if self.remedy:
            parts.append(self.remedy)
        return " ".join(parts)

    def __reduce__(self) -> tuple[object, ...]:
        """Keep field, value and remedy across process borders."""
        return _rebuild, (type(self), self.message, self.field, self.value, self.remedy)


def _rebuild(kind: type[ImpastoError], message: str, field: str, value: object, remedy: str) -> ImpastoError:
    return kind(message, field=field, value=value, remedy=remedy)


class BadInput(ImpastoError):
    code = "bad-input"


class BadParameter(BadInput):
    code = "bad-parameter"


class BadMedia(BadInput):
    code = "bad-media"


class UnreadableMedia(BadMedia):
    code = "unreadable-media"


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
