"""kill -9 of a whole process tree at random points of a job, and the completion of the job afterwards."""

from __future__ import annotations

import random
import sqlite3
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import psutil

from pipeline.methods import method
from tests.e2e.processes import ROOT, Service, impasto, kill_9, start

TIMEOUT_S = 180.0
SEED = 5
RENDER = ("--workers", "2", "--seed", str(SEED), "--quiet")


@dataclass(frozen=True)
class KillPoint:
    """When to kill: `then_s` seconds after `frames` frames are painted, counting those of unfinished tasks."""

    frames: float
    then_s: float


@dataclass(frozen=True)
class Killed:
    """One kill: painted frames of the job, run time of the process, and number of killed processes."""

    frames: float
    finished: int
    """Those of `frames` that belong to finished tasks, which are not painted again."""
    lived_s: float
    processes: int


def kill_points(count: int, frames: float, then_s: float, seed: int) -> list[KillPoint]:
    """Random points spread over the painting of `frames` frames. A point that has already passed kills at start-up."""
    dice = random.Random(seed)
    return [KillPoint(at, dice.uniform(0, then_s)) for at in sorted(dice.uniform(0, frames) for _ in range(count))]


def job_words(name: str, clip: Path) -> list[str]:
    """Options of `impasto render` for a method: the clip is each video that it requires."""
    required = (spec.name for spec in method(name).inputs[1:] if spec.required)
    return ["--method", name, *(word for each in required for word in ("--input", f"{each}={clip}"))]


def render_killed(
    clip: Path, out: Path, home: Path, plan: Sequence[KillPoint], name: str = "abstraction"
) -> list[Killed]:
    """`impasto render clip -o out` with a method, killed at each point, and run once more to its end."""
    command = impasto("render", clip, "-o", out, "--home", home, *job_words(name, clip), *RENDER)
    log = home.with_suffix(".log")
    deaths = []
    for point in plan:
        deaths.append(_kill_at(start(command, log), point, lambda: next(home.glob("renders/*/impasto.db"), None)))
        assert not out.exists(), "a result before the render was over"
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, timeout=TIMEOUT_S)
    return deaths


def serve_killed(clip: Path, out: Path, home: Path, farm: str, plan: Sequence[KillPoint]) -> list[Killed]:
    """Run the same job over HTTP: one client waits through all kills of the service, then fetches the result."""
    service = Service(home, farm)
    deaths = []
    try:
        process = service.start()
        service.wait_ready()
        waiting = _Waiting(service, clip)
        for point in plan:
            deaths.append(_kill_at(process, point, lambda: home / "impasto.db"))
            process = service.start()
        waiting.fetch(out)
    finally:
        service.stop()
    return deaths


class _Waiting:
    """A thread with a client that submits one job and waits for its end."""

    def __init__(self, service: Service, clip: Path) -> None:
        self._client = service.client()
        video = self._client.upload(clip)
        self._job = self._client.submit("abstraction", {"video": video["id"]}, seed=SEED)["id"]
        self._error: list[Exception] = []
        self._thread = threading.Thread(target=self._wait, daemon=True)
        self._thread.start()

    def _wait(self) -> None:
        try:
            self._client.wait(self._job)
        except Exception as error:
            self._error.append(error)

    def fetch(self, out: Path) -> None:
        self._thread.join(TIMEOUT_S)
        assert not self._thread.is_alive(), "the job did not end"
        if self._error:
            raise self._error[0]
        with self._client as client:
            client.download(self._job, out)


def _kill_at(process: psutil.Popen, point: KillPoint, database: Callable[[], Path | None]) -> Killed:
    born = time.monotonic()
    while painted(database())[0] < point.frames:
        assert process.poll() is None, "the process ended before it was killed"
        assert time.monotonic() < born + TIMEOUT_S, "the job makes no progress"
        time.sleep(0.02)
    time.sleep(point.then_s)
    lived_s = time.monotonic() - born
    assert process.poll() is None, "the process ended before it was killed"
    count = kill_9(process)
    return Killed(*painted(database()), lived_s, count)


def painted(database: Path | None) -> tuple[float, int]:
    """Painted frames of a home's only job, and those of finished tasks, according to its database."""
    if database is None or not database.is_file():
        return 0.0, 0
    try:
        with closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True, timeout=5)) as connection:
            rows = connection.execute("SELECT emit_stop - emit_start, state, progress FROM tasks WHERE emit_stop > 0")
            found = rows.fetchall()
    except sqlite3.OperationalError:  # its tables are about to be made
        return 0.0, 0
    finished = sum(frames for frames, state, _ in found if state == "succeeded")
    return finished + sum(frames * done for frames, state, done in found if state == "running"), finished
