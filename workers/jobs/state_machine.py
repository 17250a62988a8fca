"""The state machine of jobs and tasks: a pure function, `advance(state, event) -> (state, effects)`.

A job, as its user sees it (`RunState`):

                  claim               every task of the last step is done
      QUEUED ---------------> RUNNING ------------------------------------> SUCCEEDED
        |  ^                   |  ^ |
        |  | resume     pause  |  | | a task failed for good, and those that ran beside it have ended
        |  |                   |  | +-------------------------------------> FAILED
        |  +------- PAUSED <---+  |
        +---------->   |  --------+
          pause        |     resume, while attempts still run
                       |
      QUEUED, RUNNING, PAUSED -- cancel --> CANCELLED
      FAILED, CANCELLED -- retry, requeue --> QUEUED

A task (`TaskState`); its attempts are counted, and a late answer never gets here (the store fences it by attempt id):

                 tasks before it        claim            done
      WAITING -----------------> READY -------> RUNNING -------> SUCCEEDED
                                   ^               |
                                   |  failed, lost |  attempts are left
                                   +---------------+  (interrupted, released: not counted as failures)
                                                   |
                                                   +-----------> FAILED       attempts used up, or bad input
      WAITING, READY, RUNNING -- cancel of the job --> CANCELLED
      FAILED, CANCELLED -- retry, requeue --> READY or WAITING, with a fresh budget of attempts

A job that another version of the program has planned goes back to the first step that this program cannot continue from
(`Replanned`); the tasks of that step and the later ones are planned again.

Steps run one after the other: a step is planned once every task of the step before it is done. The last step of every
job is the platform's own (`ASSEMBLE`). A job that is `failing` (a task has failed permanently) starts nothing new, lets
running attempts end, because their results are kept, and then fails. Pausing, too, lets running attempts end.

The machine depends on the current step only: all tasks of earlier steps have succeeded, and later steps have no tasks
yet. Its state is therefore a few numbers, independent of the size of the job.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from workers.contract.record import Fault, RunState, TaskState
from workers.errors import Conflict
from workers.jobs.state_events import (
    AnnounceState,
    BackOff,
    Cancel,
    CancelTasks,
    Claimed,
    ClearError,
    Done,
    Effect,
    Effects,
    Failed,
    FreeDependents,
    Interrupted,
    Pause,
    PlanFailed,
    Planned,
    Released,
    Replanned,
    Requeue,
    RestartTasks,
    Resume,
    Retry,
    SetError,
    StateEvent,
)

__all__ = [
    "ASSEMBLE",
    "AnnounceState",
    "BackOff",
    "Cancel",
    "CancelTasks",
    "Claimed",
    "ClearError",
    "Counts",
    "Done",
    "Effect",
    "Effects",
    "Failed",
    "FreeDependents",
    "Interrupted",
    "JobSnapshot",
    "Limits",
    "Pause",
    "PlanFailed",
    "Planned",
    "Released",
    "Replanned",
    "Requeue",
    "RestartTasks",
    "Resume",
    "Retry",
    "SetError",
    "State",
    "StateEvent",
    "TaskSnapshot",
    "advance",
]

ASSEMBLE = "assemble"
"""The platform's own last step: join what was emitted, make poster and contact sheet. One task of the same key."""


@dataclass(frozen=True)
class Limits:
    attempts: int = 3
    """Number of failures after which a task fails permanently."""
    interruptions: int = 20
    """The same for attempts that died with their whole process, because a task that kills its process must end, too."""


@dataclass(frozen=True)
class Counts:
    """Tasks of the current step by state."""

    waiting: int = 0
    ready: int = 0
    running: int = 0
    succeeded: int = 0
    failed: int = 0
    cancelled: int = 0

    @property
    def open(self) -> int:
        """Tasks that are not done."""
        return self.waiting + self.ready + self.running + self.failed + self.cancelled

    def moved(self, old: TaskState, new: TaskState, n: int = 1) -> Counts:
        """Move `n` tasks from the state `old` to the state `new`."""
        if old is new:
            return self
        return replace(self, **{old.value: getattr(self, old.value) - n, new.value: getattr(self, new.value) + n})


