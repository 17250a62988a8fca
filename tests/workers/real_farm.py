"""Farms on real PostgreSQL and real S3: one for requests, and others as worker processes."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from multiprocessing.process import BaseProcess
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

from tests.real.postgres import Postgres
from tests.real.swift import ACCESS_KEY, REGION, SECRET_KEY, Swift
from tests.workers import farm_child
from workers.settings import FarmSettings

ROOT = Path(__file__).resolve().parents[2]


def real_settings(postgres: Postgres, s3: Swift, home: Path, **changes: Any) -> FarmSettings:
    """A farm at a new database and a new prefix."""
    given: dict[str, Any] = {
        "home": home,
        "database_url": postgres.fresh(),
        "blob_url": f"s3://{s3.shared_bucket}/{home.parent.name}",
        "s3_endpoint_url": s3.endpoint,
        "s3_region": REGION,
        "s3_access_key": ACCESS_KEY,
        "s3_secret_key": SECRET_KEY,
        "s3_addressing": "path",
        "reserve_bytes": 0,
        "retry_delay_s": 0.05,
        "workers": 2,
        "lease_s": 3.0,
        "stall_s": 15.0,
    }
    return FarmSettings(**{**given, **changes})


class Worker:
    """A farm that works on the same store with its own home, like another machine."""

    def __init__(self, settings: FarmSettings, home: Path, code: Path = ROOT) -> None:
        """`code`: the repository whose program it runs."""
        self._settings, self._code = settings.model_copy(update={"home": home}), code
        self._process: subprocess.Popen[str] | None = None
        self._lock = threading.Lock()
        self._wanted = False

    def start(self) -> None:
        with self._lock:
            self._wanted = True
            self._start()

    def revive(self) -> None:
        """Start it again if it has ended by itself because the database was down, as systemd would."""
        with self._lock:
            if self._wanted and self._process is not None and self._process.poll() is not None:
                self._start()

    def _start(self) -> None:
        command = [sys.executable, "-m", "tests.workers.farm_child"]
        pipe = subprocess.PIPE
        env = os.environ | {"PYTHONPATH": str(self._code)}
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, cwd=self._code, env=env)
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(self._settings_json() + "\n")
        self._process.stdin.flush()

    def _settings_json(self) -> str:
        settings = self._settings.model_dump(mode="json", exclude_defaults=True)  # an older program lacks the new ones
        settings |= {"s3_access_key": ACCESS_KEY, "s3_secret_key": SECRET_KEY}
        return json.dumps(settings)

    def wait_up(self) -> None:
        assert self.came_up(), "the worker did not start"

    def came_up(self) -> bool:
        """Wait until it works, or has ended."""
        assert self._process is not None and self._process.stdout is not None
        return self._process.stdout.readline() == "up\n"

    def kill(self) -> None:
        """Kill the process with SIGKILL without a restart."""
        with self._lock:
            self._wanted = False
            self._signal(signal.SIGKILL)
            if self._process is not None:
                self._process.wait()

    def step_clock(self) -> None:
        """Set the clock of the process an hour forward, and back at the next call."""
        self._signal(signal.SIGUSR1)

    def freeze(self) -> None:
        self._signal(signal.SIGSTOP)

    def thaw(self) -> None:
        self._signal(signal.SIGCONT)

    @property
    def pid(self) -> int | None:
        """Process id of the running process; None if there is none."""
        return None if self._process is None or self._process.poll() is not None else self._process.pid

    def _signal(self, which: signal.Signals) -> None:
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(which)


class ForkedWorker(Worker):
    """Like `Worker`, but forked from a process that has imported everything: a start takes a tenth of the time."""

    def __init__(self, settings: FarmSettings, home: Path) -> None:
        super().__init__(settings, home)
        self._child: BaseProcess | None = None
        self._up: Event | None = None

    def revive(self) -> None:
        with self._lock:
            if self._wanted and self._child is not None and not self._child.is_alive():
                self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["tests.workers.farm_child"])
        self._up = context.Event()
        self._child = context.Process(
            target=farm_child.run_forked, args=(self._settings_json(), self._up.set), daemon=True
        )
        self._child.start()

    def came_up(self) -> bool:
        assert self._up is not None
        return self._up.wait(60)

    def kill(self) -> None:
        with self._lock:
            self._wanted = False
            self._signal(signal.SIGKILL)
            if self._child is not None:
                self._child.join()

    @property
    def pid(self) -> int | None:
        """Process id of the running process."""
        return self._child.pid if self._child is not None and self._child.is_alive() else None

    def _signal(self, which: signal.Signals) -> None:
        if (pid := self.pid) is not None:
            os.kill(pid, which)


class Accepting(Worker):
    """A farm that accepts jobs and runs nothing, like a service without a pool."""

    def __init__(self, settings: FarmSettings, home: Path) -> None:
        super().__init__(settings.model_copy(update={"pool": "none"}), home)

    def submit(self, asset: str, params: dict[str, Any], key: str) -> str:
        """The id of the accepted job; empty if the process died before it printed the id."""
        assert self._process is not None and self._process.stdin is not None and self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps({"asset": asset, "params": params, "key": key}) + "\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            return ""
        line = self._process.stdout.readline()
        return line.strip() if line.endswith("\n") else ""
