"""Close codes of live connections, and the errors that they represent."""

from __future__ import annotations

import logging

from pipeline.errors import BadFrame, BadInput, ImpastoError
from workers.errors import NotFound
from workers.live.worker import NoLiveWorker

log = logging.getLogger(__name__)

NORMAL, GOING_AWAY, INTERNAL, BUSY = 1000, 1001, 1011, 1013
_CODES = {
    "going-away": GOING_AWAY,
    "bad-message": 4400,
    "hello-timeout": 4408,
    "dismissed": 4403,
    "taken-over": 4409,
    "idle": 4410,
    "too-large": 4413,
    "rate-limited": 4429,
    "slow-reader": 4430,
}
BAD_MESSAGE, NOT_FOUND, BAD_FRAME = 4400, 4404, 4415


class Ending(ImpastoError):
    """The service ends a connection. `code` is also the close reason."""

    def __init__(self, code: str, message: str, **parts: object) -> None:
        super().__init__(message, **parts)  # type: ignore[arg-type]
        self.code = code


class Lost(Exception):
    """The connection was lost."""


class Left(Exception):
    """The client has closed the connection."""


def close_code(error: ImpastoError) -> int:
    """The WebSocket close code of an error."""
    if error.code in _CODES:
        return _CODES[error.code]
    if isinstance(error, NoLiveWorker):
        return BUSY
    if isinstance(error, NotFound):
        return NOT_FOUND
    if isinstance(error, BadFrame):
        return BAD_FRAME
    return BAD_MESSAGE if isinstance(error, BadInput) else INTERNAL


def shown(error: BaseException) -> ImpastoError:
    """The error as clients see it: details of internal errors are only logged."""
    if isinstance(error, ImpastoError) and close_code(error) != INTERNAL:
        return error
    log.error("a live session failed", exc_info=error)
    return ImpastoError("The service failed at this session.", remedy="Connect again.")
