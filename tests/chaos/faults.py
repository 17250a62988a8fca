"""What can go wrong, done to real parts. Each fault begins, lasts, and ends; then the next one may come."""

from __future__ import annotations

import random
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass

import psutil

from tests.real.postgres import Postgres
from tests.real.swift import Swift
from tests.workers.real_farm import Worker
from workers.model import TaskOutcome
from workers.studio import Studio


@dataclass(frozen=True)
class Scene:
    """Everything that faults may be done to."""

    asking: Studio
    workers: list[Worker]
    postgres: Postgres
    s3: Swift
    chance: random.Random
    lease_s: float
    away_s: tuple[float, float]
    """How long stores stay away: at least, at most."""

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
        for task in store.history.tasks(job.id, limit=200).items:
            for attempt in task.attempts:
                if attempt["outcome"] != "running":
                    wrong = TaskOutcome(attempt["id"], {"wrong": 1}, {}, {"result": ("wrong", "x/y")}, "wrong", {}, "")
                    assert not store.work.finish(wrong), "a duplicate was taken"


FAULTS: tuple[Callable[[Scene], None], ...] = (
    kill_worker,
    kill_all_workers,
    freeze_worker,
    crash_postgres,
    stop_postgres,
    freeze_postgres,
    stop_objects,
    kill_s3,
    answer_again,
)
