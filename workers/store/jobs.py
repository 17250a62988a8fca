"""Jobs in the database: accept, show, list, command, forget."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection
from dataclasses import fields

from sqlalchemy import ColumnElement, Connection, Table, bindparam, func, insert, or_, select, text
from sqlalchemy.exc import IntegrityError

from pipeline.errors import BadParameter
from workers.contract.record import Job, Page, RunState, Submitted, TaskState
from workers.contract.request import MAX_PRIORITY, JobRequest
from workers.errors import Conflict, IdempotencyMismatch, NotFound, QuotaExceeded
from workers.ids import new_id
from workers.jobs import state_machine as machine
from workers.jobs.job_warnings import merged_warnings
from workers.store import bulk, schema, task_states
from workers.store.accepted_job import Accepted, step_rows
from workers.store.base import StorePart
from workers.store.event_notifier import GONE
from workers.store.job_transaction import JobTransaction
from workers.store.job_views import job_views
from workers.store.queue_position import MethodAhead, ahead
from workers.store.records import Row, Values, pack_cursor, request_to_json, unpack_cursor
from workers.store.state_counts import CountChanges
from workers.version import version

ACTIVE_JOBS = select(func.count()).select_from(
    select(schema.jobs.c.id)
    .where(schema.jobs.c.owner == bindparam("owner"), text(schema.UNFINISHED_TEXT))
    .limit(bindparam("most"))
    .subquery()
)
"""Number of unfinished jobs of an owner, counted up to `most`."""
MOST_COUNTED = 10_000
"""Maximum number of unfinished jobs that are counted to show them."""
_JOB = select(schema.jobs).where(schema.jobs.c.id == bindparam("id"))


class Jobs(StorePart):
    """Jobs by id. Every method is one transaction."""

    def made_by(self, request: JobRequest, owner: str, idempotency_key: str) -> Submitted | None:
        """The earlier job of the same owner, key and request, if any. Raises IdempotencyMismatch."""
        with self._db.read() as connection:
            job_id = _by_key(connection, owner, idempotency_key, _digest(request))
        return None if job_id is None else self._submitted(job_id, new=False)

    def _submitted(self, job_id: str, new: bool) -> Submitted:
        job = self.get(job_id)
        return Submitted(**{field.name: getattr(job, field.name) for field in fields(Job)}, new=new)

    def add(
        self, accepted: Accepted, owner: str, idempotency_key: str = "", max_active: int | None = None,
        base_id: str | None = None,
    ) -> Submitted:  # fmt: skip
        """Accept a job durably. The same owner, key and request return the earlier job.

        Args:
            max_active: unfinished jobs that the owner may have, this one included; None: any number. Counted in the
                transaction that adds the job, so that concurrent requests cannot exceed it.
            base_id: id of the earlier job whose results are reused if nothing has changed; empty: none, but results of
                this job are kept for reuse; None: neither.

        Raises:
            IdempotencyMismatch: the key came with another request.
            NotFound: an input's asset no longer exists.
            QuotaExceeded: the owner has `max_active` unfinished jobs.
        """
        digest = _digest(accepted.request)
        try:
            with self._db.write() as connection:
                known = _by_key(connection, owner, idempotency_key, digest)
                if known is None:
                    self._check_quota(connection, owner, max_active)
                job_id = known or self._insert(connection, accepted, owner, idempotency_key, digest, base_id)
        except IntegrityError:  # another process accepted the same key between our query and our insert
            with self._db.read() as connection:
                known = _by_key(connection, owner, idempotency_key, digest)
            if known is None:
                raise
            job_id = known
        self._notifier.notify(job_id, 1)
        return self._submitted(job_id, new=known is None)

    def _check_quota(self, connection: Connection, owner: str, max_active: int | None) -> None:
        if max_active is None:
            return
        self._db.lock(connection, f"jobs of {owner}")
        active = int(connection.execute(ACTIVE_JOBS, {"owner": owner, "most": max_active}).scalar_one())
        if active >= max_active:
            raise QuotaExceeded(
                f"You may have at most {max_active} unfinished jobs.",
                field="active_jobs",
                value=max_active,
                remedy="Wait until one ends, or cancel one.",
            )

    def _check_reopening(self, job: JobTransaction, max_active: int | None) -> None:
        """Check the quota before an ended job becomes active again."""
        if RunState(job.row["state"]).final:
            self._check_quota(job.connection, job.row["owner"], max_active)

    def get(self, job_id: str) -> Job:
        with self._db.read() as connection:
            found = connection.execute(_JOB, {"id": job_id}).mappings().all()
            if not found:
                raise NotFound(f"There is no job {job_id}.", field="job", value=job_id)
            return job_views(connection, found)[0]

    def ahead(self, job_id: str) -> list[MethodAhead]:
        """Jobs that are served before this one, by method, see `queue_position`. Raises NotFound."""
        with self._db.read() as connection:
            own = connection.execute(_JOB, {"id": job_id}).mappings().first()
            if own is None:
                raise NotFound(f"There is no job {job_id}.", field="job", value=job_id)
            return ahead(connection, own)

    def page(
        self,
        state: str | None = None,
        method: str | None = None,
        owner: str | None = None,
        label: tuple[str, str] | None = None,
        cursor: str | None = None,
        limit: int = 50,
        search: str = "",
    ) -> Page:
        """Newest first.

        Args:
            state: a `RunState`, or "active": any that is not final.
            search: words; each must be contained in the name, the method, the owner or a label as name:value, or begin
                the id. The case of the letters a to z does not matter.
        """
        table = schema.jobs
        where = _filters(state, method, owner, label) + [_named(word) for word in search.split()]
        if cursor is not None:
            where.append(table.c.id < unpack_cursor(cursor, str)[0])
        query = select(table).where(*where).order_by(table.c.id.desc()).limit(limit + 1)
        with self._db.read() as connection:
            rows = connection.execute(query).mappings().all()
            items = job_views(connection, rows[:limit])
        return Page(tuple(items), pack_cursor(items[-1].id) if len(rows) > limit else None)

    def command(self, job_id: str, event: machine.Pause | machine.Resume | machine.Cancel) -> Job:
        """Pause, resume or cancel. Raises Conflict."""
        with self._transaction(job_id) as job:
            job.apply(event)
        return self.get(job_id)

    def prioritise(self, job_id: str, priority: int | None) -> Job:
        """Give an unfinished job another priority; None: one above all other unfinished jobs, at most 100.

        Raises: Conflict (the job has ended), NotFound.
        """
        with self._transaction(job_id) as job:
            if RunState(job.row["state"]).final:
                raise Conflict("The job has ended.", field="state", value=job.row["state"], remedy="Retry it first.")
            if priority is None:
                others = select(func.max(schema.jobs.c.priority)).where(
                    schema.jobs.c.id != job_id, text(schema.UNFINISHED_TEXT)
                )
                highest = job.connection.execute(others).scalar()
                priority = min(
                    MAX_PRIORITY, max(job.row["priority"], -MAX_PRIORITY if highest is None else highest + 1)
                )
            job.prioritise(priority)
        return self.get(job_id)

    def retry(self, job_id: str, max_active: int | None = None) -> Job:
        """Start failed and cancelled tasks again.

        Args:
            max_active: unfinished jobs that the owner may have, this one included; None: any number.

        Raises: Conflict, NotFound (an input was deleted since), QuotaExceeded.
        """
        with self._transaction(job_id) as job:
            self._check_reopening(job, max_active)
            _need_assets(job.connection, job.row["request"]["inputs"])
            blocked = _blocked(job.connection, job_id, RunState(job.row["state"]))
            job.apply(machine.Retry(blocked[TaskState.FAILED], blocked[TaskState.CANCELLED]))
        return self.get(job_id)

    def requeue(self, task_id: str, max_active: int | None = None) -> None:
        """Start one failed or cancelled task again. Arguments and errors: as `retry`."""
        with self._db.read() as connection:
            job_id = _job_of_task(connection, task_id)
        with self._transaction(job_id) as job:
            self._check_reopening(job, max_active)
            _need_assets(job.connection, job.row["request"]["inputs"])
            job.write_task_states()
            task = job.task(task_id)
            job.apply(machine.Requeue(), task)
            job.delay(task, 0.0)
            job.add_task_event(task, TaskState.READY)

    def remove(self, job_id: str) -> None:
        """Delete a final job. Raises Conflict if it is not final."""
        with self._transaction(job_id) as job:
            bulk.remove(job)
        self._notifier.notify(job_id, GONE)

    def labelled(self, name: str, values: Collection[str]) -> set[str]:
        """Those of the values that jobs have as a label of this name."""
        labels = schema.job_labels
        query = select(labels.c.value).where(labels.c.name == name, labels.c.value.in_(list(values))).distinct()
        with self._db.read() as connection:
            return set(connection.execute(query).scalars())

    def exists(self, job_id: str) -> bool:
        return self._state(job_id) is not None

    def succeeded(self, job_id: str) -> bool:
        return self._state(job_id) == RunState.SUCCEEDED.value

    def _state(self, job_id: str) -> str | None:
        with self._db.read() as connection:
            return connection.execute(select(schema.jobs.c.state).where(schema.jobs.c.id == job_id)).scalar()

    def file(self, job_id: str, name: str) -> Row | None:
        """The row of a job's file: key, media_type."""
        files = schema.files
        query = select(files).where(files.c.job_id == job_id, files.c.name == name)
        with self._db.read() as connection:
            return connection.execute(query).mappings().first()

    def blob_keys(self, job_id: str) -> set[str]:
        """Blobs that a user can still download; none if the job was deleted."""
        with self._db.read() as connection:
            return set(connection.execute(select(schema.files.c.key).where(schema.files.c.job_id == job_id)).scalars())

    def _insert(
        self, connection: Connection, accepted: Accepted, owner: str, key: str, digest: str, base_id: str | None
    ) -> str:
        request, now, job_id = accepted.request, self._now(), new_id("job_")
        _need_assets(connection, request.inputs)
        row = {
            "id": job_id,
            "owner": owner,
            "method": request.method,
            "state": RunState.QUEUED.value,
            "priority": request.priority,
            "request": request_to_json(request),
            "params": accepted.params,
            "step": 0,
            "step_count": len(accepted.steps),
            "planned": False,
            "doomed": False,
            "last_seq": 1,
            "idempotency_key": key or None,
            "digest": digest,
            "base_id": base_id,
            "versions": list(accepted.versions),
            "warnings": merged_warnings([], accepted.warnings) or None,
            "planned_by": version(),
            "created_at": now,
            "updated_at": now,
        }
        connection.execute(insert(schema.jobs).values(row))
        _insert_all(connection, schema.steps, step_rows(job_id, accepted))
        _insert_all(connection, schema.job_inputs, _pairs(job_id, request.inputs, "asset_id"))
        _insert_all(connection, schema.job_labels, _pairs(job_id, request.labels, "value"))
        born = {"job_id": job_id, "seq": 1, "at": now, "type": "job.state", "data": {"state": "queued", "error": None}}
        connection.execute(insert(schema.events).values(born))
        added = CountChanges()
        added.job(RunState.QUEUED.value, 1)
        added.write(connection, job_id)
        return job_id


