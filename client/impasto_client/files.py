"""Local files of uploads: their asset ids, and what is called while bytes move."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

from impasto_client.errors import BadInput

SMALL_BYTES = 8 << 20
"""Larger files go by resumable upload."""
Progress = Callable[[int, int], None]
"""Called with the number of bytes done and the total. An exception that it raises ends the transfer."""


def quiet(done: int, total: int) -> None:
    """Progress callback that does nothing."""


def asset_id_of(path: Path) -> str:
    """The id of the asset that this file is: `ast_` and the SHA-256 of its bytes in hex."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return f"ast_{digest.hexdigest()}"


def existing(path: str | Path) -> Path:
    """Raises: BadInput (no such file)."""
    file = Path(path)
    if not file.is_file():
        raise BadInput("File not found.", field="path", value=file, remedy="Check the path.")
    return file
