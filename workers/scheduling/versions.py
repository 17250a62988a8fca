"""Jobs that another version of the program has planned: continued, planned again, or left to a newer program."""

from __future__ import annotations

import logging

from pipeline.errors import BadParameter, ImpastoError
from pipeline.methods import method, parse_params
from pipeline.methods.base import Method, Params
from workers.contract.record import JobWarning
from workers.contract.request import Json
from workers.jobs.frame_window import window_inputs
from workers.jobs.job_warnings import PLANNED_AGAIN
from workers.jobs.plan_versions import StepVersion, first_unreadable, is_newer
from workers.process.log_context import log_extra
from workers.scheduling.planning import expected_weights, step_versions, steps_of, versions_of
from workers.store import Accepted, StepToPlan, Store
from workers.store.records import Row
from workers.version import version

log = logging.getLogger(__name__)


def is_readable(job: Row) -> bool:
    """Whether this program has the versions with which the job was planned.

    Args:
        job: its row, or the fields "method", "params" and "versions".
    """
    try:
        own = _own_versions(method(job["method"]), job["params"])
    except ImpastoError:  # a method that is not installed: the job fails with the error of that
        return True
    return [tuple(pair) for pair in job["versions"] or []] == [(step.name, step.version) for step in own]


def _own_versions(chosen: Method, params: Json) -> tuple[StepVersion, ...]:
    try:
        return step_versions(chosen, parse_params(chosen, params))
    except BadParameter:  # of another version
        return step_versions(chosen, None)


class VersionKeeper:
    """Takes over jobs that are not readable. Used by one thread."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._announced: set[str] = set()
        """Ids of jobs that know that they wait."""

    def take_over(self, found: StepToPlan) -> bool:
        """Continue a job with this program's versions, or let it be planned again from the first step that cannot be
        read; False if it must wait: for a newer program, or for tasks of it that another program runs."""
        chosen = method(found.method)
        stored = [(str(name), int(number)) for name, number in found.versions]
        if is_newer(stored, _own_versions(chosen, found.params)):
            self._announce_waiting(found)
            return False
        try:
            params = parse_params(chosen, found.request.params)
        except BadParameter:  # planning will report it
            params = parse_params(chosen, {})
        step = first_unreadable(stored, step_versions(chosen, params))
        accepted = self._accepted(found, chosen, params)
        step = len(accepted.steps) if step is None else step
        lost = step < found.step or (step == found.step and found.planned)
        warning = _warning(found, accepted, step) if lost else None
        taken = self._store.plans.replan(found, step, accepted, warning)
        if taken and warning is not None:
            log.warning("%s", warning.message, extra=log_extra(job=found.job_id))
        return taken

    def _accepted(self, found: StepToPlan, chosen: Method, params: Params) -> Accepted:
        """The request as this program would accept it now."""
        inputs, request = self._store.task_inputs, found.request
        info = window_inputs(inputs.input_info(request.inputs), request.frames).get("video", {})
        filled = {**params.model_dump(mode="json"), **_unknown(chosen, request.params)}
        weights = expected_weights(chosen, params, info)
        return Accepted(request, filled, steps_of(chosen, params), weights, versions_of(chosen, params))

    def _announce_waiting(self, found: StepToPlan) -> None:
        if found.job_id not in self._announced:
            self._announced.add(found.job_id)
            by = f" ({found.planned_by})" if found.planned_by else ""
            message = f"Waits for a newer version of Impasto{by}, which has planned it. This is {version()}."
            self._store.plans.announce_waiting(found.job_id, message)
            log.warning("the job waits for a newer version of Impasto%s", by, extra=log_extra(job=found.job_id))


def _unknown(chosen: Method, given: Json) -> Json:
    """Parameters of the request that the method no longer has, so that planning refuses them by name."""
    return {name: value for name, value in given.items() if name not in chosen.Params.model_fields}


def _warning(found: StepToPlan, accepted: Accepted, step: int) -> JobWarning:
    title = accepted.steps[step][1]
    begun = f"version {found.planned_by}" if found.planned_by else "an earlier version"
    message = (
        f"Planned again from the step {title!r} by version {version()}: {begun} of Impasto began the job, and its "
        "tasks and results cannot be continued."
    )
    return JobWarning(PLANNED_AGAIN, message, "", {})
