"""The state machine against a model of every task: random events, and invariants checked after each."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workers.contract.record import Fault, RunState, TaskState
from workers.errors import Conflict
from workers.jobs import state_machine as machine
from workers.jobs.state_machine import Counts, JobSnapshot, Limits, State, TaskSnapshot, advance

FAULT = Fault("internal-error", "It broke.")
TASKS = 5


@dataclass
class Model:
    """A job as the store keeps it: its state, and the tasks of the current step in a chain of `chain` tasks."""

    job: JobSnapshot = field(default_factory=lambda: JobSnapshot(RunState.QUEUED, 0, 2))
    tasks: list[TaskSnapshot] = field(default_factory=list)
    error: Fault | None = None
    announced: list[RunState] = field(default_factory=list)

    def handle(self, event: machine.Happening, index: int | None = None) -> None:
        step = self.job.step
        task = None if index is None else self.tasks[index]
        after, effects = advance(State(self.job, task, Limits(2, 3)), event)
        if index is not None:
            assert after.task is not None
            self.tasks[index] = after.task
        self.job = after.job
        for effect in effects:
            self._apply(effect, index)
        if self.job.step != step:
            self.tasks = []

    def _apply(self, effect: machine.Effect, index: int | None) -> None:
        match effect:
            case machine.FreeDependents():
                assert index is not None
                self._unblock(index + 1)
            case machine.CancelTasks():
                ended = (TaskState.SUCCEEDED, TaskState.FAILED)
                self.tasks = [t if t.state in ended else replace(t, state=TaskState.CANCELLED) for t in self.tasks]
            case machine.RestartTasks():
                self.tasks = [_again(task) for task in self.tasks]
            case machine.SetError(fault):
                self.error = self.error or fault
            case machine.ClearError():
                self.error = None
            case machine.AnnounceState(run):
                self.announced.append(run)
            case machine.BackOff():
                pass

    def _unblock(self, index: int) -> None:
        if index < len(self.tasks) and self.tasks[index].blockers:
            task = replace(self.tasks[index], blockers=0)
            self.tasks[index] = replace(task, state=TaskState.READY) if task.state is TaskState.WAITING else task

    def frees(self, index: int) -> int:
        after = self.tasks[index + 1] if index + 1 < len(self.tasks) else None
        return int(after is not None and after.blockers == 1 and after.state is TaskState.WAITING)

    def blocked(self, state: TaskState) -> int:
        return sum(1 for task in self.tasks if task.state is state and task.blockers)

    def counts(self) -> Counts:
        return Counts(**{state.value: sum(1 for task in self.tasks if task.state is state) for state in TaskState})


def _again(task: TaskSnapshot) -> TaskSnapshot:
    if task.state not in (TaskState.FAILED, TaskState.CANCELLED):
        return task
    return TaskSnapshot(TaskState.WAITING if task.blockers else TaskState.READY, task.blockers)


def _planned(model: Model, chain: bool) -> None:
    tasks = [TaskSnapshot(TaskState.WAITING, 1) if chain and i else TaskSnapshot(TaskState.READY) for i in range(TASKS)]
    waiting = sum(1 for task in tasks if task.blockers)
    model.handle(machine.Planned(TASKS - waiting, waiting))
    model.tasks = tasks


def _try(model: Model, name: str, index: int, chain: bool) -> None:
    """Apply the event if it is possible."""
    index = index % len(model.tasks) if model.tasks else 0
    concerns_task = model.tasks and name in ("claim", "done", "fail", "bad", "interrupt", "release", "requeue")
    match name:
        case "plan":
            _planned(model, chain)
        case "plan-failed":
            model.handle(machine.PlanFailed(FAULT))
        case "pause":
            model.handle(machine.Pause())
        case "resume":
            model.handle(machine.Resume())
        case "cancel":
            model.handle(machine.Cancel())
        case "retry":
            model.handle(machine.Retry(model.blocked(TaskState.FAILED), model.blocked(TaskState.CANCELLED)))
        case _ if concerns_task:
            model.handle(_task_event(model, name, index), index)


def _task_event(model: Model, name: str, index: int) -> machine.Happening:
    return {
        "claim": machine.Claimed(),
        "done": machine.Done(model.frees(index)),
        "fail": machine.Failed(FAULT),
        "bad": machine.Failed(FAULT, final=True),
        "interrupt": machine.Interrupted(),
        "release": machine.Released(),
        "requeue": machine.Requeue(),
    }[name]


NAMES = ["plan", "claim", "claim", "done", "done", "fail", "bad", "interrupt", "release", "requeue", "pause", "resume"]
NAMES += ["cancel", "retry", "plan-failed"]


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(NAMES), st.integers(0, TASKS - 1)), max_size=60), st.booleans())
def test_counts_and_states_are_consistent_for_random_events(story: list[tuple[str, int]], chain: bool) -> None:
    model = Model()
    for name, index in story:
        before = (model.job, list(model.tasks), model.error)
        try:
            _try(model, name, index, chain)
        except Conflict:
            assert (model.job, model.tasks, model.error) == before, "a refused event changes nothing"
        _check(model)


def _check(model: Model) -> None:
    job, counts = model.job, model.counts()
    assert job.counts == counts
    assert min(getattr(counts, state.value) for state in TaskState) >= 0
    if job.run is RunState.SUCCEEDED:
        assert counts.open == 0
        assert job.step == job.steps - 1
    if job.run is RunState.FAILED:
        assert model.error is not None
        assert not counts.running
    if job.run is RunState.CANCELLED:
        assert not counts.running + counts.ready + counts.waiting
    if job.run in (RunState.QUEUED, RunState.RUNNING) and job.planned and not job.failing:
        assert counts.ready or counts.running, "an active job always has something to do"
    for task in model.tasks:
        assert (task.state is TaskState.WAITING) <= (task.blockers > 0)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(NAMES), st.integers(0, TASKS - 1)), max_size=40), st.booleans())
def test_every_job_can_reach_a_final_state(story: list[tuple[str, int]], chain: bool) -> None:
    model = Model()
    for name, index in story:
        try:
            _try(model, name, index, chain)
        except Conflict:
            continue
    for _ in range(4 * TASKS + 10):
        _step_towards_the_end(model, chain)
    assert model.job.run is RunState.SUCCEEDED
    assert model.announced[-1] is RunState.SUCCEEDED


def _step_towards_the_end(model: Model, chain: bool) -> None:
    if model.job.run is RunState.PAUSED:
        return model.handle(machine.Resume())
    if model.job.run in (RunState.FAILED, RunState.CANCELLED):
        return _try(model, "retry", 0, chain)
    if model.job.run is RunState.SUCCEEDED:
        return None
    if not model.job.planned:
        return _planned(model, chain)
    running = [i for i, task in enumerate(model.tasks) if task.state is TaskState.RUNNING]
    ready = [i for i, task in enumerate(model.tasks) if task.state is TaskState.READY]
    if running:
        return model.handle(machine.Done(model.frees(running[0])), running[0])
    return model.handle(machine.Claimed(), ready[0])


def test_attempts_and_interruptions_are_counted_separately() -> None:
    job = JobSnapshot(RunState.RUNNING, 0, 2, planned=True, counts=Counts(running=1, succeeded=1))
    state = State(job, TaskSnapshot(TaskState.RUNNING, failures=1, interruptions=1), Limits(2, 3))
    after, effects = advance(state, machine.Interrupted())
    assert after.task == TaskSnapshot(TaskState.READY, 0, 1, 2)
    after, effects = advance(state, machine.Failed(FAULT))
    assert after.job.run is RunState.FAILED
    assert machine.SetError(FAULT) in effects
    assert effects[-1] == machine.AnnounceState(RunState.FAILED)


def test_a_failed_task_ends_its_job_after_the_running_tasks() -> None:
    job = JobSnapshot(RunState.RUNNING, 0, 1, planned=True, counts=Counts(ready=3, running=2))
    after, _ = advance(State(job, TaskSnapshot(TaskState.RUNNING)), machine.Failed(FAULT, final=True))
    assert (after.job.run, after.job.failing) == (RunState.RUNNING, True)
    with pytest.raises(Conflict):
        advance(State(after.job, TaskSnapshot(TaskState.READY)), machine.Claimed())
    ended, _ = advance(State(after.job, TaskSnapshot(TaskState.RUNNING)), machine.Done())
    assert ended.job.run is RunState.FAILED


@pytest.mark.parametrize("event", [machine.Pause(), machine.Cancel(), machine.Planned(1, 0), machine.PlanFailed(FAULT)])
def test_an_ended_job_refuses_further_events(event: machine.Happening) -> None:
    with pytest.raises(Conflict) as refused:
        advance(State(JobSnapshot(RunState.SUCCEEDED, 1, 2, planned=True)), event)
    assert refused.value.value == "succeeded"


def test_a_task_that_kills_its_host_repeatedly_fails_at_the_limit() -> None:
    job = JobSnapshot(RunState.RUNNING, 0, 1, planned=True, counts=Counts(running=1))
    state = State(job, TaskSnapshot(TaskState.RUNNING, interruptions=2), Limits(2, 3))
    after, effects = advance(state, machine.Interrupted())
    assert after.task is not None
    assert (after.task.state, after.job.run) == (TaskState.FAILED, RunState.FAILED)
    (fault,) = [effect.fault for effect in effects if isinstance(effect, machine.SetError)]
    assert fault.code == "interrupted"


def test_one_of_two_failed_tasks_runs_again_and_the_job_ends_as_failed() -> None:
    job = JobSnapshot(RunState.FAILED, 0, 1, planned=True, counts=Counts(succeeded=1, failed=2))
    queued, _ = advance(State(job, TaskSnapshot(TaskState.FAILED, failures=2)), machine.Requeue())
    assert (queued.job.run, queued.task) == (RunState.QUEUED, TaskSnapshot(TaskState.READY))
    running, _ = advance(queued, machine.Claimed())
    ended, _ = advance(running, machine.Done())
    assert ended.job.run is RunState.FAILED


def test_a_requeue_of_a_draining_job_lets_it_start_tasks_again() -> None:
    counts = Counts(running=1, ready=1, failed=1)
    job = JobSnapshot(RunState.RUNNING, 0, 1, planned=True, failing=True, counts=counts)
    after, _ = advance(State(job, TaskSnapshot(TaskState.FAILED)), machine.Requeue())
    advance(after, machine.Claimed())


def test_a_task_that_waits_for_another_is_not_requeued_alone() -> None:
    job = JobSnapshot(RunState.CANCELLED, 0, 1, planned=True, counts=Counts(cancelled=2))
    with pytest.raises(Conflict):
        advance(State(job, TaskSnapshot(TaskState.CANCELLED, blockers=1)), machine.Requeue())
