"""The same command about several jobs in one transaction: two hundred take as long as a few alone."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager

from sqlalchemy import bindparam, select

from pipeline.errors import ImpastoError
from workers.contract.record import RunState
from workers.errors import Conflict, NotFound
from workers.jobs import state_machine as machine
from workers.store import schema
from workers.store.base import StorePart
from workers.store.event_notifier import GONE
from workers.store.job_transaction import JobTransaction

Refused = dict[str, ImpastoError]
"""Ids of jobs for which the command was refused, with the reasons."""
_LOCKED = (
    select(schema.jobs)
    .where(schema.jobs.c.id.in_(bindparam("ids", expanding=True)))
    .order_by(schema.jobs.c.id)
    .with_for_update()
)


class Bulk(StorePart):
    """Every method is one transaction. Keep the number of jobs bounded: others wait for their locks."""

    def command(self, job_ids: Collection[str], event: machine.Pause | machine.Resume | machine.Cancel) -> Refused:
        """Pause, resume or cancel. If it is refused for one job, it is still done for the others."""
        return self._each(job_ids, lambda job: _apply(job, event))

    def remove(self, job_ids: Collection[str]) -> Refused:
        """Delete final jobs."""
        refused = self._each(job_ids, remove)
        for job_id in job_ids:
            if job_id not in refused:
                self._notifier.notify(job_id, GONE)
        return refused

    def _each(self, job_ids: Collection[str], act: Callable[[JobTransaction], None]) -> Refused:
        with self._locked(job_ids) as jobs:
            refused: Refused = {job_id: _unknown(job_id) for job_id in job_ids if job_id not in jobs}
            for job_id, job in jobs.items():
                try:
                    act(job)
                except Conflict as error:  # raised before anything was written
                    refused[job_id] = error
        return refused

    @contextmanager
    def _locked(self, job_ids: Collection[str]) -> Iterator[dict[str, JobTransaction]]:
        """The jobs that exist, locked in the order of their ids, so that transactions never wait for each other."""
        with self._db.write() as connection:
            rows = connection.execute(_LOCKED, {"ids": list(job_ids)}).mappings().all()
            jobs = {row["id"]: JobTransaction(connection, row, self._now(), self._policy) for row in rows}
            yield jobs
            JobTransaction.close_all(list(jobs.values()))
        for job_id, job in jobs.items():
            if job.changed:
                self._notifier.notify(job_id, job.seq)


def remove(job: JobTransaction) -> None:
    """Delete the job. Raises Conflict if it is not final."""
    if not RunState(job.row["state"]).final:
        raise Conflict("The job has not ended.", field="state", value=job.row["state"], remedy="Cancel it first.")
    job.remove()


def _apply(job: JobTransaction, event: machine.StateEvent) -> None:
    job.apply(event)


def _unknown(job_id: str) -> NotFound:
    return NotFound("Job not found.", field="job_id", value=job_id, remedy="See GET /v1/jobs for yours.")
