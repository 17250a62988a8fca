"""Programs that a test starts."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

END_S = 60
"""How long a program may take to end after SIGTERM."""


@contextmanager
def started(command: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """A program that has ended, killed if need be, when the block is left.

    `subprocess.Popen` as a context manager waits without limit for its program, also after the test has failed.
    Raises subprocess.TimeoutExpired if the program does not end by itself `END_S` seconds after SIGTERM.
    """
    process = subprocess.Popen(command, **options)
    try:
        yield process
        process.terminate()
        process.wait(END_S)
    finally:
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout, process.stderr):
            if pipe and not pipe.closed:
                pipe.close()
