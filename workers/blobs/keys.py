"""The format of blob keys, and the error for a missing blob: the same for every blob store."""

from __future__ import annotations

import re

from pipeline.errors import BadInput

_PART = re.compile(r"[A-Za-z0-9._-]{1,200}")


class NoBlob(KeyError):
    """No blob is stored under a key."""


def check_key(key: str) -> str:
    """Return `key` if it is valid, else raise `BadInput` (a traversal, an empty part, an invalid character)."""
    parts = key.split("/")
    if len(key) <= 900 and all(_PART.fullmatch(part) and part not in (".", "..") for part in parts):
        return key
    raise BadInput(
        "A blob key is made of parts of [A-Za-z0-9._-], joined by slashes, none of them '.' or '..'.",
        field="key",
        value=key,
    )
