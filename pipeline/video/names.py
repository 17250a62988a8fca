"""Which characters a file name may contain: all but control characters, separators and lone surrogates."""

from __future__ import annotations

import unicodedata


def unusable(name: str, separators: str = "/\\") -> str:
    """The first character of a name that cannot be stored or shown, or "". Spaces of all kinds, joined emoji and
    characters without width are part of names that people use."""
    return next((c for c in name if c in separators or unicodedata.category(c) in ("Cc", "Cs", "Zl", "Zp")), "")
