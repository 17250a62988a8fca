"""`impasto render` in a process that another one watches.

Its first attempts run in threads, which start at once, and a thread cannot be ended when a library hangs in it. So the
command forks before its imports: the child renders, and this process starts it again if it hangs. The render continues
from its last finished task. There are two kinds of hang:

- A thread hangs while others run. The child's dispatcher notices it and ends the child with `HUNG_STATUS`.
- Native code holds the interpreter lock. No thread of the child runs, and its pulse stops.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
from collections.abc import Iterator
from threading import Event, Thread

from workers.process.starting import HUNG_STATUS

SILENT_S = 45
"""A child without a pulse for this long hangs, seconds."""
PULSE_S = 1.0
_MOST_STARTS = 20
_PR_SET_PDEATHSIG = 1
_PASSED_ON = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_pulse: int | None = None
"""File descriptor of the pipe to the watching process; None: nobody watches."""


def watch_from_here() -> None:
    """Fork. Returns in the child; this process never returns, and ends as its last child does."""
    global _pulse
    for _ in range(_MOST_STARTS):
        reader, writer = os.pipe()
        if (pid := os.fork()) == 0:
            os.close(reader)
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
            _pulse = writer
            return
        os.close(writer)
        signal.pthread_sigmask(signal.SIG_BLOCK, {*_PASSED_ON, signal.SIGCHLD})
        status, hung = _watch(pid, reader)
        os.close(reader)
        if not (hung or status == HUNG_STATUS):
            break
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {*_PASSED_ON, signal.SIGCHLD})
        print("A library hung; the render is started again.", file=sys.stderr, flush=True)
    _end_with(status)


def _watch(pid: int, reader: int) -> tuple[int, bool]:
    """Wait for the end of a child: its exit status (negative: a signal), and whether it was killed because its pulse
    stopped. Seconds are counted, so that a time in which both processes were stopped is no silence."""
    os.set_blocking(reader, False)
    silent_s, begun = 0, False
    while silent_s < SILENT_S:
        received = signal.sigtimedwait({*_PASSED_ON, signal.SIGCHLD}, PULSE_S)
        if received is None:
            beats = _read(reader)
            begun, silent_s = begun or bool(beats), 0 if beats or not begun else silent_s + 1
        elif received.si_signo == signal.SIGCHLD:
            if (ended := os.waitpid(pid, os.WNOHANG))[0]:
                return os.waitstatus_to_exitcode(ended[1]), False
        elif received.si_pid or received.si_signo != signal.SIGINT:  # a terminal sends Ctrl-C to the child, too
            os.kill(pid, received.si_signo)
    os.kill(pid, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), True


def _read(reader: int) -> bytes:
    """The pulse since the last call; always some after its end, which is no silence."""
    try:
        return os.read(reader, 4096) or b"."
    except BlockingIOError:
        return b""


def _end_with(status: int) -> None:
    """End this process as its child has ended."""
    if status < 0:
        signal.signal(-status, signal.SIG_DFL) if -status not in (signal.SIGKILL, signal.SIGSTOP) else None
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {-status})
        os.kill(os.getpid(), -status)
    os._exit(abs(status))


@contextlib.contextmanager
def pulse() -> Iterator[None]:
    """Within the first such block this process has a pulse, if another one watches it: of a thread, which runs unless
    native code holds the interpreter lock. After it, the process is no longer watched for hangs."""
    global _pulse
    writer, _pulse = _pulse, None  # a block within this one has the pulse of this one
    if writer is None:
        yield
        return
    stopped = Event()
    thread = Thread(target=_send_pulses, args=(writer, stopped), name="impasto-pulse", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stopped.set()
        thread.join()
        os.close(writer)


def _send_pulses(fd: int, stopped: Event) -> None:
    """The first one at once: a child without any pulse is still starting, and is not watched."""
    with contextlib.suppress(OSError):
        os.write(fd, b".")
        while not stopped.wait(PULSE_S):
            os.write(fd, b".")
