"""Faults injected into real components. Faults of different components may be injected together."""

from __future__ import annotations

import os
import random
import resource
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from tests.chaos.bad_network import BadNetwork, Mode
from tests.chaos.limits import address_space, limited, open_files
from tests.chaos.raylets import Raylets
from tests.chaos.retries import RETRY_S, with_retries
from tests.real.postgres import Postgres
from tests.real.swift import Swift
from tests.workers.hangs import HANGS
from tests.workers.real_farm import Accepting, Worker
from workers.contract.order import TaskOutcome
from workers.contract.request import JobRequest
from workers.farm import Farm
from workers.settings import FarmSettings
from workers.store import Store

Shape = dict[str, Any]
TINY: tuple[Shape, ...] = ({"tasks": 1}, {"tasks": 1}, {"tasks": 2, "chain": True}, {"tasks": 2})
"""Parameters of jobs of three or four tasks that take no time: thousands of them in an hour."""
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
    """The components into which faults can be injected, and the jobs of the run."""

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
    shapes: Sequence[Shape] = SHAPES
    """Parameters of the jobs."""
    network: BadNetwork | None = None
    """Between the workers and S3."""
    jobs: list[tuple[str, int]] = field(default_factory=list)
    """Accepted jobs with their shapes: each must succeed."""
    poisoned: list[str] = field(default_factory=list)
    """Accepted jobs with a task that always fails: each must fail and keep the results of its other tasks."""

    def away(self) -> None:
        time.sleep(self.chance.uniform(*self.away_s))


def kill_worker(scene: Scene) -> None:
    """kill -9 of one farm; another is started in its home."""
    chosen = scene.chance.choice(scene.workers)
    chosen.kill()
    chosen.start()


def kill_all_workers(scene: Scene) -> None:
    """Kill every farm at once, as when a machine loses power."""
    for worker in scene.workers:
        worker.kill()
    for worker in scene.workers:
        worker.start()


def freeze_worker(scene: Scene) -> None:
    """Stop a farm for longer than its lease, then continue it: it sends late answers."""
    chosen = scene.chance.choice(scene.workers)
    chosen.freeze()
    time.sleep(scene.lease_s + 1)
    chosen.thaw()


def crash_postgres(scene: Scene) -> None:
    """Kill PostgreSQL without a clean shutdown; it recovers when it starts again."""
    scene.postgres.stop(signal.SIGQUIT)
    scene.away()
    scene.postgres.start()


def stop_postgres(scene: Scene) -> None:
    """Stop PostgreSQL for a while; all connections are cut."""
    scene.postgres.stop(signal.SIGINT)
    scene.away()
    scene.postgres.start()


def freeze_postgres(scene: Scene) -> None:
    """Freeze PostgreSQL: it accepts requests and answers none."""
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
    """Kill S3: its port refuses connections."""
    scene.s3.stop()
    scene.away()
    scene.s3.start()


def answer_again(scene: Scene) -> None:
    """Send a second, different answer for every ended attempt: all of them must be refused."""
    with_retries(lambda: _answer_again(scene.asking.store))


def _answer_again(store: Store) -> bool:
    for job in store.jobs.page(limit=6).items:
        for task in store.tasks.page(job.id, limit=200).items:
            for attempt in task.attempts:
                if attempt["outcome"] != "running":
                    wrong = TaskOutcome(attempt["id"], {"wrong": 1}, {}, {"result": ("wrong", "x/y")}, "wrong", {}, "")
                    assert not store.queue.finish(wrong), "a duplicate was taken"
    return True


def kill_accepting(scene: Scene) -> None:
    """kill -9 of a process while it accepts jobs: acknowledged jobs must exist, others are accepted once on retry."""
    asset = _asset(scene)
    accepting = Accepting(scene.settings, scene.folder / f"accepting-{len(scene.jobs)}")
    _start(accepting)
    threading.Timer(scene.chance.uniform(0.1, 0.8), accepting.kill).start()
    for number in range(100):
        shape, key = number % len(scene.shapes), f"{len(scene.jobs)}-{number}"
        answered = accepting.submit(asset, scene.shapes[shape], key)
        if not answered or number == 0:
            request = JobRequest("toy", {"data": asset}, scene.shapes[shape], seed=7)
            again = with_retries(lambda r=request, k=key: scene.asking.jobs.submit(r, idempotency_key=k)).id  # type: ignore[misc]
            assert not answered or again == answered, "accepted, and then lost"
        scene.jobs.append((answered or again, shape))
        if not answered:
            break
    accepting.kill()


def step_clock(scene: Scene) -> None:
    """Set the clock of a machine an hour ahead, and later back."""
    chosen = scene.chance.choice(scene.workers)
    chosen.step_clock()
    time.sleep(scene.chance.uniform(0.5, scene.lease_s))
    chosen.step_clock()


def fill_disk(scene: Scene) -> None:
    """Fill a worker's disk for a while. The disk is a small one made for the test; only root can make it."""
    chosen = scene.workers[-1]
    chosen.kill()
    with small_disk(scene.folder / f"small-{len(scene.jobs)}") as disk:
        narrow = Worker(scene.settings.model_copy(update={"reserve_bytes": RESERVE_BYTES}), disk / "home")
        _start(narrow)
        usage = os.statvfs(disk)
        (disk / "filler").write_bytes(bytes(usage.f_bavail * usage.f_frsize))
        scene.away()
        (disk / "filler").unlink()
        time.sleep(1)
        narrow.kill()
    chosen.start()


@contextmanager
def small_disk(place: Path) -> Iterator[Path]:
    """A file system of `DISK_BYTES`."""
    place.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "none", str(place)], check=True)
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def cut_connections(scene: Scene) -> None:
    """Let PostgreSQL end every connection, some in the middle of a transaction or a commit; then once more."""
    for _ in range(scene.chance.randint(1, 4)):
        scene.postgres.execute(_CUT)
        time.sleep(scene.chance.uniform(0.0, 0.2))


