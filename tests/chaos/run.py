"""One run: jobs, faults, and the comparison with the results of undisturbed jobs."""

from __future__ import annotations

import random
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import StorageError
from tests.chaos.faults import FAULTS, SHAPES, Scene
from tests.chaos.raylets import Raylets
from tests.real.postgres import Postgres
from tests.real.swift import Swift
from tests.workers.real_farm import Worker
from workers.farm import Farm
from workers.model import Job, JobRequest
from workers.settings import FarmSettings

PATIENCE_S = 180.0


@dataclass(frozen=True)
class Outcome:
    """The result of a run."""

    faults: Counter[str]
    jobs: int
    lost: int
    """Jobs that did not succeed, or made other bytes; of those with a task that always fails, that did not fail so."""
    attempts: Counter[str]
    """Ended attempts by outcome."""
    running: int
    """Attempts that still count as running: none."""
    twice: int
    """Tasks that succeeded more than once: none."""
    orphans: int
    """Number of unreferenced blobs after the sweep: none."""


def run(
    settings: FarmSettings,
    folder: Path,
    postgres: Postgres,
    s3: Swift,
    expected: Sequence[bytes],
    seed: int,
    times: int,
    away_s: tuple[float, float] = (0.5, 2.0),
    faults: Sequence[Callable[[Scene], None]] = FAULTS,
    raylets: Raylets | None = None,
) -> Outcome:
    """`times` times: submit a job of every shape, and do a fault to those who work. Then look at what is left.

    Args:
        settings: of a new database and a new prefix of the bucket.
        folder: for the workers' homes and the input.
        expected: bytes that undisturbed jobs of `SHAPES` make.
        seed: of faults, their order, their victims and their times.
        faults: that are done.
        raylets: nodes for the tasks; None: they run in the workers.
    """
    asking = Farm(settings, None)
    asking.start()
    theirs = settings if raylets is None else _on(settings, raylets)
    workers = [Worker(theirs, folder / name) for name in ("one", "two")]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.wait_up()
    chance = random.Random(seed)
    scene = Scene(settings, folder, asking, workers, postgres, s3, chance, settings.lease_s, away_s, raylets)
    over = threading.Event()
    threading.Thread(target=_supervise, args=(workers, over), daemon=True).start()
    try:
        done = _do(scene, times, faults)
        ended = [_patiently(lambda job=job: _final(asking, job)) for job, _ in scene.jobs]  # type: ignore[misc]
        poisoned = [_patiently(lambda job=job: _final(asking, job)) for job in scene.poisoned]  # type: ignore[misc]
        wanted = [expected[shape] for _, shape in scene.jobs]
        return _patiently(lambda: _judge(asking, ended, wanted, poisoned, done))
    finally:
        over.set()
        for worker in workers:
            worker.thaw()
            worker.kill()
        asking.stop()


def _on(settings: FarmSettings, raylets: Raylets) -> FarmSettings:
    changes = {"pool": "ray", "ray_address": raylets.address, "task_memory_bytes": 0, "live_sessions": 0}
    return settings.model_copy(update=changes)


def _supervise(workers: Sequence[Worker], over: threading.Event) -> None:
    while not over.wait(1.0):
        for worker in workers:
            worker.revive()


def submit(farm: Farm, folder: Path, shape: dict[str, Any]) -> str:
    data = folder / "data.json"
    data.write_text('{"cat": 1}')
    asset = farm.assets.add(data, "data.json")
    return farm.jobs.submit(JobRequest("toy", {"data": asset.id}, shape, seed=7)).id


def _do(scene: Scene, times: int, faults: Sequence[Callable[[Scene], None]]) -> Counter[str]:
    """Faults in a shuffled order, each as often as the others if there are so many; jobs come before each."""
    whole = list(faults) * (times // len(faults))
    order = [*whole, *scene.chance.sample(faults, times - len(whole))]
    scene.chance.shuffle(order)
    for fault in order:
        for number, shape in enumerate(SHAPES):
            job = _patiently(lambda shape=shape: submit(scene.asking, scene.folder, shape))  # type: ignore[misc]
            scene.jobs.append((job, number))
        time.sleep(scene.chance.uniform(0.1, 0.8))
        fault(scene)
    return Counter(fault.__name__ for fault in order)


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


def _final(farm: Farm, job_id: str) -> Job | None:
    job = farm.jobs.get(job_id)
    return job if job.state.final else None


def _judge(
    farm: Farm, jobs: list[Job], expected: Sequence[bytes], poisoned: list[Job], faults: Counter[str]
) -> Outcome:
    made = [b"".join(farm.files.read(farm.files.get(job.id, "result"))) if job.results else b"" for job in jobs]
    lost = sum(job.state != "succeeded" or got != want for job, got, want in zip(jobs, made, expected, strict=True))
    lost += sum(not _failed_as_expected(farm, job) for job in poisoned)
    tasks = [task for job in jobs for task in farm.tasks.page(job.id, limit=200).items]
    found = Counter(attempt["outcome"] for task in tasks for attempt in task.attempts)
    twice = sum([a["outcome"] for a in task.attempts].count("succeeded") != 1 for task in tasks)
    farm._collector.sweep()
    kept = {key for job in jobs for key in farm._store.jobs.blob_keys(job.id)}
    mine = {key for job in poisoned for key in farm._blobs.keys(f"jobs/{job.id}/")}
    orphans = len(set(farm._blobs.keys("jobs/")) - kept - mine)
    return Outcome(faults, len(jobs) + len(poisoned), lost, found, found.pop("running", 0), twice, orphans)


def _failed_as_expected(farm: Farm, job: Job) -> bool:
    """True if one task used all its attempts, each with a log, and results of other tasks are kept."""
    tasks = {task.key: task for task in farm.tasks.page(job.id, limit=200).items}
    bad = tasks["run-1"]
    failures = [attempt for attempt in bad.attempts if attempt["outcome"] == "failed"]
    kept = tasks["run-0"].state == "succeeded"
    return job.state == "failed" and len(failures) == 3 and "keyboard" in farm.tasks.log(bad.id) and kept
