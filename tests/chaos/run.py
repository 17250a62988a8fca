"""One run: jobs, faults, and the comparison with what undisturbed jobs make."""

from __future__ import annotations

import random
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import StorageError
from tests.chaos.faults import FAULTS, Scene
from tests.real.postgres import Postgres
from tests.real.swift import Swift
from tests.workers.real_farm import Worker
from workers.model import Job, JobRequest
from workers.settings import FarmSettings
from workers.studio import Studio

SHAPES: tuple[dict[str, Any], ...] = (
    {"tasks": 10, "chain": True, "sleep_s": 0.05},
    {"tasks": 16, "sleep_s": 0.1},
    {"tasks": 8, "chain": True, "sleep_s": 0.1},
)
"""Parameters of the toy method."""
PATIENCE_S = 180.0


@dataclass(frozen=True)
class Outcome:
    """What a run has shown."""

    faults: Counter[str]
    jobs: int
    lost: int
    """Jobs that did not succeed, or made other bytes."""
    attempts: Counter[str]
    """Ended attempts by outcome."""
    running: int
    """Attempts that still count as running: none."""
    twice: int
    """Tasks that succeeded more than once: none."""
    orphans: int
    """Blobs that nobody needs, after the sweep: none."""


def run(
    settings: FarmSettings,
    folder: Path,
    postgres: Postgres,
    s3: Swift,
    expected: Sequence[bytes],
    seed: int,
    times: int,
    away_s: tuple[float, float] = (0.5, 2.0),
) -> Outcome:
    """`times` times: submit a job of every shape, and do a fault to those who work. Then look at what is left.

    Args:
        settings: of a new database and a new prefix of the bucket.
        folder: for the workers' homes and the input.
        expected: bytes that undisturbed jobs of `SHAPES` make.
        seed: of faults, their order, their victims and their times.
    """
    chance = random.Random(seed)
    asking = Studio(settings, None)
    asking.start()
    workers = [Worker(settings, folder / name) for name in ("one", "two")]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.wait_up()
    scene = Scene(asking, workers, postgres, s3, chance, settings.lease_s, away_s)
    try:
        faults, jobs = _do(scene, folder, times)
        ended = [_patiently(lambda job=job: _final(asking, job)) for job in jobs]  # type: ignore[misc]
        return _patiently(lambda: _judge(asking, ended, [*expected] * times, faults))
    finally:
        for worker in workers:
            worker.thaw()
            worker.kill()
        asking.stop()


def submit(farm: Studio, folder: Path, shape: dict[str, Any]) -> str:
    data = folder / "data.json"
    data.write_text('{"cat": 1}')
    asset = farm.add_asset(data, "data.json")
    return farm.submit(JobRequest("toy", {"data": asset.id}, shape, seed=7)).id


def _do(scene: Scene, folder: Path, times: int) -> tuple[Counter[str], list[str]]:
    """Faults in a shuffled order, each as often as the others if there are so many; and the jobs they came upon."""
    whole = list(FAULTS) * (times // len(FAULTS))
    order = [*whole, *scene.chance.sample(FAULTS, times - len(whole))]
    scene.chance.shuffle(order)
    jobs: list[str] = []
    for fault in order:
        for shape in SHAPES:
            jobs.append(_patiently(lambda shape=shape: submit(scene.asking, folder, shape)))  # type: ignore[misc]
        time.sleep(scene.chance.uniform(0.1, 0.8))
        fault(scene)
    return Counter(fault.__name__ for fault in order), jobs


def _patiently(ask: Callable[[], Any]) -> Any:
    """The first answer that is not None, however often the stores are away meanwhile."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            if (answer := ask()) is not None:
                return answer
        except StorageError as error:
            assert time.monotonic() < deadline, error
        assert time.monotonic() < deadline, "it did not end"
        time.sleep(0.1)


def _final(farm: Studio, job_id: str) -> Job | None:
    job = farm.job(job_id)
    return job if job.state.final else None


def _judge(farm: Studio, jobs: list[Job], expected: Sequence[bytes], faults: Counter[str]) -> Outcome:
    made = [b"".join(farm.read(farm.file(job.id, "result"))) if job.results else b"" for job in jobs]
    lost = sum(job.state != "succeeded" or got != want for job, got, want in zip(jobs, made, expected, strict=True))
    tasks = [task for job in jobs for task in farm.tasks(job.id, limit=200).items]
    found = Counter(attempt["outcome"] for task in tasks for attempt in task.attempts)
    twice = sum([a["outcome"] for a in task.attempts].count("succeeded") != 1 for task in tasks)
    farm._tidier.sweep()
    kept = {key for job in jobs for key in farm._store.jobs.blob_keys(job.id)}
    orphans = len(set(farm._blobs.keys("jobs/")) - kept)
    return Outcome(faults, len(jobs), lost, found, found.pop("running", 0), twice, orphans)
