"""The private farm of `impasto render`: a locked folder and local workers in this process, for one job.

Each command line has a folder of its own, so that the same command resumes its own work. The folder holds the farm's
database and blobs. It is locked while a render uses it and removed when the result is delivered. After Ctrl-C, a
failure or a power cut it remains, and the same command continues there. After a power cut, tasks of the last seconds
may run again: their results are on the disk, but perhaps not the database's note of them.
"""

from __future__ import annotations

import dataclasses
import fcntl
import hashlib
import json
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from impasto.cli.console import Interrupted, Show, print_status
from impasto.cli.input_files import InputFile
from impasto.cli.supervisor import pulse
from impasto_client.errors import JobFailed
from pipeline.video.media import MediaInfo
from workers.contract.record import Job, TaskView
from workers.contract.request import JobRequest, Json
from workers.errors import Conflict
from workers.farm import Farm

KEPT_S = 30 * 24 * 3600.0
"""Time after which an interrupted render is deleted, seconds."""


def key_of(facts: Json) -> str:
    """A short name for a command: equal facts (inputs by their SHA-256, parameters, output, ...) give equal names."""
    text = json.dumps(facts, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


@dataclass(frozen=True)
class Workspace:
    """A locked folder of one command."""

    folder: Path

    @property
    def consented(self) -> bool:
        """Whether this command, in this run or an interrupted one, may replace its outputs."""
        return self._marker.exists()

    def consent(self) -> None:
        """Remember that existing outputs may be replaced."""
        self._marker.touch()

    @property
    def _marker(self) -> Path:
        return self.folder / "overwrite"


@contextmanager
def workspace(home: Path, key: str) -> Iterator[Workspace]:
    """The folder for `key` under `home`/renders, locked. Raises Conflict if another process uses it."""
    folder = home / "renders" / key
    folder.mkdir(parents=True, exist_ok=True)
    with _locked(folder) as lock:
        if lock is None:
            raise Conflict(
                "The same render is running in another process.",
                field="home",
                value=folder,
                remedy="Wait for it, stop it, or use another --home.",
            )
        folder.touch()
        yield Workspace(folder)


def forget(folder: Path) -> None:
    """Remove the folder of a render, its files at the same time: a disk may take milliseconds to free each of them."""
    files = [Path(parent) / name for parent, _, names in os.walk(folder) for name in names]
    with ThreadPoolExecutor(_DELETERS, "impasto-deleter") as threads:
        for file in files:
            threads.submit(file.unlink, missing_ok=True)
    shutil.rmtree(folder, ignore_errors=True)


def sweep(home: Path, kept_s: float = KEPT_S) -> None:
    """Remove renders that were interrupted more than `kept_s` seconds ago and never resumed."""
    for folder in (home / "renders").glob("*"):
        if folder.is_dir() and time.time() - folder.stat().st_mtime > kept_s:
            with _locked(folder) as lock:
                if lock is not None:
                    forget(folder)


@contextmanager
def _locked(folder: Path) -> Iterator[IO[bytes] | None]:
    """An exclusive lock that ends with the process; None if another process holds it."""
    with (folder / "lock").open("ab") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield None
        else:
            yield file


_THREADS = 2
"""Number of threads that check and store the inputs."""
_DELETERS = 8
"""Number of threads that remove files."""
_BEAT_S = 0.5
"""Minimum interval of progress updates, seconds: events arrive in bursts, and updates take processor time."""
_POLL_S = 5.0
"""Maximum time between reads of the job without an event, seconds."""


@contextmanager
def opened(home: Path, workers: int) -> Iterator[Farm]:
    """A started farm at `home` with local workers. It is stopped at the end of the block.

    Args:
        workers: tasks at once; 0: as many as the machine has processors and memory for.
    """
    from workers.farm import open_farm
    from workers.process.free_memory import keep_free_memory
    from workers.settings import FarmSettings

    keep_free_memory()
    farm = open_farm(FarmSettings(home=home, pool="local", workers=workers), private=True)
    farm.start()
    try:
        with pulse():
            yield farm
    finally:
        farm.stop()


def submit(
    farm: Farm, request: JobRequest, files: Mapping[str, InputFile], key: str, video: MediaInfo | None = None
) -> Job:
    """Submit the job, or find the one of an interrupted render of the same command; retry it if it had failed.

    Args:
        video: what `probe_guarded` has found of the input "video"; None: it is probed.
    """

    def add(name: str) -> str:
        return farm.assets.add(files[name].path, files[name].filename, known=video if name == "video" else None).id

    with ThreadPoolExecutor(_THREADS, "impasto-inputs") as threads:  # each is decoded and checked in a child process
        added = threads.map(add, files)
        ids = dict(zip(files, added, strict=True))
    job = farm.jobs.submit(dataclasses.replace(request, inputs=ids), idempotency_key=key)
    if job.progress > 0:
        print_status(f"Resuming at {job.progress:.0%}.")
    return farm.jobs.retry(job.id) if job.state in ("failed", "cancelled") else job


def follow(farm: Farm, job_id: str, show: Show) -> Job:
    """Show the job's progress until it ends. Raises: Interrupted (Ctrl-C), JobFailed."""
    last_seq = 0
    try:
        while not (job := farm.jobs.get(job_id)).state.final:
            show(_shown(job))
            last_seq = _wait_for_update(farm, job_id, last_seq)
    except KeyboardInterrupt:
        raise Interrupted(
            f"Interrupted at {farm.jobs.get(job_id).progress:.0%}.", remedy="Run the same command again to resume."
        ) from None
    show(_shown(job))
    if job.state != "succeeded":
        raise _failure(farm, job)
    return job


def _wait_for_update(farm: Farm, job_id: str, last_seq: int) -> int:
    """Wait for the next event, and for those that follow within the interval of updates; not after a change of the
    job's state. Returns the number of the last event."""
    update_at, timeout_s = time.monotonic() + _BEAT_S, _POLL_S
    while timeout_s > 0 and farm.jobs.wait_for_event(job_id, last_seq, timeout_s):
        events, _ = farm.jobs.events(job_id, after=last_seq)
        if not events:
            break
        last_seq = events[-1].seq
        if any(event.type == "job.state" for event in events):
            break
        timeout_s = update_at - time.monotonic()
    return last_seq


def _shown(job: Job) -> Json:
    """The job as a dictionary. `dataclasses.asdict` would copy all its parameters each time."""
    return {**vars(job), "steps": [vars(step) for step in job.steps]}


def _failure(farm: Farm, job: Job) -> JobFailed:
    """The job's error, with the logs of its failed tasks."""
    fault = job.error
    error = JobFailed(
        fault.message if fault else f"The render was {job.state}.",
        field=fault.field if fault else "",
        value=fault.value if fault else None,
        remedy=fault.remedy if fault else "",
    )
    error.code = fault.code if fault else error.code
    error.job = dataclasses.asdict(job)
    error.log = "\n".join(farm.tasks.log(task.id).strip() for task in tasks(farm, job.id, "failed"))
    return error


def tasks(farm: Farm, job_id: str, state: str | None = None) -> Iterator[TaskView]:
    """All tasks of a job, page by page."""
    cursor: str | None = None
    while True:
        page = farm.tasks.page(job_id, state=state, cursor=cursor)
        yield from page.items
        if (cursor := page.cursor) is None:
            return
