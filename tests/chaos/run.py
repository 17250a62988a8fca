"""One run: jobs, faults, and the comparison with the results of undisturbed jobs."""

from __future__ import annotations

import random
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tests.chaos.bad_network import BadNetwork
from tests.chaos.faults import FAULTS, OF_S3, SHAPES, Fault, Scene, Shape, component
from tests.chaos.raylets import Raylets
from tests.chaos.retries import with_retries
from tests.real.postgres import Postgres
from tests.real.swift import Swift
from tests.workers.real_farm import ForkedWorker, Worker
from workers.contract.record import Job
from workers.contract.request import JobRequest
from workers.farm import Farm
from workers.settings import FarmSettings

_THREADS = ThreadPoolExecutor(8)
"""These threads live as long as the process, because the kernel kills a server when the thread that started it ends."""


@dataclass(frozen=True)
class Outcome:
    """The result of a run."""

    faults: Counter[str]
    jobs: int
    lost: int
    """Jobs that did not succeed or gave other bytes, and poisoned jobs that did not fail as expected: must be 0."""
    attempts: Counter[str]
    """Ended attempts by outcome."""
    running: int
    """Attempts that are still recorded as running: must be 0."""
    twice: int
    """Tasks that succeeded more than once, and jobs that were accepted more than once: must be 0."""
    orphans: int
    """Unreferenced blobs after garbage collection: must be 0."""


@dataclass(frozen=True)
class Plan:
    """Plan of a run. Before each fault, or group of faults, it submits `rounds` jobs of every shape.

    Attributes:
        seed: of faults, their order, their victims and their times.
        away_s: shortest and longest outage of a store in seconds.
        faults: that are done.
        raylets: nodes for the tasks; None: they run in the workers.
        older: a repository of an earlier version; one of the two workers runs its program.
        together: faults that are injected at once, each into another component.
    """

    seed: int
    times: int
    away_s: tuple[float, float] = (0.5, 2.0)
    faults: Sequence[Fault] = (*FAULTS, *OF_S3)
    shapes: Sequence[Shape] = SHAPES
    rounds: int = 1
    raylets: Raylets | None = None
    older: Path | None = None
    together: int = 1


def run(
    settings: FarmSettings, folder: Path, postgres: Postgres, s3: Swift, expected: Sequence[bytes], plan: Plan
) -> Outcome:
    """Carry the plan out, wait for the jobs, and look at what is left.

    Args:
        settings: of a new database, and of a new prefix of the bucket or a new folder.
        folder: for the workers' homes and the input.
        expected: bytes that undisturbed jobs of the plan's shapes make.
    """
    asking = Farm(settings, None)
    asking.start()
    chance = random.Random(plan.seed)
    network = BadNetwork(s3.endpoint, chance) if settings.s3_endpoint_url else None
    theirs = settings if network is None else settings.model_copy(update={"s3_endpoint_url": network.endpoint})
    theirs = theirs if plan.raylets is None else _on(theirs, plan.raylets)
    workers = _workers(theirs, folder, plan)
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.wait_up()
    scene = Scene(
        settings, folder, asking, workers, postgres, s3, chance, settings.lease_s, plan.away_s, plan.raylets,
        plan.shapes, network,
    )  # fmt: skip
    over = threading.Event()
    threading.Thread(target=_supervise, args=(workers, over), daemon=True).start()
    try:
        done = _do(scene, plan)
        ended = [with_retries(lambda job=job: _final(asking, job)) for job, _ in scene.jobs]  # type: ignore[misc]
        poisoned = [with_retries(lambda job=job: _final(asking, job)) for job in scene.poisoned]  # type: ignore[misc]
        wanted = [expected[shape] for _, shape in scene.jobs]
        return with_retries(lambda: _judge(asking, ended, wanted, poisoned, done))
    finally:
        over.set()
        for worker in workers:
            worker.thaw()
            worker.kill()
        asking.stop()
        if network is not None:
            network.close()


def _workers(settings: FarmSettings, folder: Path, plan: Plan) -> list[Worker]:
    """Start two workers. With Ray each is a new process, since Ray does not survive a fork."""
    kind = ForkedWorker if plan.raylets is None else Worker
    one, two = (folder / name if settings.blob_url else settings.home for name in ("one", "two"))
    return [kind(settings, one), Worker(settings, two, plan.older) if plan.older else kind(settings, two)]


