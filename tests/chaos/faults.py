"""Faults injected into real components. Each fault begins, lasts and ends before the next one begins."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from tests.chaos.raylets import Raylets
from tests.real.postgres import Postgres
from tests.real.swift import Swift
from tests.workers.real_farm import Accepting, Worker
from workers.farm import Farm
from workers.model import JobRequest, TaskOutcome
from workers.settings import FarmSettings

SHAPES: tuple[dict[str, Any], ...] = (
    {"tasks": 10, "chain": True, "sleep_s": 0.05},
    {"tasks": 16, "sleep_s": 0.1},
    {"tasks": 8, "chain": True, "sleep_s": 0.1},
)
"""Parameters of the toy method."""
DISK_BYTES = 24 << 20
"""Size of the disk that is filled, in bytes."""
RESERVE_BYTES = 8 << 20


@dataclass(frozen=True)
class Scene:
    """Everything that faults may be done to."""

    settings: FarmSettings
    folder: Path
    asking: Farm
    workers: list[Worker]
    postgres: Postgres
    s3: Swift
    chance: random.Random
    lease_s: float
    away_s: tuple[float, float]
    """Shortest and longest outage of a store in seconds."""
    raylets: Raylets | None = None
    """The nodes on which the workers' tasks run; None: in the workers themselves."""
    jobs: list[tuple[str, int]] = field(default_factory=list)
    """Accepted, and their shape: each must succeed."""
    poisoned: list[str] = field(default_factory=list)
    """Accepted, with a task that always fails: each must fail, and keep what is done."""

    def away(self) -> None:
        time.sleep(self.chance.uniform(*self.away_s))


def kill_worker(scene: Scene) -> None:
    """kill -9 of one farm; another is started in its home."""
    chosen = scene.chance.choice(scene.workers)
    chosen.kill()
    chosen.start()


def kill_all_workers(scene: Scene) -> None:
    """Every farm at once, as when a machine loses power."""
    for worker in scene.workers:
        worker.kill()
    for worker in scene.workers:
        worker.start()


def freeze_worker(scene: Scene) -> None:
    """A farm that is silent beyond its lease, and then goes on as if nothing had happened: late answers."""
    chosen = scene.chance.choice(scene.workers)
    chosen.freeze()
    time.sleep(scene.lease_s + 1)
    chosen.thaw()


def crash_postgres(scene: Scene) -> None:
    """It ends without tidying up, and recovers when it comes back."""
    scene.postgres.stop(signal.SIGQUIT)
    scene.away()
    scene.postgres.start()


def stop_postgres(scene: Scene) -> None:
    """It cuts every connection and is away for a while."""
    scene.postgres.stop(signal.SIGINT)
    scene.away()
    scene.postgres.start()


def freeze_postgres(scene: Scene) -> None:
    """It takes every request and answers none."""
    server = psutil.Process(scene.postgres.process.pid)
    frozen = [server, *server.children(recursive=True)]
    for process in frozen:
        process.suspend()
    scene.away()
    for process in reversed(frozen):
        process.resume()


def stop_objects(scene: Scene) -> None:
    """S3 answers 503."""
    scene.s3.stop("object")
    scene.away()
    scene.s3.start("object")


def kill_s3(scene: Scene) -> None:
    """Nobody listens where S3 was."""
    scene.s3.stop()
    scene.away()
    scene.s3.start()


def answer_again(scene: Scene) -> None:
    """Every attempt that has ended answers once more, with something else: all of it must be refused."""
    store = scene.asking._store
    for job in store.jobs.page(limit=6).items:
        for task in store.tasks.page(job.id, limit=200).items:
            for attempt in task.attempts:
                if attempt["outcome"] != "running":
                    wrong = TaskOutcome(attempt["id"], {"wrong": 1}, {}, {"result": ("wrong", "x/y")}, "wrong", {}, "")
                    assert not store.queue.finish(wrong), "a duplicate was taken"


def kill_accepting(scene: Scene) -> None:
    """kill -9 of a process while it accepts jobs: what it has answered is there, what it has not comes once."""
    asset = scene.asking.jobs.page(limit=1).items[0].request.inputs["data"]
    accepting = Accepting(scene.settings, scene.folder / f"accepting-{len(scene.jobs)}")
    accepting.start()
    accepting.wait_up()
    threading.Timer(scene.chance.uniform(0.1, 0.8), accepting.kill).start()
    for number in range(100):
        shape, key = number % len(SHAPES), f"{len(scene.jobs)}-{number}"
        answered = accepting.submit(asset, SHAPES[shape], key)
        if not answered or number == 0:
            request = JobRequest("toy", {"data": asset}, SHAPES[shape], seed=7)
            again = scene.asking.jobs.submit(request, idempotency_key=key).id
            assert not answered or again == answered, "accepted, and then lost"
        scene.jobs.append((answered or again, shape))
        if not answered:
            break
    accepting.kill()


def step_clock(scene: Scene) -> None:
    """The clock of a machine jumps an hour ahead, and later back."""
    chosen = scene.chance.choice(scene.workers)
    chosen.step_clock()
    time.sleep(scene.chance.uniform(0.5, scene.lease_s))
    chosen.step_clock()


def fill_disk(scene: Scene) -> None:
    """A worker's disk is full for a while; it is a small one for the test. Only root can make one."""
    chosen = scene.workers[-1]
    chosen.kill()
    with small_disk(scene.folder / f"small-{len(scene.jobs)}") as disk:
        narrow = Worker(scene.settings.model_copy(update={"reserve_bytes": RESERVE_BYTES}), disk / "home")
        narrow.start()
        narrow.wait_up()
        usage = os.statvfs(disk)
        (disk / "filler").write_bytes(bytes(usage.f_bavail * usage.f_frsize))
        scene.away()
        (disk / "filler").unlink()
        time.sleep(1)
        narrow.kill()
    chosen.start()


@contextmanager
def small_disk(place: Path) -> Iterator[Path]:
    """A file system of DISK_BYTES."""
    place.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "none", str(place)], check=True)
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def poison(scene: Scene) -> None:
    """A task that fails whenever it runs."""
    asset = scene.asking.jobs.page(limit=1).items[0].request.inputs["data"]
    params = {**SHAPES[1], "trouble": "raise"}
    scene.poisoned.append(scene.asking.jobs.submit(JobRequest("toy", {"data": asset}, params, seed=7)).id)


def kill_node(scene: Scene) -> None:
    """kill -9 of a Ray node and of all that runs there; another one joins."""
    assert scene.raylets is not None
    scene.raylets.kill_node(scene.chance)


def kill_actor(scene: Scene) -> None:
    """kill -9 of the process in which a task runs."""
    assert scene.raylets is not None
    scene.raylets.kill_actor(scene.chance)


FAULTS: tuple[Callable[[Scene], None], ...] = (
    kill_worker,
    kill_all_workers,
    freeze_worker,
    kill_accepting,
    crash_postgres,
    stop_postgres,
    freeze_postgres,
    stop_objects,
    kill_s3,
    step_clock,
    answer_again,
    poison,
)
OF_A_CLUSTER: tuple[Callable[[Scene], None], ...] = (kill_node, kill_actor)
"""Besides, where tasks run on Ray."""
OF_ROOT: tuple[Callable[[Scene], None], ...] = (fill_disk,)
"""Besides, where one may mount."""
BY_NAME = {fault.__name__: fault for fault in (*FAULTS, *OF_A_CLUSTER, *OF_ROOT)}
