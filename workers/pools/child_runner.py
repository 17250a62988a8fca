"""A runner whose orders run in a process of its own.

A thread of this process sends an order, passes reports on, and waits for the outcome. If a child crashes or hangs, for
example in native code, only its attempt ends, and the next order gets a new child.
"""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import workers
from pipeline.errors import Cancelled, ImpastoError
from pipeline.video.guard.decoder_server import share_decoder_server
from workers.contract.order import ProgressReport, TaskOrder, TaskOutcome
from workers.pools.local_pool import TaskRunner

_ROOT = Path(workers.__file__).parent.parent
_ENTRY = """import sys
sys.path.insert(0, sys.argv[3])
from workers.pools.child_main import main
main(int(sys.argv[1]), int(sys.argv[2]))"""
"""The child's program: imports the package from the same place as this process."""
START_S = 50.0
"""Time limit of the child's imports, seconds."""
CANCEL_S = 10.0
"""Time after which a cancelled attempt that does not end is killed with its child, seconds."""
_CHECK_S = 0.1
"""Interval of checks for cancellation, seconds."""
_END_S = 2.0
"""Time that an idle child may take to end, seconds."""


class ChildDied(ImpastoError):
    """The process of a runner has ended, for example because its native code crashed or memory was short."""

    code = "worker-died"


@dataclass(frozen=True)
class CancelMessage:
    """Message to the child: stop this attempt, if it still runs."""

    attempt_id: str


@dataclass(frozen=True)
class WarmUp:
    """Message to the child: load kernels in the background."""


@dataclass(frozen=True)
class Progress:
    """Message of the child: see `workers.pools.base.ProgressReport`."""

    done: float
    preview: str


class ChildRunner:
    """Starts a child, which takes about a second, and runs one order at a time in it. Close it. Only `kill` and
    `warm_up` may be called from another thread.

    Args:
        make_runner: makes the runner in the child, to which it is pickled.

    Raises: ChildDied, if the child does not start.
    """

    def __init__(self, make_runner: Callable[[], TaskRunner]) -> None:
        self._make_runner = make_runner
        self._sending = threading.Lock()
        self._start()

    def _start(self) -> None:
        ours, theirs = socket.socketpair()
        decoders = share_decoder_server()
        command = [sys.executable, "-c", _ENTRY, str(theirs.fileno()), str(decoders), str(_ROOT)]
        with theirs:
            self._process = subprocess.Popen(  # noqa: S603  (our own module, a fixed command)
                command,
                pass_fds=[theirs.fileno(), decoders],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for the parent, which ends its children
            )
        self._wire = Connection(ours.detach())
        try:
            with self._broken_wire():
                self._wire.send(self._make_runner)
                if not self._wire.poll(START_S):
                    self._process.kill()
                self._wire.recv()  # it is ready
        except BaseException:
            self.close()
            raise

    @property
    def pid(self) -> int:
        """Process id of the child."""
        return self._process.pid

    def run(self, order: TaskOrder, report: ProgressReport, cancelled: Callable[[], bool]) -> TaskOutcome:
        """Run one attempt; arguments as for `workers.execution.renderer.Renderer.run`. Raises ChildDied, Cancelled."""
        if self._process.poll() is not None:  # it has died between two orders
            self.close()
            self._start()
        kill_at = None
        with self._broken_wire():
            self._send(order)
            while True:
                if kill_at is None and cancelled():
                    self._send(CancelMessage(order.attempt_id))
                    kill_at = time.monotonic() + CANCEL_S
                if kill_at is not None and time.monotonic() > kill_at:
                    self.close()
                    raise Cancelled("The attempt did not stop; its process was killed.")
                if not self._wire.poll(_CHECK_S):
                    continue
                message = self._wire.recv()
                if isinstance(message, TaskOutcome):
                    return message
                report(message.done, message.preview)

    def warm_up(self, stopped: Callable[[], bool]) -> None:
        """Let the child load kernels in the background, until it ends."""
        with contextlib.suppress(OSError):
            self._send(WarmUp())

    def kill(self) -> None:
        """Kill the child; `run` raises ChildDied."""
        self._process.kill()

    def _send(self, message: object) -> None:
        with self._sending:
            self._wire.send(message)

    def close(self) -> None:
        """End the child, which ends when its connection is closed."""
        self._wire.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)
        self._process.kill()
        self._process.wait()

    @contextlib.contextmanager
    def _broken_wire(self) -> Iterator[None]:
        """Raises ChildDied if the connection breaks."""
        try:
            yield
        except (EOFError, ConnectionError) as error:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_END_S)
            remedy = "Check whether the machine has enough memory; see the log of the service."
            raise ChildDied(
                f"A worker process has ended ({_ending(self._process.returncode)}).", remedy=remedy
            ) from error


def _ending(code: int | None) -> str:
    if code is None:
        return "its connection is broken"
    return f"signal {-code}" if code < 0 else f"exit status {code}"
