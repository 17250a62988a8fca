"""One render without a service: a farm with its workers in this process, opened for one job and closed again."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from impasto.cli.console import Interrupted, say
from impasto.cli.materials import Material
from impasto.cli.progress import Show
from impasto.problems import JobFailed
from workers.farm import Farm
from workers.model import Job, JobRequest, TaskView

_BEAT_S = 0.5
"""Events come in flocks: one look for each flock is enough for the eye, and leaves the processor to the painting."""
_LOOK_S = 5.0
"""When the job is looked at again though nothing has been heard of it."""


@contextmanager
def opened(home: Path, workers: int) -> Iterator[Farm]:
    """A farm at `home` with `workers` local workers, started; stopped at the end, whatever happens."""
    from workers.settings import FarmSettings
    from workers.studio import open_farm

    farm = open_farm(FarmSettings(home=home, pool="local", workers=workers))
    farm.start()
    try:
        yield farm
    finally:
        farm.stop()


def submit(farm: Farm, request: JobRequest, materials: Mapping[str, Material], key: str) -> Job:
    """Submit, or find the job that this very request began before; one that had failed is tried again."""
    ids = {name: farm.add_asset(material.path, material.filename).id for name, material in materials.items()}
    job = farm.submit(dataclasses.replace(request, inputs=ids), idempotency_key=key)
    if job.progress > 0:
        say(f"Going on from {job.progress:.0%}.")
    return farm.retry(job.id) if job.state in ("failed", "cancelled") else job


def follow(farm: Farm, job_id: str, show: Show) -> Job:
    """Show the job until it is over. Raises: Interrupted (Ctrl-C), JobFailed."""
    seen = 0
    try:
        while not (job := farm.job(job_id)).state.final:
            show(_shown(job))
            beat = time.monotonic() + _BEAT_S
            farm.wait(job_id, seen, timeout_s=_LOOK_S)
            events, _ = farm.events(job_id, after=seen)
            seen = events[-1].seq if events else seen
            if all(event.type != "job.state" for event in events):
                time.sleep(max(0.0, beat - time.monotonic()))
    except KeyboardInterrupt:
        raise Interrupted(
            f"Interrupted at {farm.job(job_id).progress:.0%}.", remedy="Run the same command again to go on from there."
        ) from None
    show(_shown(job))
    if job.state != "succeeded":
        raise _failure(farm, job)
    return job


def _shown(job: Job) -> dict[str, Any]:
    """What is shown of a job. Not `dataclasses.asdict`, which copies all its parameters each time."""
    return {**vars(job), "steps": [vars(step) for step in job.steps]}


def _failure(farm: Farm, job: Job) -> JobFailed:
    """Why the job failed, with the end of the log of the task that did."""
    fault = job.error
    error = JobFailed(
        fault.message if fault else f"The render was {job.state}.",
        field=fault.field if fault else "",
        value=fault.value if fault else None,
        remedy=fault.remedy if fault else "",
    )
    error.code = fault.code if fault else error.code
    error.job = dataclasses.asdict(job)
    error.log = "\n".join(farm.task_log(task.id).strip() for task in tasks(farm, job.id, "failed"))
    return error


def tasks(farm: Farm, job_id: str, state: str | None = None) -> Iterator[TaskView]:
    """All tasks of a job, page by page."""
    cursor: str | None = None
    while True:
        page = farm.tasks(job_id, state=state, cursor=cursor)
        yield from page.items
        if (cursor := page.cursor) is None:
            return
