"""Builds the order for a worker from a claimed task. Results of finished steps are read once per step."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

from pipeline.methods.base import Resources
from workers.contract.order import EarlierTask, TaskOrder
from workers.contract.record import asset_key
from workers.contract.request import JobRequest, Json
from workers.execution.lru_cache import LruCache
from workers.jobs.frame_window import window_inputs
from workers.jobs.state_machine import ASSEMBLE
from workers.store import Claim, Store
from workers.store.records import emitted_run, request_of

_REMEMBERED = 32


@dataclass(frozen=True)
class _Before:
    """Results and inputs of earlier steps, which are the same for all tasks of a step."""

    results: dict[str, dict[str, Json]]
    artefacts: dict[str, str]
    info: dict[str, Json]
    segments: tuple[tuple[int, int, str], ...]
    stages: dict[str, dict[str, float]]


class Orders:
    """Builds orders. Used by one thread.

    Args:
        shares_memory: whether the pool passes artefacts between tasks in memory.
    """

    def __init__(self, store: Store, shares_memory: bool) -> None:
        self._store = store
        self._shares_memory = shares_memory
        self._known: OrderedDict[tuple[str, int, str], _Before] = OrderedDict()
        self._earlier: LruCache[dict[str, EarlierTask]] = LruCache(_REMEMBERED)

    def order(self, claim: Claim) -> TaskOrder:
        """Raises NotFound if an input has been deleted, StorageError."""
        task, request = claim.task, request_of(claim.job["request"])
        step = claim.step_name
        versions = claim.job["versions"] or []
        before = self._before((claim.job_id, task["step"], str(versions)), request, step)
        after, chained = self._store.task_inputs.chain(task["id"]) if task["chained"] else ((), {})
        return TaskOrder(
            attempt_id=claim.attempt_id,
            job_id=claim.job_id,
            task_id=task["id"],
            step=step,
            method=request.method,
            key=task["key"],
            args=task["args"],
            emits=emitted_run(task),
            params=claim.job["params"],
            seed=request.seed,
            inputs={name: asset_key(asset_id) for name, asset_id in request.inputs.items()},
            input_info=before.info,
            output=request.output,
            results=before.results,
            artefacts=_visible(before.artefacts, after) | chained,
            after=after,
            segments=before.segments,
            frames=request.frames,
            stages=before.stages,
            on_damage=request.on_damage,
            source=request.source,
            resources=None if task["needs"] is None else Resources(**task["needs"]),
            earlier=self._earlier_task(claim.job["base_id"], step, task["key"]),
            records_reads=claim.job["base_id"] is not None,
            versions=tuple((name, number) for name, number in versions[: task["step"] + 1]),
            has_dependents=self._shares_memory and self._store.task_inputs.has_dependents(task["id"]),
        )

    def _earlier_task(self, base_id: str | None, step: str, key: str) -> EarlierTask | None:
        """The same task of the job on which this job is based."""
        if not base_id or step == ASSEMBLE:
            return None
        return self._earlier.get(f"{base_id}/{step}", lambda: self._store.reuse.earlier(base_id, step)).get(key)

    def _before(self, key: tuple[str, int, str], request: JobRequest, name: str) -> _Before:
        """`key`: job, step, and versions, with which the results change if the job is planned again."""
        if key not in self._known:
            self._known[key] = self._read(*key[:2], request, name)
        self._known.move_to_end(key)
        while len(self._known) > _REMEMBERED:
            self._known.popitem(last=False)
        return self._known[key]

    def _read(self, job_id: str, step: int, request: JobRequest, name: str) -> _Before:
        context = self._store.task_inputs
        results, artefacts = context.before(job_id, step)
        last = name == ASSEMBLE
        segments, stages = (context.segments(job_id), context.stages(job_id, step)) if last else ((), {})
        info = window_inputs(context.input_info(request.inputs), request.frames, request.source)
        return _Before(results, artefacts, info, segments, stages)


def _visible(artefacts: dict[str, str], after: tuple[str, ...]) -> dict[str, str]:
    """Artefacts of the earlier steps of which `after` names no task: see `pipeline.methods.tasks.Task.after`."""
    named = {name.partition("/")[0] for name in after if "/" in name}
    return {name: key for name, key in artefacts.items() if name.partition("/")[0] not in named}
