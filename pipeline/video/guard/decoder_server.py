"""The decoder server of a process, which forks decoder processes.

Importing the decoders takes half a second; forking a process that has imported them takes a few milliseconds. The
decoder server is a separate process because ours has threads, which do not survive a fork. It ends when our process
ends, and its children end with it. This module imports nothing large, so that a command can start the server first.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pipeline

_ROOT = Path(pipeline.__file__).parent.parent
_ENTRY = """import sys
sys.path.insert(0, sys.argv[2])
from pipeline.video.guard.server_main import main
main(int(sys.argv[1]))"""
"""The server's program: imports the package from the same place as this process."""


class DecoderServer:
    """The decoder server of this process. It starts at its first use, and again if it has died or after a fork."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._pid = 0
        self._control: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start the server, if it is not running, without waiting for its imports."""
        with self._lock:
            self._open()

    def fork(self, *fds: int) -> None:
        """Fork a child that inherits these file descriptors. Raises OSError."""
        with self._lock:
            try:
                socket.send_fds(self._open(), [b"!"], fds)
            except OSError:  # the server has died: start another one
                self._control = None
                socket.send_fds(self._open(), [b"!"], fds)

    def share(self) -> int:
        """File descriptor of the connection to the server, which is started if it is not running."""
        with self._lock:
            return self._open().fileno()

    def adopt(self, fd: int) -> None:
        """Use the server of another process, whose connection this file descriptor is."""
        with self._lock:
            self._control, self._pid = socket.socket(fileno=fd), os.getpid()

    def stop(self) -> None:
        """Kill a server that does not start children. The next child gets a new server."""
        with self._lock:
            if self._control is not None and self._pid == os.getpid():
                if self._process is not None:
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


SERVER = DecoderServer()
"""The decoder server of this process."""


def start_decoder_server() -> None:
    """Start the decoder server of this process in the background, so that the first file opens sooner."""
    SERVER.start()


def share_decoder_server() -> int:
    """File descriptor through which a child process, which inherits it, can use the decoder server of this process."""
    return SERVER.share()


def adopt_decoder_server(fd: int) -> None:
    """Use the decoder server of the parent, whose `share_decoder_server` has returned `fd`."""
    SERVER.adopt(fd)