def restart_postgres(scene: Scene) -> None:
    """Simulate a fail-over: connections are cut, and the same address answers again a moment later."""
    scene.postgres.stop(signal.SIGINT)
    scene.postgres.start()


def exhaust_descriptors(scene: Scene) -> None:
    """Let a worker open no more files for a while."""
    if (pid := scene.chance.choice(scene.workers).pid) is not None:
        with limited(pid, resource.RLIMIT_NOFILE, open_files(pid)):
            scene.away()


def exhaust_memory(scene: Scene) -> None:
    """Limit the growth of a worker's address space for a while."""
    if (pid := scene.chance.choice(scene.workers).pid) is not None:
        with limited(pid, resource.RLIMIT_AS, address_space(pid) + (1 << 20)):
            scene.away()


def spoil_s3(scene: Scene) -> None:
    """Spoil half of the connections to S3: 503, latency, truncated answers, or no answer."""
    assert scene.network is not None
    for mode in scene.chance.sample(_MODES, 2):
        scene.network.mode = mode
        scene.away()
    scene.network.mode = ""


_MODES: tuple[Mode, ...] = ("503", "slow", "truncate", "reset")
_CUT = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE application_name = 'impasto'"


def poison(scene: Scene) -> None:
    """Submit a job with a task that always fails."""
    params = {**max(scene.shapes, key=lambda shape: shape["tasks"]), "trouble": "raise", "chain": False}
    request = JobRequest("toy", {"data": _asset(scene)}, params, seed=7)
    key = f"poisoned-{len(scene.poisoned)}"
    scene.poisoned.append(with_retries(lambda: scene.asking.jobs.submit(request, idempotency_key=key)).id)


def spin_in_python(scene: Scene) -> None:
    """A library spins in a loop of Python."""
    _hang(scene, "spin_in_python")


def sleep_in_python(scene: Scene) -> None:
    """A library waits in Python for something that never comes."""
    _hang(scene, "sleep_in_python")


def spin_in_native_code(scene: Scene) -> None:
    """Native code spins, with or without the interpreter lock."""
    _hang(scene, scene.chance.choice([name for name in HANGS if name.startswith("spin_in_native")]))


def sleep_in_native_code(scene: Scene) -> None:
    """Native code sleeps, with or without the interpreter lock."""
    _hang(scene, scene.chance.choice([name for name in HANGS if name.startswith("sleep_in_native")]))


def _hang(scene: Scene, trouble: str) -> None:
    """Submit a job with a task whose first attempt hangs: it must succeed like the others of its shape."""
    number, shape = next((n, shape) for n, shape in enumerate(scene.shapes) if shape["tasks"] > 1)
    key = f"hang-{len(scene.jobs)}"
    params = {**shape, "trouble": trouble, "mark": str(scene.folder / key)}
    request = JobRequest("toy", {"data": _asset(scene)}, params, seed=7)
    scene.jobs.append((with_retries(lambda: scene.asking.jobs.submit(request, idempotency_key=key)).id, number))


def _asset(scene: Scene) -> str:
    """Id of the jobs' input."""
    return with_retries(lambda: scene.asking.jobs.page(limit=1).items[0].request.inputs["data"])


def _start(worker: Worker) -> None:
    """Start a component; start it again if it has ended because the database was down, as systemd would."""
    deadline = time.monotonic() + RETRY_S
    worker.start()
    while not worker.came_up():
        assert time.monotonic() < deadline, "the worker did not start"
        worker.start()


def kill_node(scene: Scene) -> None:
    """kill -9 of a Ray node and everything that runs there; another node joins."""
    assert scene.raylets is not None
    scene.raylets.kill_node(scene.chance)


def kill_actor(scene: Scene) -> None:
    """kill -9 of an actor that runs a task."""
    assert scene.raylets is not None
    scene.raylets.kill_actor(scene.chance)


Fault = Callable[[Scene], None]
TO_WORKERS: tuple[Fault, ...] = (
    kill_worker,
    kill_all_workers,
    freeze_worker,
    step_clock,
    exhaust_descriptors,
    exhaust_memory,
)
TO_POSTGRES: tuple[Fault, ...] = (crash_postgres, stop_postgres, freeze_postgres, cut_connections, restart_postgres)
TO_CALLERS: tuple[Fault, ...] = (kill_accepting, answer_again, poison)
TO_TASKS: tuple[Fault, ...] = (spin_in_python, sleep_in_python, spin_in_native_code, sleep_in_native_code)
FAULTS = (*TO_WORKERS, *TO_POSTGRES, *TO_CALLERS, *TO_TASKS)
OF_S3: tuple[Fault, ...] = (stop_objects, kill_s3, spoil_s3)
"""Additional faults if blobs are in S3."""
OF_A_CLUSTER: tuple[Fault, ...] = (kill_node, kill_actor)
"""Additional faults if tasks run on Ray."""
OF_ROOT: tuple[Fault, ...] = (fill_disk,)
"""Additional faults if the process may mount file systems."""
BY_NAME = {fault.__name__: fault for fault in (*FAULTS, *OF_S3, *OF_A_CLUSTER, *OF_ROOT)}
_COMPONENTS = ((*TO_WORKERS, *OF_ROOT), TO_POSTGRES, TO_CALLERS, TO_TASKS, OF_S3, OF_A_CLUSTER)


def component(fault: Fault) -> int:
    """Number of the component that the fault affects; a component has one fault at a time."""
    return next(number for number, faults in enumerate(_COMPONENTS) if fault in faults)