def _digest(request: JobRequest) -> str:
    return hashlib.sha256(json.dumps(request_to_json(request), sort_keys=True).encode()).hexdigest()


def _by_key(connection: Connection, owner: str, key: str, digest: str) -> str | None:
    """The job that was accepted under an idempotency key, if any."""
    if not key:
        return None
    table = schema.jobs
    query = select(table.c.id, table.c.digest).where(table.c.owner == owner, table.c.idempotency_key == key)
    row = connection.execute(query).first()
    if row is None:
        return None
    if row.digest != digest:
        raise IdempotencyMismatch(
            "This idempotency key came with another request before.",
            field="Idempotency-Key",
            value=key,
            remedy="Use a new key for a new request.",
        )
    return str(row.id)


def _need_assets(connection: Connection, inputs: dict[str, str]) -> None:
    """Lock the assets, so that they exist until this transaction ends. Raises NotFound."""
    table = schema.assets
    query = select(table.c.id).where(table.c.id.in_(inputs.values())).with_for_update(read=True)
    known = set(connection.execute(query).scalars())
    for name, asset_id in inputs.items():
        if asset_id not in known:
            raise NotFound(
                f"There is no asset {asset_id}.", field=f"inputs.{name}", value=asset_id, remedy="Upload it first."
            )