@dataclass(frozen=True)
class JobSnapshot:
    """State of a job, as far as transitions depend on it."""

    run: RunState
    step: int
    """Index of the current step."""
    steps: int
    """Number of steps, the platform's own among them."""
    planned: bool = False
    """Whether the tasks of the current step exist."""
    failing: bool = False
    """Whether a task has failed permanently since the job was last started; then no task starts."""
    counts: Counts = Counts()


@dataclass(frozen=True)
class TaskSnapshot:
    """State of a task, as far as transitions depend on it."""

    state: TaskState
    blockers: int = 0
    """Number of unfinished tasks of its step that it waits for."""
    failures: int = 0
    interruptions: int = 0


@dataclass(frozen=True)
class State:
    """A job, and the one task that the event is about (None for events about the job)."""

    job: JobSnapshot
    task: TaskSnapshot | None = None
    limits: Limits = Limits()


def advance(state: State, event: StateEvent) -> tuple[State, Effects]:
    """The state after `event`, and the effects that the store must apply.

    Raises:
        Conflict: the event is not possible in this state; nothing has changed.
    """
    after, effects = _HANDLERS[type(event)](state, event)
    settled, more = _settle(after.job)
    if settled.run is not state.job.run:
        more = (*more, AnnounceState(settled.run))
    return replace(after, job=settled), (*effects, *more)


def _settle(job: JobSnapshot) -> tuple[JobSnapshot, Effects]:
    """Transitions that need no event once nothing runs: to the next step, or to a final state."""
    counts = job.counts
    if job.run.final or not job.planned or counts.running:
        return job, ()
    if counts.open == 0:
        if job.step == job.steps - 1:
            return replace(job, run=RunState.SUCCEEDED), ()
        return replace(job, step=job.step + 1, planned=False, counts=Counts()), ()
    if (counts.failed or counts.cancelled) and (job.failing or not counts.ready):
        return replace(job, run=RunState.FAILED if counts.failed else RunState.CANCELLED, failing=False), ()
    return job, ()


def _planned(state: State, event: Planned) -> tuple[State, Effects]:
    job = state.job
    _require(not job.run.final and not job.planned, "The step is planned already, or the job has ended.", job.run)
    counts = Counts(ready=event.ready, waiting=event.waiting)
    return replace(state, job=replace(job, planned=True, counts=counts)), ()


def _plan_failed(state: State, event: PlanFailed) -> tuple[State, Effects]:
    job = state.job
    _require(not job.run.final and not job.planned, "The step is planned already, or the job has ended.", job.run)
    return replace(state, job=replace(job, run=RunState.FAILED)), (SetError(event.fault),)


def _replanned(state: State, event: Replanned) -> tuple[State, Effects]:
    job = state.job
    _require(not job.run.final and not job.counts.running, "The job has ended, or tasks of it run.", job.run)
    back = replace(job, step=event.step, steps=event.steps, planned=False, failing=False, counts=Counts())
    return replace(state, job=back), ()


def _claimed(state: State, event: Claimed) -> tuple[State, Effects]:
    job = state.job
    _require(job.run in (RunState.QUEUED, RunState.RUNNING) and not job.failing, "The job starts nothing now.", job.run)
    moved = _move(state, TaskState.READY, TaskState.RUNNING)
    return replace(moved, job=replace(moved.job, run=RunState.RUNNING)), ()


def _done(state: State, event: Done) -> tuple[State, Effects]:
    moved = _move(state, TaskState.RUNNING, TaskState.SUCCEEDED)
    counts = moved.job.counts.moved(TaskState.WAITING, TaskState.READY, event.frees)
    return replace(moved, job=replace(moved.job, counts=counts)), (FreeDependents(),)


def _failed(state: State, event: Failed) -> tuple[State, Effects]:
    failures = _task(state).failures + 1
    counted = replace(state, task=replace(_task(state), failures=failures))
    if event.final or failures >= state.limits.attempts:
        return _give_up(counted, event.fault)
    return _move(counted, TaskState.RUNNING, TaskState.READY), (BackOff(failures),)


def _interrupted(state: State, event: Interrupted) -> tuple[State, Effects]:
    times = _task(state).interruptions + 1
    counted = replace(state, task=replace(_task(state), interruptions=times))
    if times < state.limits.interruptions:
        return _move(counted, TaskState.RUNNING, TaskState.READY), ()
    return _give_up(
        counted,
        Fault(
            "interrupted",
            f"The process of this task died or hung {times} times.",
            "Look for a lack of memory on the machine, and at the task's log, then retry the job.",
        ),
    )


