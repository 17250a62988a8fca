"""`impasto render` starts the decoder server and reads the video's thumbnails while its imports keep one processor busy
for half a second."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.video.guard.decoder_server import start_decoder_server

if TYPE_CHECKING:
    from pipeline.video.guard.ahead import ThumbnailsAhead

_BEFORE_FILES = ("-o", "--output", "--home", "-i", "--input", "--artefact", "--output-artefact")
"""Options whose value may be a file, but not the video."""

_begun: ThumbnailsAhead | None = None


def begin(arguments: Sequence[str]) -> None:
    """Start the decoder server, and read the video's thumbnails, which most methods need first.

    Args:
        arguments: those of `impasto render`. Whatever file is taken for the video here, only speed depends on it.
    """
    global _begun
    start_decoder_server()
    values = zip(["", *arguments], arguments, strict=False)
    files = [Path(value) for option, value in values if option not in _BEFORE_FILES and Path(value).is_file()]
    if files and "--estimate" not in arguments:
        from pipeline.video.guard.ahead import ThumbnailsAhead

        _begun = ThumbnailsAhead(files[0])


def thumbnails_of(path: Path) -> ThumbnailsAhead | None:
    """The thumbnails of this file, if they were begun. Those of another file are no longer read."""
    if _begun is None or _begun.reads(path):
        return _begun
    _begun.close()
    return None
