"""Where `impasto render` works: one folder a command line, so that the same command finds what it had begun.

The folder holds a farm's database and blobs. It is locked while a render is at work in it, removed when the result is
delivered, and left behind by Ctrl-C, a failure or a power cut: the same command then goes on from there.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from workers.errors import Conflict

KEPT_S = 30 * 24 * 3600.0
"""An interrupted render that nobody took up again for this long is forgotten."""


def key_of(facts: dict[str, Any]) -> str:
    """A short name for a command: equal facts (inputs by their SHA-256, parameters, output, ...), equal name."""
    text = json.dumps(facts, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


@contextmanager
def place(home: Path, key: str) -> Iterator[Path]:
    """The folder for `key` under `home`/renders, locked. Raises Conflict if another process is at work in it."""
    folder = home / "renders" / key
    folder.mkdir(parents=True, exist_ok=True)
    with _locked(folder) as lock:
        if lock is None:
            raise Conflict(
                "This very render is at work in another process.",
                field="home",
                value=folder,
                remedy="Wait for it, stop it, or give --home for a second one.",
            )
        folder.touch()
        yield folder


def forget(folder: Path) -> None:
    """Remove a render's folder: its result is delivered."""
    shutil.rmtree(folder, ignore_errors=True)


def sweep(home: Path, kept_s: float = KEPT_S) -> None:
    """Forget renders that were interrupted long ago and never taken up again."""
    for folder in (home / "renders").glob("*"):
        if folder.is_dir() and time.time() - folder.stat().st_mtime > kept_s:
            with _locked(folder) as lock:
                if lock is not None:
                    forget(folder)


@contextmanager
def _locked(folder: Path) -> Iterator[IO[bytes] | None]:
    """An exclusive lock that dies with the process, or None if somebody has it."""
    with (folder / "lock").open("ab") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield None
        else:
            yield file
