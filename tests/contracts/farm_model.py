"""A simple model of jobs, tasks and attempts, against which the store is compared after every step."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

MAX_FAILURES, MAX_INTERRUPTIONS = 3, 5
RETRY_DELAY_S, LONGEST_WAIT_S, DEBT_S = 2.0, 300.0, 600.0
STEPS = 2
FINAL = ("succeeded", "failed", "cancelled")
FAILED_CODE, INTERRUPTED_CODE = "internal-error", "interrupted"


@dataclass
class ModelTask:
    """A task. `before`: keys of tasks of its step that it waits for. `ready_at`: not claimed before, s."""

    key: str
    before: tuple[str, ...] = ()
    state: str = "waiting"
    failures: int = 0
    interruptions: int = 0
    attempt: str = ""
    ready_at: float = 0.0

    def is_due(self, now: float) -> bool:
        """Whether it may be claimed. A wait that is too long was begun before the clock was set back, and is over."""
        return self.state == "ready" and (self.ready_at <= now or self.ready_at > now + LONGEST_WAIT_S)

    def refresh(self, state: str) -> None:
        """Reset the task, with all its attempts."""
        self.state, self.failures, self.interruptions, self.ready_at = state, 0, 0, 0.0


@dataclass
class ModelTurns:
    """Slot time of the owners. A claim raises the floor to the least of all owners who wait."""

    used_s: dict[str, float] = field(default_factory=dict)
    floor_s: float = 0.0
    began: dict[str, tuple[str, float]] = field(default_factory=dict)
    """Attempt -> owner, and when it began, s."""

    def counted_s(self, owner: str) -> float:
        return min(max(self.used_s.get(owner, 0.0), self.floor_s), self.floor_s + DEBT_S)

    def begin(self, attempt: str, owner: str, waiting: Collection[str], now: float) -> None:
        self.floor_s = min(map(self.counted_s, waiting))
        self.used_s[owner] = self.counted_s(owner)
        self.began[attempt] = owner, now

    def end(self, attempt: str, now: float) -> None:
        owner, began = self.began.pop(attempt)
        self.used_s[owner] += max(0.0, now - began)


@dataclass
class ModelJob:
    """A job of two steps, of which the second has one task."""

    owner: str
    priority: int
    shape: tuple[tuple[str, tuple[str, ...]], ...]
    state: str = "queued"
    step: int = 0
    planned: bool = False
    failing: bool = False
    error: str = ""
    """Code of the first fault since the job was last started."""
    tasks: dict[str, ModelTask] = field(default_factory=dict)
    """Tasks of the current step by key, in the order in which they are claimed."""
    done: int = 0
    """Tasks of earlier steps."""
    history: list[str] = field(default_factory=lambda: ["queued"])
    """All states so far, oldest first."""

    @property
    def active(self) -> bool:
        return self.state in ("queued", "running")

    @property
    def messages(self) -> int:
        """Number of its webhook messages: one for each end."""
        return sum(state in FINAL for state in self.history)

    def record_state(self) -> None:
        if self.history[-1] != self.state:
            self.history.append(self.state)

    def plan(self) -> None:
        shape = self.shape if self.step == 0 else (("assemble", ()),)
        self.tasks = {key: ModelTask(key, before) for key, before in shape}
        self.planned = True
        self._free()
        self._settle()

    def claimable(self, now: float) -> list[str]:
        if not self.active or self.failing:
            return []
        return [key for key, task in self.tasks.items() if task.is_due(now)]

    @property
    def has_ready_task(self) -> bool:
        """Whether it has a ready task, due or not, that it may start."""
        return self.active and not self.failing and self._having("ready") > 0

    def claim(self, key: str, attempt: str) -> None:
        self.tasks[key].state, self.tasks[key].attempt = "running", attempt
        self.state = "running"

    def succeed(self, key: str) -> None:
        self._end(key, "succeeded")
        self._free()
        self._settle()

    def fail(self, key: str, final: bool, now: float) -> None:
        task = self.tasks[key]
        task.failures += 1
        if final or task.failures >= MAX_FAILURES:
            self._give_up(key, FAILED_CODE)
        else:
            self._end(key, "ready")
            task.ready_at = now + RETRY_DELAY_S * 2 ** (task.failures - 1)
        self._settle()

    def interrupt(self, key: str) -> None:
        task = self.tasks[key]
        task.interruptions += 1
        if task.interruptions >= MAX_INTERRUPTIONS:
            self._give_up(key, INTERRUPTED_CODE)
        else:
            self._end(key, "ready")
        self._settle()

    def postpone(self, key: str, until: float) -> None:
        self._end(key, "ready")
        self.tasks[key].ready_at = until
        self._settle()

    def pause(self) -> None:
        self.state = "paused"

    def resume(self) -> None:
        self.state = "running" if self._having("running") else "queued"
        self._settle()

    def cancel(self) -> None:
        for task in self.tasks.values():
            if task.state in ("waiting", "ready", "running"):
                task.state, task.attempt = "cancelled", ""
        self.state, self.failing = "cancelled", False

    def retry(self) -> None:
        for task in self.tasks.values():
            if task.state != "succeeded":
                task.refresh("waiting")
        self.state, self.failing, self.error = "queued", False, ""
        self._free()
        self._settle()

    def requeueable(self) -> list[str]:
        """Tasks that may run again alone."""
        ended = (task for task in self.tasks.values() if task.state in ("failed", "cancelled"))
        return [task.key for task in ended if self._unblocked(task)]

    def requeue(self, key: str, now: float) -> None:
        self.tasks[key].refresh("ready")
        self.tasks[key].ready_at = now
        self.state = "queued" if self.state in FINAL else self.state
        self.failing, self.error = False, ""
        self._settle()

    def counts(self) -> dict[str, int]:
        found = {state: self._having(state) for state in ("waiting", "ready", "running", "succeeded", "failed")}
        found["cancelled"] = self._having("cancelled")
        found["succeeded"] += self.done
        return found

    def _having(self, state: str) -> int:
        return sum(task.state == state for task in self.tasks.values())

    def _give_up(self, key: str, code: str) -> None:
        self._end(key, "failed")
        self.failing, self.error = True, self.error or code

    def _end(self, key: str, state: str) -> None:
        self.tasks[key].state, self.tasks[key].attempt = state, ""

    def _unblocked(self, task: ModelTask) -> bool:
        return all(self.tasks[key].state == "succeeded" for key in task.before)

    def _free(self) -> None:
        for task in self.tasks.values():
            if task.state == "waiting" and self._unblocked(task):
                task.state = "ready"

    def _settle(self) -> None:
        """Start the next step, or end the job, once nothing runs."""
        if self.state in FINAL or not self.planned or self._having("running"):
            return
        if all(task.state == "succeeded" for task in self.tasks.values()):
            self._advance()
        elif (self._having("failed") or self._having("cancelled")) and (self.failing or not self._having("ready")):
            self.state, self.failing = ("failed" if self._having("failed") else "cancelled"), False

    def _advance(self) -> None:
        if self.step == STEPS - 1:
            self.state = "succeeded"
            return
        self.done += len(self.tasks)
        self.step, self.planned, self.tasks = self.step + 1, False, {}
