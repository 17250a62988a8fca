"""Results of finished tasks that later jobs of the same project may reuse, and the blobs that must be kept for that.

A job of a project names the job on which it is based: the newest one that succeeded for the same shot, variant, method
and piece of the video. The tasks of that job are the cache: see `workers.execution.reuse`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from sqlalchemy import and_, select, text

from workers.contract.order import EarlierTask
from workers.contract.record import RunState
from workers.store import schema
from workers.store.base import StorePart

GRACE_S = 600.0
"""Additional time for which blobs of a replaced or too old job are kept, for jobs that have been submitted in the
meantime."""


class Reuse(StorePart):
    """Read-only."""

    def base(
        self,
        project_id: str,
        shot: str,
        variant: str | None,
        method: str,
        frames: tuple[int, int] | None,
        within_s: float,
    ) -> str | None:
        """The newest job that succeeded for this shot, variant, method and piece within the last `within_s` seconds."""
        span = None if frames is None else list(frames)
        for row in self._finished(within_s, project_id):
            wanted = (row.shot, row.variant, row.method, row.request.get("frames")) == (shot, variant, method, span)
            if wanted:
                return str(row.id)
        return None

    def _finished(self, within_s: float, project_id: str | None = None) -> list[Any]:
        """Succeeded jobs of projects, newest first."""
        jobs, of = schema.jobs, schema.project_jobs
        query = (
            select(
                of.c.project_id, of.c.shot, of.c.variant, jobs.c.id, jobs.c.method, jobs.c.request, jobs.c.finished_at
            )
            .join(jobs, jobs.c.id == of.c.job_id)
            .where(jobs.c.state == RunState.SUCCEEDED.value, jobs.c.finished_at > self._now() - within_s)
            .order_by(jobs.c.finished_at.desc(), jobs.c.id.desc())
        )
        if project_id is not None:
            query = query.where(of.c.project_id == project_id)
        with self._db.read() as connection:
            return list(connection.execute(query))

    def earlier(self, job_id: str, step: str) -> dict[str, EarlierTask]:
        """Finished tasks of a step of a job that can be reused, by key."""
        tasks, steps = schema.tasks, schema.steps
        query = (
            select(tasks.c.key, tasks.c.trace, tasks.c.result, tasks.c.artefacts, tasks.c.segment)
            .join(steps, and_(steps.c.job_id == tasks.c.job_id, steps.c.step == tasks.c.step))
            .where(tasks.c.job_id == job_id, steps.c.name == step, tasks.c.trace.is_not(None))
        )
        with self._db.read() as connection:
            return {
                row.key: EarlierTask(row.trace, row.result or {}, row.artefacts or {}, row.segment)
                for row in connection.execute(query)
            }

    def is_shared(self, job_id: str) -> bool:
        """Whether other jobs may use blobs of this job, because it belongs to a project."""
        query = select(schema.project_jobs.c.job_id).where(schema.project_jobs.c.job_id == job_id).limit(1)
        with self._db.read() as connection:
            return connection.execute(query).first() is not None

    def kept_keys(self, within_s: float) -> set[str]:
        """Keys of the blobs of tasks that must be kept for reuse.

        Kept are those of the newest job of each shot, variant, method and piece; of unfinished jobs that are based on
        another; and of the jobs on which these are based. `within_s`: as for `base`; 0: only the blobs that unfinished
        jobs use.
        """
        kept = set(self._bases())
        newest: dict[object, float] = {}
        for row in self._finished(within_s + GRACE_S) if within_s > 0 else []:
            group = (row.project_id, row.shot, row.variant, row.method, str(row.request.get("frames")))
            if newest.get(group, self._now()) > self._now() - GRACE_S:
                kept.add(row.id)
            newest[group] = row.finished_at
        return set(self._task_keys(kept))

    def _bases(self) -> Iterator[str]:
        jobs = schema.jobs
        query = select(jobs.c.id, jobs.c.base_id).where(text(schema.UNFINISHED_TEXT), jobs.c.base_id.is_not(None))
        with self._db.read() as connection:
            for row in connection.execute(query):
                yield from filter(None, row)

    def _task_keys(self, job_ids: Iterable[str]) -> Iterator[str]:
        tasks = schema.tasks
        with self._db.read() as connection:
            for job_id in sorted(job_ids):
                query = select(tasks.c.artefacts, tasks.c.segment).where(tasks.c.job_id == job_id)
                for artefacts, segment in connection.execute(query):
                    yield from (artefacts or {}).values()
                    if segment:
                        yield segment
