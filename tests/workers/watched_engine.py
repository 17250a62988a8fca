"""A preview engine that tests watch. Actors import this module instead of a test file with all that this imports."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Generator
from pathlib import Path

from workers.blobs.disk import DiskBlobs
from workers.previews.engine import PreviewEngine
from workers.previews.memory import Check
from workers.previews.model import PreviewQuery, Record


class Watched(PreviewEngine):
    """A preview engine whose queries can stop it.

    It writes its process's id to a file that has the project's name. The option `waits_at` of a query names the record
    before which it waits for the file "go"; the option `deadly` makes it kill its process.
    """

    def __init__(self, blobs: DiskBlobs, notes: Path, limit_bytes: int) -> None:
        super().__init__(blobs, limit_bytes)
        self._notes = notes

    def run(self, query: PreviewQuery, check: Check) -> Generator[Record]:
        (self._notes / query.project).write_text(str(os.getpid()))
        if query.options.get("deadly"):
            os.kill(os.getpid(), signal.SIGKILL)
        for number, record in enumerate(super().run(query, check)):
            if number == query.options.get("waits_at"):
                (self._notes / "waits").write_text(str(os.getpid()))
                self._wait(check)
            yield record

    def _wait(self, check: Check) -> None:
        try:
            while not (self._notes / "go").exists():
                check()
                threading.Event().wait(0.01)
        except BaseException:
            (self._notes / "cancelled").touch()
            raise
