"""All errors that Impasto raises on purpose: the classes of `impasto_client.errors`, where their tree is.

The client has them, so that `except BadParameter` is the same in process and over HTTP.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

from impasto_client.errors import (
    BadFrame,
    BadInput,
    BadMedia,
    BadParameter,
    Cancelled,
    DamagedMedia,
    DeviceError,
    ImpastoError,
    MediaTooLarge,
    NotASequence,
    NoVideoStream,
    StorageError,
    StorageFull,
    UnreadableMedia,
)

__all__ = [
    "BadFrame",
    "BadInput",
    "BadMedia",
    "BadParameter",
    "Cancelled",
    "DamagedMedia",
    "DeviceError",
    "ImpastoError",
    "MediaTooLarge",
    "NoVideoStream",
    "NotASequence",
    "StorageError",
    "StorageFull",
    "UnreadableMedia",
    "did_you_mean",
    "together",
]


def together(errors: Sequence[ImpastoError]) -> ImpastoError:
    """Combine one or more errors of a request: returns the first, with the rest in its `others`."""
    first, *rest = errors
    first.others += tuple(other for error in rest for other in (error, *error.others))
    return first


def did_you_mean(name: str, known: Iterable[str], what: str) -> str:
    """Remedy text for an unknown name: suggests the most similar known name, if any, and lists all known names.

    Args:
        what: plural noun for the named things, for example "parameters".
    """
    names = list(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    guess = f"Did you mean {close[0]!r}? " if close else ""
    return f"{guess}Known {what}: {', '.join(names) or 'none'}."
