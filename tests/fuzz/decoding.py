"""Decoding of many malformed files in one child process, which can be killed: a case costs no fork.

The child has the limits of the service's decoder processes (`pipeline.video.guard`): memory, descriptors, no written
file. If it dies, the case is run once more in a decoder process of the service, which must refuse the file.
"""

from __future__ import annotations

import multiprocessing
import resource
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

import cv2
import psutil

from tests.fuzz import media

CASES_AT_ONCE = 1000
"""Number of cases after which a child is replaced."""
MEMORY_BYTES = 4 << 30
OPEN_FILES = 64


class DecodingChild:
    """Decodes in a child process, which is started when needed. Close it."""

    def __init__(self) -> None:
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        self._cases = 0

    def outcome(self, case: media.Case, folder: Path) -> str:
        """Outcomes of `media.outcome`, and "contained: ..." if the decoder crashes and the service refuses the file."""
        path = folder / "upload"
        path.write_bytes(case.data())
        pipe = self._open()
        self._cases += 1
        pipe.send((case.kind, str(path)))
        if not pipe.poll(media.SLOW_S):
            self.close()
            return f"fault: no answer within {media.SLOW_S:g} s"
        try:
            return str(pipe.recv())
        except EOFError:
            self.close()
            again = media.outcome(case, folder)
            return again if again.startswith("fault") else f"contained: the decoder died; the service: {again}"

    def close(self) -> None:
        """Kill the child."""
        if self._process is not None and self._pipe is not None:
            self._process.kill()
            self._process.join()
            self._pipe.close()
        self._process = self._pipe = None

    def _open(self) -> Connection:
        if self._pipe is None or self._cases >= CASES_AT_ONCE:
            self.close()
            context = multiprocessing.get_context("fork")
            self._pipe, theirs = context.Pipe()
            self._process, self._cases = context.Process(target=_serve, args=(theirs,), daemon=True), 0
            self._process.start()
            theirs.close()
        return self._pipe


def _serve(pipe: Connection) -> None:
    """Main function of the child."""
    memory_bytes = psutil.Process().memory_info().vms + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_NOFILE, (OPEN_FILES, OPEN_FILES))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    while True:
        kind, name = pipe.recv()
        path = Path(name)
        try:
            pipe.send(media.run(kind, path, path.read_bytes(), media.DIRECT))
        except (MemoryError, cv2.error):  # the service refuses these: `pipeline.video.guard.roles`
            pipe.send("refused: The file crashes the decoder, or needs too much memory.")
        except Exception as error:
            pipe.send(media.fault(error))