def _filters(
    state: str | None, method: str | None, owner: str | None, label: tuple[str, str] | None
) -> list[ColumnElement[bool]]:
    table, labels = schema.jobs, schema.job_labels
    where: list[ColumnElement[bool]] = []
    if state == "active":
        where.append(table.c.state.in_([one.value for one in RunState if not one.final]))
    elif state is not None:
        where.append(table.c.state == known_state(RunState, state))
    if method is not None:
        where.append(table.c.method == method)
    if owner is not None:
        where.append(table.c.owner == owner)
    if label is not None:
        named = select(labels.c.job_id).where(labels.c.name == label[0], labels.c.value == label[1])
        where.append(table.c.id.in_(named))
    return where


def _named(word: str) -> ColumnElement[bool]:
    """Condition: name, method, owner or a label as name:value contains a word, or the id begins with it."""
    table, labels = schema.jobs, schema.job_labels
    label = labels.c.name + ":" + labels.c.value
    labelled = select(labels.c.job_id).where(label.icontains(word, autoescape=True))
    return or_(
        table.c.request["name"].as_string().icontains(word, autoescape=True),
        table.c.method.icontains(word, autoescape=True),
        table.c.owner.icontains(word, autoescape=True),
        table.c.id.istartswith(word, autoescape=True),
        table.c.id.in_(labelled),
    )


