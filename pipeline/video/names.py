"""Which characters a file name may contain: all but control characters, separators, lone surrogates, and overrides of
the direction of text."""

from __future__ import annotations

import unicodedata

_OVERRIDES = "\u202d\u202e"
"""They show a name in another order than that of its characters, so that a program looks like a picture."""


def unusable(name: str, separators: str = "/\\") -> str:
    """The first character of a name that cannot be stored or shown, or "". Spaces of all kinds, joined emoji and
    characters without width are part of names that people use."""
    refused = separators + _OVERRIDES
    return next((c for c in name if c in refused or unicodedata.category(c) in ("Cc", "Cs", "Zl", "Zp")), "")
