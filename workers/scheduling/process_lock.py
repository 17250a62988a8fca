"""Detects which dispatchers of this machine are alive, by a locked file per dispatcher.

The kernel releases the lock when the process ends for any reason, so that others take over the tasks of a killed one at
once and not only after its lease.
"""

from __future__ import annotations

import fcntl
import os
import socket
from pathlib import Path

from workers.ids import new_id


class ProcessLock:
    """The lock of one dispatcher process.

    Args:
        folder: of the lock files of all dispatchers of this home, on a local disk.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.id = f"{new_id('dsp_')}@{socket.gethostname()}"[:80]
        self._folder = folder
        self._place = folder / f"{self.id}.lock"
        born = folder / f"{self.id}.born"
        self._handle = os.open(born, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600)
        fcntl.flock(self._handle, fcntl.LOCK_EX)
        born.rename(self._place)  # other processes see the file only after it is locked

    def dead(self) -> list[str]:
        """Ids of dispatchers of this home that are dead and not yet forgotten."""
        return [file.stem for file in self._others() if _is_free(file)]

    def alone(self) -> bool:
        """Whether this home has no other live dispatcher."""
        return all(_is_free(file) for file in self._others())

    def _others(self) -> list[Path]:
        return [file for file in self._folder.glob("dsp_*.lock") if file != self._place]

    def forget(self, dead: list[str]) -> None:
        """Forget dispatchers whose tasks have been taken over."""
        for name in dead:
            (self._folder / f"{name}.lock").unlink(missing_ok=True)

    def end(self) -> None:
        self._place.unlink(missing_ok=True)
        os.close(self._handle)


def _is_free(file: Path) -> bool:
    try:
        handle = os.open(file, os.O_RDWR)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    finally:
        os.close(handle)
    return True
