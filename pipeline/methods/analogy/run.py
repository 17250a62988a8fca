"""What a task of the step `synthesise` does."""

from __future__ import annotations

from pipeline.methods.analogy.keyed import run_piece
from pipeline.methods.analogy.opened import source_of
from pipeline.methods.analogy.plan import Job
from pipeline.methods.analogy.studio import Studio
from pipeline.methods.base import Bench, Note, Task


def run_synthesis(task: Task, bench: Bench) -> Note:
    """One run of one sweep, frames on their own, or a piece between painted keys."""
    if "piece" in task.args:
        return run_piece(task, bench)
    job = Job(**task.args)
    studio = Studio(bench, source_of(bench, job.layer))
    if job.level < 0:
        studio.alone(job)
    elif job.level >= studio.levels:
        studio.pass_on(task.key)
    else:
        studio.sweep(task.key, job)
    return {"frames": job.stop - job.start}
