"""The folder that `impasto render` works in: one a command line, so that the same command resumes its own work.

The folder holds a farm's database and blobs. It is locked while a render uses it, removed when the result is
delivered, and left behind by Ctrl-C, a failure or a power cut: the same command then resumes there.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from workers.errors import Conflict
from workers.model import Json

KEPT_S = 30 * 24 * 3600.0
"""An interrupted render that was not resumed for this long is deleted, seconds."""


def key_of(facts: Json) -> str:
    """A short name for a command: equal facts (inputs by their SHA-256, parameters, output, ...) give equal names."""
    text = json.dumps(facts, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


@dataclass(frozen=True)
class Workspace:
    """A locked folder of one command."""

    folder: Path

    @property
    def consented(self) -> bool:
        """Whether this command, in this run or an interrupted one, may replace its outputs."""
        return self._marker.exists()

    def consent(self) -> None:
        """Remember that existing outputs may be replaced."""
        self._marker.touch()

    @property
    def _marker(self) -> Path:
        return self.folder / "overwrite"


@contextmanager
def workspace(home: Path, key: str) -> Iterator[Workspace]:
    """The folder for `key` under `home`/renders, locked. Raises Conflict if another process uses it."""
    folder = home / "renders" / key
    folder.mkdir(parents=True, exist_ok=True)
    with _locked(folder) as lock:
        if lock is None:
            raise Conflict(
                "The same render is running in another process.",
                field="home",
                value=folder,
                remedy="Wait for it, stop it, or use another --home.",
            )
        folder.touch()
        yield Workspace(folder)


def forget(folder: Path) -> None:
    """Remove the folder of a render."""
    shutil.rmtree(folder, ignore_errors=True)


def sweep(home: Path, kept_s: float = KEPT_S) -> None:
    """Remove renders that were interrupted more than `kept_s` seconds ago and never resumed."""
    for folder in (home / "renders").glob("*"):
        if folder.is_dir() and time.time() - folder.stat().st_mtime > kept_s:
            with _locked(folder) as lock:
                if lock is not None:
                    forget(folder)


@contextmanager
def _locked(folder: Path) -> Iterator[IO[bytes] | None]:
    """An exclusive lock that ends with the process; None if another process holds it."""
    with (folder / "lock").open("ab") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield None
        else:
            yield file
