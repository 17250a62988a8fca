"""Validation of file names. They are for display only; invalid ones are refused, not changed."""

from __future__ import annotations

from pipeline.errors import BadParameter
from pipeline.video.names import unusable

MAX_CHARS = 255


def check_filename(name: str) -> str:
    """Return `name` if it is one plain file name, or raise BadParameter."""
    bad = not name.strip() or name in (".", "..") or len(name) > MAX_CHARS
    if bad or unusable(name):
        raise BadParameter(
            "The file name is not valid.",
            field="filename",
            value=name.encode("utf-8", "replace").decode(),
            remedy=f"Give a name of 1 to {MAX_CHARS} characters without / and \\ and control characters: clip.mp4.",
        )
    return name
