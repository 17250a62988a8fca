"""Decoder processes, which the decoder server forks: questions to them, and their answers."""

from __future__ import annotations

import contextlib
import logging
import mmap
import os
import signal
import socket
import tempfile
from collections.abc import Callable
from typing import Any, NoReturn

import numpy as np

from pipeline import errors
from pipeline.arrays import AnyArray
from pipeline.errors import ImpastoError, UnreadableMedia
from pipeline.video.guard.decoder_server import SERVER
from pipeline.video.guard.wire import ConnectionBroken, Message, receive, send
from pipeline.video.media import unreadable

log = logging.getLogger(__name__)

START_S = 60.0
ANSWER_S = 300.0
"""Time limit of an answer, s, after which a child is killed. A damaged video may have to be decoded from its start."""
_REPORTABLE = {
    kind.__name__: kind
    for kind in vars(errors).values()
    if isinstance(kind, type) and issubclass(kind, errors.BadInput)
}
"""Errors that a child may report, by class name."""


class DecoderDied(UnreadableMedia):
    """A decoder process has died: because of its file, or because something killed it."""


class DecoderNotStarted(ImpastoError):
    """A decoder process could not be started, for reasons other than its file."""

    code = "resources-exhausted"


class DecoderProcess:
    """A decoder process with one role on one file, killed if it does not answer in time. Not thread-safe; close it.

    Args:
        role: a name in `roles.ROLES`.
        task: the first message to the role: the file and its limits.
        shared_bytes: size of the shared memory in which the process returns arrays.
        timeout_s: time limit of each answer, s.
        memory_bytes: limit of the process's memory.
        on_progress: called with each intermediate message before the answer to the first message.

    Raises: like `ask`.
    """

    def __init__(
        self,
        role: str,
        task: Message,
        shared_bytes: int,
        timeout_s: float = ANSWER_S,
        memory_bytes: int = 4 << 30,
        on_progress: Callable[[Message], None] = lambda message: None,
    ) -> None:
        self._wire, theirs = socket.socketpair()
        self._wire.settimeout(START_S)
        self._timeout_s = timeout_s
        self._pid = 0
        with theirs, _shared_file(shared_bytes) as file:
            self._memory = mmap.mmap(file.fileno(), shared_bytes)
            SERVER.fork(theirs.fileno(), file.fileno())
        try:
            limits: Message = {"memory": memory_bytes, "seconds": timeout_s}
            self._pid = self._handshake({"role": role, "shared": shared_bytes} | limits)
            self._wire.settimeout(timeout_s)
            self.began = self.ask(task, on_progress)
        except BaseException:
            self.close()
            raise

    def _handshake(self, message: Message) -> int:
        """The process id. Raises DecoderNotStarted."""
        try:
            send(self._wire, message)
            return int(receive(self._wire)[0]["pid"])
        except (ConnectionBroken, OSError, KeyError) as error:
            remedy = "Check whether the machine has free memory and processes, and its limits (ulimit -v, -u)."
            raise DecoderNotStarted(f"No decoder could be started: {error}.", remedy=remedy) from error

    def ask(
        self, message: Message, on_progress: Callable[[Message], None] = lambda message: None
    ) -> tuple[Message, bytes]:
        """The answer to a message; `on_progress` is called with each intermediate message.

        Raises: BadInput (every kind, as the child raised it), OSError, DecoderDied, UnreadableMedia (time limit).
        """
        try:
            send(self._wire, message)
            while True:
                answer, data = receive(self._wire)
                if "progress" not in answer:
                    break
                on_progress(answer)
        except TimeoutError:
            self.close()
            remedy = "Re-encode it as H.264 in MP4."
            unreadable("The file takes too long to decode.", f"{self._timeout_s:g} s", remedy)
        except (ConnectionBroken, ConnectionError):
            self.close()
            remedy = "Re-encode it as H.264 in MP4."
            crashed = "The file crashes the decoder, or needs too much memory."
            raise DecoderDied(crashed, field="file", remedy=remedy) from None
        if "error" in answer:
            _raise(answer["error"])
        return answer, data

    def array(self, shape: tuple[int, ...], dtype: str) -> AnyArray:
        """A copy of the array in the shared memory. Raises UnreadableMedia if it would not fit there."""
        kind = np.dtype(dtype)
        if kind.hasobject or int(np.prod(shape, dtype=np.int64)) * kind.itemsize > len(self._memory):
            unreadable("The decoder's answer is inconsistent.", f"{shape} {dtype}")
        found = np.frombuffer(self._memory, kind, int(np.prod(shape))).reshape(shape)
        return found.copy()

    @property
    def alive(self) -> bool:
        """Whether the process can answer: it was not closed."""
        return self._wire.fileno() >= 0

    def close(self) -> None:
        """Kill the process."""
        if self._wire.fileno() < 0:
            return
        if self._pid and not _has_closed(self._wire):  # its end is open, so the process id still belongs to it
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._pid, signal.SIGKILL)
        self._wire.close()
        with contextlib.suppress(BufferError):
            self._memory.close()


def start_decoder(
    role: str,
    task: Message,
    shared_bytes: int,
    timeout_s: float = ANSWER_S,
    on_progress: Callable[[Message], None] = lambda message: None,
) -> DecoderProcess:
    """A started decoder process. If the first one dies, which may not be the file's fault, a second one is tried."""
    try:
        return DecoderProcess(role, task, shared_bytes, timeout_s, on_progress=on_progress)
    except (DecoderDied, DecoderNotStarted) as error:
        if isinstance(error, DecoderNotStarted):
            log.warning("%s The decoder server is started again.", error.message)
            SERVER.stop()
        return DecoderProcess(role, task, shared_bytes, timeout_s, on_progress=on_progress)


def _has_closed(wire: socket.socket) -> bool:
    wire.settimeout(0)
    try:
        return wire.recv(1, socket.MSG_PEEK) == b""
    except (BlockingIOError, TimeoutError):
        return False
    except OSError:
        return True


def _shared_file(size: int) -> Any:
    """A file of `size` bytes in memory. Pages are allocated when they are written."""
    linux = hasattr(os, "memfd_create")
    file: Any = os.fdopen(os.memfd_create("impasto"), "r+b") if linux else tempfile.TemporaryFile()  # noqa: SIM115
    os.ftruncate(file.fileno(), size)
    return file


def _raise(error: Message) -> NoReturn:
    """Raise the error that the child reported, if its class is reportable."""
    kind = _REPORTABLE.get(str(error.get("kind")))
    if kind is not None:
        fields = {name: error.get(name) or "" for name in ("field", "remedy")}
        raise kind(str(error.get("message")), value=error.get("value"), **fields)
    if isinstance(error.get("errno"), int):
        raise OSError(error["errno"], str(error.get("message")))
    raise ImpastoError(str(error.get("message")))
