"""The documented upgrade without lost work: a new process starts, the old one gets SIGTERM and finishes the tasks it
runs. No attempt is cut off; the films have the bytes of an undisturbed run. Then the same by an operator's drain."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from impasto import Client
from impasto.cli.app import run
from tests.e2e.pages import make_two_shots, serve
from tests.e2e.processes import ROOT
from tests.waiting import until

FRAMES = 240


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_two_shots(tmp_path_factory.mktemp("rolling") / "cut.mp4", FRAMES)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("farm") / "home"


@pytest.fixture(scope="module")
def client(home: Path) -> Iterator[Client]:
    """A client of a service without a pool: separate workers run all tasks."""
    served = serve(home, POOL="none")
    with Client(next(served)) as client:
        yield client
    next(served, None)


class Worker:
    """An `impasto worker` process."""

    def __init__(self, home: Path) -> None:
        command = [sys.executable, "-m", "impasto", "worker", "--home", str(home)]
        self.process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.id = self.process.stdout.readline().strip()

    def end(self) -> int:
        return self.process.wait(60)

    @property
    def alive(self) -> bool:
        return self.process.poll() is None


@pytest.fixture(scope="module")
def started(home: Path) -> Iterator[list[Worker]]:
    """All workers started so far. The last one of a test is the old worker of the next test."""
    workers: list[Worker] = []
    yield workers
    for worker in workers:
        worker.process.kill()
        worker.end()


@pytest.fixture
def old(home: Path, started: list[Worker]) -> Worker:
    """The only running worker."""
    alive = [worker for worker in started if worker.alive]
    assert len(alive) <= 1, "an earlier test has left more than one"
    return alive[0] if alive else _start(home, started)


def _start(home: Path, started: list[Worker]) -> Worker:
    started.append(Worker(home))
    return started[-1]


@pytest.fixture(scope="module")
def undisturbed(clip: Path) -> bytes:
    out = clip.with_name("undisturbed.mp4")
    assert run(["render", str(clip), "-o", str(out), "--seed", "5", "--quiet", "--home", f"{out}.home"]) == 0
    return out.read_bytes()


def _submit(client: Client, clip: Path, count: int = 2) -> list[str]:
    video = client.upload(clip)["id"]
    return [client.submit("abstraction", {"video": video}, seed=5)["id"] for _ in range(count)]


def _check(client: Client, jobs: list[str], undisturbed: bytes, tmp_path: Path, workers: set[str]) -> None:
    """Check that every job has the right bytes, no attempt was interrupted, and each worker took part."""
    bars = []
    for job in jobs:
        client.wait(job, 120)
        assert client.download(job, tmp_path / f"{job}.mp4").read_bytes() == undisturbed
        bars += client.ops.timeline(job)
    assert {bar["outcome"] for bar in bars} == {"succeeded"}
    assert {bar["worker"] for bar in bars} == workers


def _at_work(client: Client, worker: str) -> int:
    return sum(len(one["at_work"]) for one in client.ops.workers() if one["id"] == worker)


def test_a_new_worker_starts_while_the_old_one_finishes_its_tasks(
    client: Client, home: Path, clip: Path, undisturbed: bytes, tmp_path: Path, old: Worker, started: list[Worker]
) -> None:
    jobs = _submit(client, clip, 3)
    until(lambda: _at_work(client, old.id), 30)
    new = _start(home, started)
    until(lambda: _at_work(client, old.id), 30)
    old.process.terminate()
    assert old.end() == 0
    assert [worker["id"] for worker in client.ops.workers()] == [new.id]
    _check(client, jobs, undisturbed, tmp_path, {old.id, new.id})


def test_a_drained_worker_can_be_killed_without_failed_attempts(
    client: Client, home: Path, clip: Path, undisturbed: bytes, tmp_path: Path, old: Worker, started: list[Worker]
) -> None:
    jobs = _submit(client, clip)
    until(lambda: _at_work(client, old.id), 30)
    client.ops.drain(old.id, "upgrade")
    new = _start(home, started)
    until(lambda: [w["state"] for w in client.ops.workers() if w["id"] == old.id] == ["drained"], 60)
    old.process.kill()
    old.end()
    _check(client, jobs, undisturbed, tmp_path, {old.id, new.id})


def test_a_second_signal_releases_tasks_at_once(
    client: Client, home: Path, clip: Path, undisturbed: bytes, tmp_path: Path, old: Worker, started: list[Worker]
) -> None:
    client.ops.drain("queue")
    jobs = _submit(client, clip)
    client.ops.resume("queue")
    until(lambda: _at_work(client, old.id), 30)
    old.process.terminate()
    old.process.terminate()
    assert old.end() == 0
    other = _start(home, started)
    for job in jobs:
        client.wait(job, 120)
        assert client.download(job, tmp_path / f"{job}.mp4").read_bytes() == undisturbed
    other.process.terminate()
    assert other.end() == 0
