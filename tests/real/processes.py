"""Child processes that end with this process, however it ends."""

from __future__ import annotations

import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path


def start(command: list[str], log: Path, env: Mapping[str, str] | None = None) -> subprocess.Popen[bytes]:
    """Start a server; its output goes to `log`. The kernel kills it if this process dies first."""
    with log.open("ab") as sink:
        dies_with_us = ["setpriv", "--pdeathsig", "KILL"]
        return subprocess.Popen([*dies_with_us, *command], stdin=subprocess.DEVNULL, stdout=sink, stderr=sink, env=env)


def end(process: subprocess.Popen[bytes], how: signal.Signals = signal.SIGKILL) -> None:
    """Send a signal and wait for the end."""
    if process.poll() is None:
        process.send_signal(signal.SIGCONT)
        process.send_signal(how)
        process.wait(30)


def delete_later(folder: Path) -> None:
    """Delete a folder in the background: that of a database server has tens of thousands of files."""
    subprocess.Popen(["rm", "-rf", str(folder)], stdin=subprocess.DEVNULL, start_new_session=True)


def until(ready: Callable[[], bool], process: subprocess.Popen[bytes], log: Path, timeout_s: float = 30.0) -> None:
    """Wait until a server is ready; fail with its log if it is not in time, or has died."""
    deadline = time.monotonic() + timeout_s
    while not ready():
        assert process.poll() is None and time.monotonic() < deadline, log.read_text(errors="replace")[-4000:]
        time.sleep(0.02)


def listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def nobody_special() -> str:
    """A user under which servers may run: the present one or, for root, an unprivileged one."""
    if os.getuid():
        return pwd.getpwuid(os.getuid()).pw_name
    known = {entry.pw_name for entry in pwd.getpwall()}
    return "postgres" if "postgres" in known else "nobody"


def as_user(name: str) -> list[str]:
    """The prefix of a command that runs as the user `name`."""
    if os.getuid() == pwd.getpwnam(name).pw_uid:
        return []
    return ["setpriv", f"--reuid={name}", f"--regid={pwd.getpwnam(name).pw_gid}", "--clear-groups"]


def folder_of(name: str, prefix: str) -> Path:
    """A new temporary folder that belongs to the user `name` (pytest's own may not be entered by others)."""
    folder = Path(tempfile.mkdtemp(prefix=prefix))
    if not os.getuid():
        shutil.chown(folder, name, pwd.getpwnam(name).pw_gid)
    return folder
