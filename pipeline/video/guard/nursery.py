"""Our side: the nursery, and one child of it at work for us.

Importing the decoders takes half a second, forking a process that has them some milliseconds. The nursery is a process
of its own because ours has threads, which do not survive a fork. It ends when we do, and its children with it.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

import pipeline
from pipeline import errors
from pipeline.errors import ImpastoError, UnreadableMedia
from pipeline.video.guard.wire import Broken, Message, receive, send
from pipeline.video.media import unreadable

_ROOT = Path(pipeline.__file__).parent.parent
_ENTRY = """import sys
sys.path.insert(0, sys.argv[2])
from pipeline.video.guard.child import main
main(int(sys.argv[1]))"""
"""Our own code, wherever we were imported from."""
START_S = 60.0
ANSWER_S = 300.0
"""A child that says nothing for this long is killed. A damaged video may have to be decoded from its start."""
_KINDS = {
    kind.__name__: kind
    for kind in vars(errors).values()
    if isinstance(kind, type) and issubclass(kind, errors.BadInput)
}
"""What a child may say is wrong."""


class Died(UnreadableMedia):
    """A child has died: of its file, or because somebody killed it."""


class NotStarted(ImpastoError):
    """No child has come up, which no file is at fault for."""


class _Nursery:
    """One a process: started at first use, again if it has died or if we are a fork."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._pid = 0
        self._control: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None

    def get_ready(self) -> None:
        """Start it, unless it is there: its imports take a while, and others may take theirs meanwhile."""
        with self._lock:
            self._open()

    def child(self, *fds: int) -> None:
        """Fork a child that has these open files. Raises OSError."""
        with self._lock:
            try:
                socket.send_fds(self._open(), [b"!"], fds)
            except OSError:  # it has died since: another one
                self._control = None
                socket.send_fds(self._open(), [b"!"], fds)

    def end(self) -> None:
        """Kill it: it starts nobody. The next child has another one."""
        with self._lock:
            if self._control is not None and self._process is not None and self._pid == os.getpid():
                self._process.kill()
                self._process.wait()
                self._control.close()
            self._control = None

    def _open(self) -> socket.socket:
        if self._control is None or self._pid != os.getpid():
            ours, theirs = socket.socketpair()
            command = [sys.executable, "-c", _ENTRY, str(theirs.fileno()), str(_ROOT)]
            with theirs:
                self._process = subprocess.Popen(  # noqa: S603  (our own module, a fixed command)
                    command,
                    pass_fds=[theirs.fileno()],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    start_new_session=True,
                )
            self._control, self._pid = ours, os.getpid()
        return self._control


_NURSERY = _Nursery()


def get_ready() -> None:
    """Start the nursery of this process in the background: the first file waits less."""
    _NURSERY.get_ready()