def known_state(states: type[RunState] | type[TaskState], state: str) -> str:
    try:
        return states(state).value
    except ValueError:
        remedy = f"Use one of: {', '.join(states)}."
        raise BadParameter(f"There is no state {state!r}.", field="state", value=state, remedy=remedy) from None


def _blocked(connection: Connection, job_id: str, job: RunState) -> dict[TaskState, int]:
    """Number of failed and of cancelled tasks that still wait for others."""
    return {state: _count_blocked(connection, job_id, job, state) for state in (TaskState.FAILED, TaskState.CANCELLED)}


def _count_blocked(connection: Connection, job_id: str, job: RunState, state: TaskState) -> int:
    tasks = schema.tasks
    stored = [each.value for each in task_states.stored_as(state, job)]
    where = (tasks.c.job_id == job_id, tasks.c.state.in_(stored), tasks.c.blockers > 0)
    return int(connection.execute(select(func.count()).select_from(tasks).where(*where)).scalar_one())


def _job_of_task(connection: Connection, task_id: str) -> str:
    job_id = connection.execute(select(schema.tasks.c.job_id).where(schema.tasks.c.id == task_id)).scalar()
    if job_id is None:
        raise NotFound(f"There is no task {task_id}.", field="task", value=task_id)
    return str(job_id)


def _pairs(job_id: str, values: dict[str, str], column: str) -> list[Values]:
    return [{"job_id": job_id, "name": name, column: value} for name, value in values.items()]


def _insert_all(connection: Connection, table: Table, rows: list[Values]) -> None:
    if rows:
        connection.execute(insert(table), rows)
