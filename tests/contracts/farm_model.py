"""A simple model of jobs, tasks and attempts, against which the store is compared after every step."""

from __future__ import annotations

from dataclasses import dataclass, field

MAX_FAILURES = 3
STEPS = 2
FINAL = ("succeeded", "failed", "cancelled")


@dataclass
class ModelTask:
    """A task. `before`: keys of tasks of its step that it waits for."""

    key: str
    before: tuple[str, ...] = ()
    state: str = "waiting"
    failures: int = 0
    attempt: str = ""


@dataclass
class ModelJob:
    """A job of two steps, of which the second has one task."""

    owner: str
    priority: int
    shape: tuple[tuple[str, tuple[str, ...]], ...]
    state: str = "queued"
    step: int = 0
    planned: bool = False
    doomed: bool = False
    tasks: dict[str, ModelTask] = field(default_factory=dict)
    """Tasks of the current step by key."""
    done: int = 0
    """Tasks of earlier steps."""

    @property
    def active(self) -> bool:
        return self.state in ("queued", "running")

    def plan(self) -> None:
        shape = self.shape if self.step == 0 else (("assemble", ()),)
        self.tasks = {key: ModelTask(key, before) for key, before in shape}
        self.planned = True
        self._free()
        self._settle()

    def claimable(self) -> list[str]:
        if not self.active or self.doomed:
            return []
        return [key for key, task in self.tasks.items() if task.state == "ready"]

    def claim(self, key: str, attempt: str) -> None:
        self.tasks[key].state, self.tasks[key].attempt = "running", attempt
        self.state = "running"

    def succeed(self, key: str) -> None:
        self._end(key, "succeeded")
        self._free()
        self._settle()

    def fail(self, key: str, final: bool) -> None:
        task = self.tasks[key]
        task.failures += 1
        lost = final or task.failures >= MAX_FAILURES
        self._end(key, "failed" if lost else "ready")
        self.doomed = self.doomed or lost
        self._settle()

    def give_back(self, key: str) -> None:
        self._end(key, "ready")
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
        self.state, self.doomed = "cancelled", False

    def retry(self) -> None:
        for task in self.tasks.values():
            if task.state in ("failed", "cancelled"):
                task.state, task.failures = "waiting", 0
            elif task.state != "succeeded":
                task.failures = 0
        self.state, self.doomed = "queued", False
        self._free()
        self._settle()

    def counts(self) -> dict[str, int]:
        found = {state: self._having(state) for state in ("waiting", "ready", "running", "succeeded", "failed")}
        found["cancelled"] = self._having("cancelled")
        found["succeeded"] += self.done
        return found

    def _having(self, state: str) -> int:
        return sum(task.state == state for task in self.tasks.values())

    def _end(self, key: str, state: str) -> None:
        self.tasks[key].state, self.tasks[key].attempt = state, ""

    def _free(self) -> None:
        for task in self.tasks.values():
            if task.state == "waiting" and all(self.tasks[key].state == "succeeded" for key in task.before):
                task.state = "ready"

    def _settle(self) -> None:
        """The next step, or the end, once nothing runs."""
        if self.state in FINAL or not self.planned or self._having("running"):
            return
        if all(task.state == "succeeded" for task in self.tasks.values()):
            self._advance()
        elif (self._having("failed") or self._having("cancelled")) and (self.doomed or not self._having("ready")):
            self.state, self.doomed = ("failed" if self._having("failed") else "cancelled"), False

    def _advance(self) -> None:
        if self.step == STEPS - 1:
            self.state = "succeeded"
            return
        self.done += len(self.tasks)
        self.step, self.planned, self.tasks = self.step + 1, False, {}
