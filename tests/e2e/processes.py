"""The product's programs as child processes, and functions that kill them."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import psutil

from impasto import Client
from tests.ports import free_port
from tests.waiting import answers

ROOT = Path(__file__).resolve().parents[2]


def impasto(*words: str | Path) -> list[str]:
    """The command line of `impasto`, by the interpreter that runs us."""
    return [sys.executable, "-m", "impasto", *map(str, words)]


def start(command: list[str], log: Path) -> psutil.Popen:
    """Start a command; its output is appended to `log`."""
    with log.open("ab") as sink:
        return psutil.Popen(command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=sink, stderr=sink)


def kill_9(root: psutil.Process) -> int:
    """Kill a process and all its descendants together, as a power cut does. Returns the number of killed processes.

    All processes are stopped first, until no new one appears: none can observe a death or start another process.
    """
    found: dict[int, psutil.Process] = {}
    while new := [process for process in _tree(root) if process.pid not in found]:
        for process in new:
            found[process.pid] = process
            _quietly(process.suspend)
    for process in found.values():
        _quietly(process.kill)
    if isinstance(root, psutil.Popen):
        root.wait(30)
    _await_death(found.values())
    return len(found)


def _tree(root: psutil.Process) -> list[psutil.Process]:
    try:
        return [root, *root.children(recursive=True)]
    except psutil.NoSuchProcess:
        return []


def _quietly(act: object) -> None:
    with contextlib.suppress(psutil.NoSuchProcess):
        act()  # type: ignore[operator]


def _await_death(processes: Iterable[psutil.Process], timeout_s: float = 30) -> None:
    deadline = time.monotonic() + timeout_s
    while any(_alive(process) for process in processes):
        assert time.monotonic() < deadline, "a killed process lives on"
        time.sleep(0.01)


def _alive(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


class Service:
    """`impasto serve` with one home and one address, across restarts."""

    def __init__(self, home: Path, farm: str, workers: int = 2) -> None:
        self.log = home.with_suffix(".log")
        self._port = free_port()
        self.url = f"http://127.0.0.1:{self._port}"
        self._command = impasto(
            "serve", "--home", home, "--port", str(self._port), "--farm", farm, "--workers", str(workers)
        )
        self.process: psutil.Popen | None = None

    def start(self) -> psutil.Popen:
        """Start it; it may need seconds before it answers."""
        self.process = start(self._command, self.log)
        return self.process

    def client(self) -> Client:
        return Client(self.url)

    def wait_ready(self, timeout_s: float = 90) -> None:
        """Wait until the service answers."""
        deadline = time.monotonic() + timeout_s
        while not answers(f"{self.url}/healthz"):
            assert self.process is not None and self.process.poll() is None, self.log.read_text()
            assert time.monotonic() < deadline, f"no answer from {self.url}: {self.log.read_text()}"
            time.sleep(0.05)

    def stop(self) -> None:
        """Stop the service with SIGTERM, as an operator does."""
        if self.process is not None and self.process.poll() is None:
            self.process.terminate()
            self.process.wait(60)
