"""Input and output of the state machine of jobs and tasks: events and effects.

`advance` of `workers.jobs.state_machine` takes an event and returns effects; the store applies them in the same
transaction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from workers.contract.record import Fault, RunState

# -- events


@dataclass(frozen=True)
class Planned:
    """The current step has been planned: numbers of tasks that may start, and of tasks that wait for others."""

    ready: int
    waiting: int


@dataclass(frozen=True)
class PlanFailed:
    fault: Fault


@dataclass(frozen=True)
class Replanned:
    """Another version has planned the job: its tasks from `step` on are gone, and the job has `steps` steps."""

    step: int
    steps: int


@dataclass(frozen=True)
class Claimed:
    """A dispatcher claimed the task; an attempt begins."""


@dataclass(frozen=True)
class Done:
    """The attempt succeeded, and `frees` tasks are no longer blocked."""

    frees: int = 0


@dataclass(frozen=True)
class Failed:
    """The attempt failed or its worker died. `final`: another attempt would fail, too."""

    fault: Fault
    final: bool = False


@dataclass(frozen=True)
class Interrupted:
    """The attempt died with its dispatcher (kill -9, power loss). It counts as a failure only if that is frequent."""


@dataclass(frozen=True)
class Released:
    """The attempt was returned unfinished: an orderly shutdown, or storage was unavailable. It is not counted."""


@dataclass(frozen=True)
class Pause:
    pass


@dataclass(frozen=True)
class Resume:
    pass


@dataclass(frozen=True)
class Cancel:
    pass


@dataclass(frozen=True)
class Retry:
    """Start failed and cancelled tasks again; `blocked_failed` and `blocked_cancelled` of them must wait for others."""

    blocked_failed: int = 0
    blocked_cancelled: int = 0


@dataclass(frozen=True)
class Requeue:
    """Start this one failed or cancelled task again."""


StateEvent: TypeAlias = (
    Planned | PlanFailed | Replanned | Claimed | Done | Failed | Interrupted | Released
    | Pause | Resume | Cancel | Retry | Requeue
)  # fmt: skip


# -- effects


@dataclass(frozen=True)
class FreeDependents:
    """Tasks that waited only for this one become ready."""


@dataclass(frozen=True)
class CancelTasks:
    """Every unfinished task of the step becomes cancelled; running attempts end in the store and are asked to stop."""


@dataclass(frozen=True)
class RestartTasks:
    """Every failed or cancelled task of the step becomes ready or waiting, with a fresh budget."""


@dataclass(frozen=True)
class BackOff:
    """The task may not be claimed for a while; longer after each failure."""

    failures: int


@dataclass(frozen=True)
class SetError:
    """The job's error, unless it has one."""

    fault: Fault


@dataclass(frozen=True)
class ClearError:
    """The job's error is removed."""


@dataclass(frozen=True)
class AnnounceState:
    """The job's state changed: an event, and a webhook message when it is final."""

    run: RunState


Effect: TypeAlias = FreeDependents | CancelTasks | RestartTasks | BackOff | SetError | ClearError | AnnounceState
Effects: TypeAlias = tuple[Effect, ...]