def _on(settings: FarmSettings, raylets: Raylets) -> FarmSettings:
    changes = {"pool": "ray", "ray_address": raylets.address, "task_memory_bytes": 0, "live_sessions": 0}
    return settings.model_copy(update=changes)


def _supervise(workers: Sequence[Worker], over: threading.Event) -> None:
    while not over.wait(1.0):
        for worker in workers:
            worker.revive()


def submit(farm: Farm, folder: Path, shape: dict[str, Any], key: str = "") -> str:
    """The id of a new job, or of the one accepted with this idempotency key. The first uploads their input."""
    jobs = farm.jobs.page(limit=1).items
    asset = jobs[0].request.inputs["data"] if jobs else _upload(farm, folder)
    return farm.jobs.submit(JobRequest("toy", {"data": asset}, shape, seed=7), idempotency_key=key).id


def _upload(farm: Farm, folder: Path) -> str:
    data = folder / "data.json"
    data.write_text('{"cat": 1}')
    return farm.assets.add(data, "data.json").id


def _do(scene: Scene, plan: Plan) -> Counter[str]:
    """Run the faults in a shuffled order, each about equally often; jobs are submitted before each group."""
    whole = list(plan.faults) * (plan.times // len(plan.faults))
    order = [*whole, *scene.chance.sample(plan.faults, plan.times - len(whole))]
    scene.chance.shuffle(order)
    shapes = [*enumerate(plan.shapes)] * plan.rounds
    for faults in grouped(order, plan.together):
        for number, shape in shapes:
            key = f"job-{len(scene.jobs)}"
            job = with_retries(lambda s=shape, k=key: submit(scene.asking, scene.folder, s, k))  # type: ignore[misc]
            scene.jobs.append((job, number))
        time.sleep(scene.chance.uniform(0.1, 0.8) if plan.shapes is SHAPES else scene.chance.uniform(0.0, 0.2))
        _inject(scene, faults)
        _catch_up(scene, 2 * len(shapes))
    return Counter(fault.__name__ for fault in order)


def grouped(order: Sequence[Fault], together: int) -> Iterator[list[Fault]]:
    """The faults in groups of at most `together`; those of a group are of different components."""
    left = list(order)
    while left:
        group: list[Fault] = []
        for fault in left:
            if len(group) < together and component(fault) not in map(component, group):
                group.append(fault)
        for fault in group:
            left.remove(fault)
        yield group


def _inject(scene: Scene, faults: Sequence[Fault]) -> None:
    """Inject the faults at once, each with its own random numbers."""
    scenes = [replace(scene, chance=random.Random(scene.chance.random())) for _ in faults]
    list(_THREADS.map(lambda fault, own: fault(own), faults, scenes))


def _catch_up(scene: Scene, most: int) -> None:
    """Wait until only about `most` jobs are unfinished, so that faults meet jobs that run and not a long queue."""
    if len(scene.jobs) > most:
        oldest, _ = scene.jobs[-most - 1]
        with_retries(lambda: _final(scene.asking, oldest))


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
    twice += abs(_count(farm) - len(jobs) - len(poisoned))
    farm._collector.sweep()
    kept = {key for job in jobs for key in farm.store.jobs.blob_keys(job.id)}
    mine = {key for job in poisoned for key in farm.blobs.keys(f"jobs/{job.id}/")}
    orphans = len(set(farm.blobs.keys("jobs/")) - kept - mine)
    return Outcome(faults, len(jobs) + len(poisoned), lost, found, found.pop("running", 0), twice, orphans)


def _count(farm: Farm) -> int:
    """Jobs in the store."""
    count, page = 0, farm.jobs.page(limit=200)
    while page.cursor:
        count += len(page.items)
        page = farm.jobs.page(cursor=page.cursor, limit=200)
    return count + len(page.items)


def _failed_as_expected(farm: Farm, job: Job) -> bool:
    """True if one task used all its attempts, each with a log, and results of other tasks are kept."""
    tasks = {task.key: task for task in farm.tasks.page(job.id, limit=200).items}
    bad = tasks["run-1"]
    failures = [attempt for attempt in bad.attempts if attempt["outcome"] == "failed"]
    kept = tasks["run-0"].state == "succeeded"
    return job.state == "failed" and len(failures) == 3 and "keyboard" in farm.tasks.log(bad.id) and kept
