"""What a task of the step `synthesise` does."""

from __future__ import annotations

from pipeline.methods.analogy.keyed import run_piece
from pipeline.methods.analogy.opened import source_of
from pipeline.methods.analogy.plan import Job
from pipeline.methods.analogy.studio import Studio
from pipeline.methods.base import Bench, Note, Task


def run_synthesis(task: Task, bench: Bench) -> Note:
    """One run of one sweep (or all sweeps of coarse levels), frames on their own, or a piece between painted keys."""
    if "piece" in task.args:
        return run_piece(task, bench)
    args = dict(task.args)
    earlier = [(key, Job(**each)) for key, each in args.pop("before", [])]
    job = Job(**args)
    studio = Studio(bench, source_of(bench, job.layer))
    studio.do([*earlier, (task.key, job)])
    return studio.note(job.stop - job.start)
