"""Ids: a prefix, then 26 characters that sort by creation time (48 bits of milliseconds, 80 random bits).

Within a process they rise strictly, so that the order of two jobs of the same millisecond is the order of submission.
"""

from __future__ import annotations

import secrets
import threading
import time

_ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"
"""Crockford's base 32: no i, l, o, u."""
_RANDOM_BITS = 80
_lock = threading.Lock()
_last = 0


def new_id(prefix: str) -> str:
    """`prefix` + 26 characters, greater than every id made before in this process."""
    global _last
    drawn = (int(time.time() * 1000) << _RANDOM_BITS) | secrets.randbits(_RANDOM_BITS)
    with _lock:
        _last = drawn = max(drawn, _last + 1)
    return prefix + "".join(_ALPHABET[(drawn >> shift) & 31] for shift in range(125, -5, -5))