class Child:
    """A child at work: asked, answered, killed if it does not. Not thread-safe. Close it.

    Args:
        role: a name of `roles.ROLES`.
        task: what it is to begin with.
        shared_bytes: size of the memory that it leaves arrays in.
        memory_bytes: what it may allocate.
        told: gets what it says before it has begun.

    Raises: what `ask` does.
    """

    def __init__(
        self,
        role: str,
        task: Message,
        shared_bytes: int,
        timeout_s: float = ANSWER_S,
        memory_bytes: int = 4 << 30,
        told: Callable[[Message], None] = lambda news: None,
    ) -> None:
        self._wire, theirs = socket.socketpair()
        self._wire.settimeout(START_S)
        self._timeout_s = timeout_s
        self._pid = 0
        with theirs, _shared_file(shared_bytes) as file:
            self._memory = mmap.mmap(file.fileno(), shared_bytes)
            _NURSERY.child(theirs.fileno(), file.fileno())
        try:
            self._pid = self._greet(
                {"role": role, "memory": memory_bytes, "shared": shared_bytes, "seconds": timeout_s}
            )
            self._wire.settimeout(timeout_s)
            self.began = self.ask(task, told)
        except BaseException:
            self.close()
            raise

    def _greet(self, message: Message) -> int:
        """Its process id. Raises NotStarted."""
        try:
            send(self._wire, message)
            return int(receive(self._wire)[0]["pid"])
        except (Broken, OSError, KeyError) as error:
            remedy = "See whether the machine lacks memory or processes."
            raise NotStarted(f"No decoder could be started: {error}.", remedy=remedy) from error

    def ask(self, message: Message, told: Callable[[Message], None] = lambda news: None) -> tuple[Message, bytes]:
        """Its answer; `told` gets what it says before.

        Raises: BadInput of every kind (as the child raised it), OSError, UnreadableMedia (it died, or was too slow).
        """
        try:
            send(self._wire, message)
            while True:
                answer, data = receive(self._wire)
                if "news" not in answer:
                    break
                told(answer)
        except TimeoutError:
            self.close()
            remedy = "Re-encode it as H.264 in MP4."
            unreadable("The file takes too long to decode.", f"{self._timeout_s:g} s", remedy)
        except (Broken, ConnectionError):
            self.close()
            remedy = "Re-encode it as H.264 in MP4."
            said = "The file crashes the decoder, or needs too much memory."
            raise Died(said, field="file", remedy=remedy) from None
        if "error" in answer:
            _raise(answer["error"])
        return answer, data

    def array(self, shape: tuple[int, ...], dtype: str) -> NDArray[Any]:
        """A copy of the array that it has left in the shared memory. Raises UnreadableMedia if there is no room."""
        kind = np.dtype(dtype)
        if kind.hasobject or int(np.prod(shape, dtype=np.int64)) * kind.itemsize > len(self._memory):
            unreadable("The decoder's answer makes no sense.", f"{shape} {dtype}")
        found = np.frombuffer(self._memory, kind, int(np.prod(shape))).reshape(shape)
        return found.copy()

    @property
    def alive(self) -> bool:
        """Whether it can be asked: neither dead nor given up."""
        return self._wire.fileno() >= 0

    def close(self) -> None:
        """Kill it, whatever it does."""
        if self._wire.fileno() < 0:
            return
        if self._pid and not _has_closed(self._wire):  # its end is open: the number is still its own
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._pid, signal.SIGKILL)
        self._wire.close()
        with contextlib.suppress(BufferError):
            self._memory.close()


def begin(
    role: str,
    task: Message,
    shared_bytes: int,
    timeout_s: float = ANSWER_S,
    told: Callable[[Message], None] = lambda news: None,
) -> Child:
    """A child that has begun. One that dies may have been killed, for no fault of its file: a second one decides."""
    try:
        return Child(role, task, shared_bytes, timeout_s, told=told)
    except (Died, NotStarted) as error:
        if isinstance(error, NotStarted):
            _NURSERY.end()
        return Child(role, task, shared_bytes, timeout_s, told=told)


def _has_closed(wire: socket.socket) -> bool:
    wire.settimeout(0)
    try:
        return wire.recv(1, socket.MSG_PEEK) == b""
    except (BlockingIOError, TimeoutError):
        return False
    except OSError:
        return True


def _shared_file(size: int) -> Any:
    """A file of `size` bytes in memory only, none of which is there before it is written."""
    linux = hasattr(os, "memfd_create")
    file: Any = os.fdopen(os.memfd_create("impasto"), "r+b") if linux else tempfile.TemporaryFile()  # noqa: SIM115
    os.ftruncate(file.fileno(), size)
    return file


def _raise(error: Message) -> NoReturn:
    """Raise what the child has raised, if it is of a kind that it may raise."""
    kind = _KINDS.get(str(error.get("kind")))
    if kind is not None:
        fields = {name: error.get(name) or "" for name in ("field", "remedy")}
        raise kind(str(error.get("message")), value=error.get("value"), **fields)
    if isinstance(error.get("errno"), int):
        raise OSError(error["errno"], str(error.get("message")))
    raise ImpastoError(str(error.get("message")))
