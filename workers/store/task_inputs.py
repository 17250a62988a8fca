"""Inputs of a task: results, artefacts and emitted runs of earlier tasks, and the assets of its job."""

from __future__ import annotations

from collections.abc import Mapping

from sqlalchemy import and_, bindparam, select

from workers.contract.request import Json
from workers.errors import NotFound
from workers.store import schema
from workers.store.base import StorePart

_WAITING = select(schema.task_edges.c.task_id).where(schema.task_edges.c.before_id == bindparam("task_id")).limit(1)


class TaskInputs(StorePart):
    """Read-only. The data of finished steps never changes."""

    def before(self, job_id: str, step: int) -> tuple[dict[str, dict[str, Json]], dict[str, str]]:
        """Results (step -> key -> result) and artefacts ("step/name" -> blob key) of the steps before `step`. Every
        step has an entry, also one that had no tasks."""
        tasks, steps = schema.tasks, schema.steps
        query = (
            select(steps.c.name, tasks.c.key, tasks.c.result, tasks.c.artefacts)
            .join(steps, and_(steps.c.job_id == tasks.c.job_id, steps.c.step == tasks.c.step))
            .where(tasks.c.job_id == job_id, tasks.c.step < step)
            .order_by(tasks.c.position)
        )
        names = select(steps.c.name).where(steps.c.job_id == job_id, steps.c.step < step).order_by(steps.c.step)
        artefacts: dict[str, str] = {}
        with self._db.read() as connection:
            results: dict[str, dict[str, Json]] = {name: {} for name in connection.execute(names).scalars()}
            for name, key, result, made in connection.execute(query):
                results[name][key] = result or {}
                artefacts.update(made or {})
        return results, artefacts

    def chain(self, task_id: str) -> tuple[tuple[str, ...], dict[str, str]]:
        """The task's `after` in plan order, and the artefacts ("step/name" -> blob key) that those tasks have saved."""
        tasks, steps, edges, own = schema.tasks, schema.steps, schema.task_edges, schema.tasks.alias("own")
        query = (
            select(tasks.c.key, tasks.c.artefacts, steps.c.name, (tasks.c.step == own.c.step).label("same_step"))
            .join(edges, edges.c.before_id == tasks.c.id)
            .join(own, own.c.id == edges.c.task_id)
            .join(steps, and_(steps.c.job_id == tasks.c.job_id, steps.c.step == tasks.c.step))
            .where(edges.c.task_id == task_id)
            .order_by(tasks.c.position)
        )
        with self._db.read() as connection:
            found = connection.execute(query).all()
        artefacts = {name: key for row in found for name, key in (row.artefacts or {}).items()}
        return tuple(row.key if row.same_step else f"{row.name}/{row.key}" for row in found), artefacts

    def has_dependents(self, task_id: str) -> bool:
        """Whether other tasks wait for this one."""
        with self._db.read() as connection:
            return connection.execute(_WAITING, {"task_id": task_id}).first() is not None

    def segments(self, job_id: str) -> tuple[tuple[int, int, str], ...]:
        """(start, stop, blob key) of every emitted run of frames, in order."""
        tasks = schema.tasks
        query = (
            select(tasks.c.emit_start, tasks.c.emit_stop, tasks.c.segment)
            .where(tasks.c.job_id == job_id, tasks.c.segment.is_not(None))
            .order_by(tasks.c.emit_start)
        )
        with self._db.read() as connection:
            return tuple((start, stop, key) for start, stop, key in connection.execute(query))

    def stages(self, job_id: str, step: int) -> dict[str, dict[str, float]]:
        """Seconds by stage of every step before `step`, by name."""
        steps = schema.steps
        query = select(steps.c.name, steps.c.stages).where(steps.c.job_id == job_id, steps.c.step < step)
        with self._db.read() as connection:
            return {name: dict(stages) for name, stages in connection.execute(query.order_by(steps.c.step))}

    def input_info(self, inputs: Mapping[str, str]) -> dict[str, Json]:
        """Input name -> the asset's info, with its kind and media type."""
        assets = schema.assets
        query = select(assets).where(assets.c.id.in_(inputs.values()))
        with self._db.read() as connection:
            found = {row["id"]: row for row in connection.execute(query).mappings()}
        missing = next((name for name, asset_id in inputs.items() if asset_id not in found), None)
        if missing is not None:
            raise NotFound("The asset of an input is gone.", field=f"inputs.{missing}", value=inputs[missing])
        return {
            name: {**found[i]["info"], "kind": found[i]["kind"], "media_type": found[i]["media_type"]}
            for name, i in inputs.items()
        }