def _give_up(state: State, fault: Fault) -> tuple[State, Effects]:
    moved = _move(state, TaskState.RUNNING, TaskState.FAILED)
    return replace(moved, job=replace(moved.job, failing=True)), (SetError(fault),)


def _released(state: State, event: Released) -> tuple[State, Effects]:
    return _move(state, TaskState.RUNNING, TaskState.READY), ()


def _pause(state: State, event: Pause) -> tuple[State, Effects]:
    _require(
        state.job.run in (RunState.QUEUED, RunState.RUNNING), "Only a queued or running job pauses.", state.job.run
    )
    return replace(state, job=replace(state.job, run=RunState.PAUSED)), ()


def _resume(state: State, event: Resume) -> tuple[State, Effects]:
    job = state.job
    _require(job.run is RunState.PAUSED, "Only a paused job resumes.", job.run)
    run = RunState.RUNNING if job.counts.running else RunState.QUEUED
    return replace(state, job=replace(job, run=run)), ()


def _cancel(state: State, event: Cancel) -> tuple[State, Effects]:
    job = state.job
    _require(not job.run.final, "The job has ended.", job.run)
    counts = job.counts
    for open_state in (TaskState.WAITING, TaskState.READY, TaskState.RUNNING):
        counts = counts.moved(open_state, TaskState.CANCELLED, getattr(job.counts, open_state.value))
    return replace(state, job=replace(job, run=RunState.CANCELLED, failing=False, counts=counts)), (CancelTasks(),)


def _retry(state: State, event: Retry) -> tuple[State, Effects]:
    job = state.job
    _require(job.run in (RunState.FAILED, RunState.CANCELLED), "Only a failed or cancelled job is retried.", job.run)
    counts = job.counts
    for ended, blocked in (
        (TaskState.FAILED, event.blocked_failed),
        (TaskState.CANCELLED, event.blocked_cancelled),
    ):
        counts = counts.moved(ended, TaskState.READY, getattr(job.counts, ended.value) - blocked)
        counts = counts.moved(ended, TaskState.WAITING, blocked)
    return replace(state, job=_reopened(job, counts)), (RestartTasks(), ClearError())


def _requeue(state: State, event: Requeue) -> tuple[State, Effects]:
    task = _task(state)
    _require(
        task.state in (TaskState.FAILED, TaskState.CANCELLED), "Only a failed or cancelled task runs again.", task.state
    )
    _require(task.blockers == 0, "The task waits for others that are not done: run those first.", task.state)
    fresh = replace(state, task=replace(task, failures=0, interruptions=0))
    moved = _move(fresh, task.state, TaskState.READY)
    return replace(moved, job=_reopened(moved.job, moved.job.counts)), (ClearError(),)


def _reopened(job: JobSnapshot, counts: Counts) -> JobSnapshot:
    """The job continues: queued again if it had ended, else unchanged."""
    return replace(job, run=RunState.QUEUED if job.run.final else job.run, failing=False, counts=counts)


def _move(state: State, old: TaskState, new: TaskState) -> State:
    task = _task(state)
    _require(task.state is old, f"The task is not {old}.", task.state)
    counts = state.job.counts.moved(old, new)
    return replace(state, job=replace(state.job, counts=counts), task=replace(task, state=new))


def _task(state: State) -> TaskSnapshot:
    if state.task is None:
        raise Conflict("The event needs a task.", field="task")
    return state.task


def _require(condition: bool, message: str, found: RunState | TaskState) -> None:
    if not condition:
        raise Conflict(message, field="state", value=found.value)


_HANDLERS: dict[type, Callable[[State, Any], tuple[State, Effects]]] = {
    Planned: _planned,
    PlanFailed: _plan_failed,
    Replanned: _replanned,
    Claimed: _claimed,
    Done: _done,
    Failed: _failed,
    Interrupted: _interrupted,
    Released: _released,
    Pause: _pause,
    Resume: _resume,
    Cancel: _cancel,
    Retry: _retry,
    Requeue: _requeue,
}
