"""A method and a runner for tests of the farm: seconds of video arithmetic without any video.

The method works on a JSON input; its tasks do what `args` and `params` say: wait, fail, stop the process. The runner
keeps the contract of `workers.execution.renderer.Renderer` with the smallest possible context.
"""

from __future__ import annotations

import errno
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field

from pipeline.errors import BadInput, Cancelled, StorageError, StorageFull
from pipeline.methods.base import (
    InputSpec,
    Method,
    Params,
    PlanContext,
    Resources,
    Step,
    Task,
    TaskResult,
    seeded,
)
from tests.workers.hangs import HANGS
from tests.workers.relay_method import Relay
from workers.blobs.base import Blobs
from workers.blobs.disk import DiskBlobs
from workers.contract.order import ProgressReport, TaskOrder, TaskOutcome
from workers.faults import failed_outcome
from workers.jobs.state_machine import ASSEMBLE


class ToyParams(Params):
    tasks: int = Field(default=3, ge=0, le=100_000)
    chain: bool = False
    sleep_s: float = Field(default=0.0, ge=0)
    trouble: str = ""
    """Fault of task "run-1": "raise", "bad-input", "full", "away", "once", "die", "cycle" (in the plan), or a name of
    `tests.workers.hangs.HANGS`."""
    gpus: float = Field(default=0.0, ge=0)
    """GPUs per task."""
    memory_mib: int = Field(default=0, ge=0)
    """MiB per task. Without GPUs and memory, tasks declare no resources."""
    mark: str = ""
    """A file that "once" leaves behind, so that it happens once only."""


def _plan_analysis(context: PlanContext) -> list[Task]:
    return [Task("all")]


def _analyze(task: Task, context: Any) -> TaskResult:
    return {"found": context.params.tasks}


def _plan_draw(context: PlanContext) -> list[Task]:
    n = context.results["analyze"]["all"]["found"]
    after = {i: (f"run-{i - 1}",) for i in range(1, n) if context.params.chain}
    if context.params.trouble == "cycle":
        after[0] = (f"run-{n - 1}",)
    params = context.params
    asked = params.gpus or params.memory_mib
    resources = Resources(1.0, params.gpus, params.memory_mib << 20) if asked else None
    return [Task(f"run-{i}", {"i": i}, after.get(i, ()), (i, i + 1), 1.0 + i % 2, resources) for i in range(n)]


def _draw(task: Task, context: Any) -> TaskResult:
    params = context.params
    if task.key == "run-1":
        _trouble(params)
    deadline = time.monotonic() + params.sleep_s
    while time.monotonic() < deadline:
        context.progress(1 - (deadline - time.monotonic()) / max(params.sleep_s, 1e-9))
        time.sleep(0.01)
    before = context.load("draw", task.after[0]) if task.after else b""
    drawn = before[-4:] + seeded(context.seed, task.args["i"]).bytes(8)
    context.save(task.key, drawn)
    context.segment = drawn
    return {"i": task.args["i"]}


def _trouble(params: ToyParams) -> None:
    first = bool(params.mark) and not Path(params.mark).exists()
    if first:
        Path(params.mark).touch()
    if params.trouble == "raise" or (params.trouble == "once" and first):
        raise RuntimeError("the cat sat on the keyboard")
    if params.trouble == "bad-input":
        raise BadInput("No cat in the picture.", field="inputs.data", remedy="Add a cat.")
    if params.trouble == "full" and first:
        raise StorageFull("The disk is full.", remedy="Free some space.")
    if params.trouble == "descriptors" and first:
        raise OSError(errno.EMFILE, "Too many open files")
    if params.trouble == "away" and first:
        raise StorageError("S3 does not answer.")
    if params.trouble == "die" and first:
        os.kill(os.getpid(), signal.SIGKILL)
    if params.trouble in HANGS and first:
        HANGS[params.trouble]()


class Toy(Method):
    name: ClassVar[str] = "toy"
    title: ClassVar[str] = "Toy"
    summary: ClassVar[str] = "Draws random bytes."
    paper: ClassVar[str] = "nobody"
    Params: ClassVar[type[Params]] = ToyParams
    inputs: ClassVar[tuple[InputSpec, ...]] = (
        InputSpec("data", "json", True, "Data", "Anything."),
        InputSpec("reference", "image", False, "Reference", "Colours."),
        InputSpec("video", "video", False, "Video", "A video."),
    )
    steps: ClassVar[tuple[Step[Any], ...]] = (
        Step("analyze", "Analyze", _plan_analysis, _analyze),
        Step("draw", "Draw", _plan_draw, _draw),
    )
    artefacts: ClassVar[tuple[str, ...]] = ("svg",)


METHODS: dict[str, type[Method]] = {"toy": Toy, "relay": Relay}
"""Methods by name. A worker on a Ray cluster has its own registry of methods."""


class _Context:
    def __init__(self, blobs: Blobs, order: TaskOrder, report: ProgressReport, cancelled: Callable[[], bool]):
        self.params = METHODS[order.method].Params(**order.params)
        self.seed = order.seed
        self.artefacts: dict[str, str] = {}
        self.segment: bytes | None = None
        self._blobs, self._order, self._report, self._cancelled = blobs, order, report, cancelled

    def progress(self, done: float) -> None:
        if self._cancelled():
            raise Cancelled("Stopped.")
        self._report(done)

    def save(self, name: str, data: bytes) -> None:
        key = f"jobs/{self._order.job_id}/{self._order.attempt_id}/{name}.npz"
        self._blobs.put(key, data)
        self.artefacts[f"{self._order.step}/{name}"] = key

    def load(self, step: str, name: str) -> bytes:
        return self._blobs.get(self._order.artefacts[f"{step}/{name}"])


class ToyRunner:
    """Replaces Renderer: never raises, and returns an outcome."""

    def __init__(self, blobs: Blobs) -> None:
        self._blobs = blobs

    def run(self, order: TaskOrder, report: ProgressReport, cancelled: Callable[[], bool]) -> TaskOutcome:
        try:
            return self._assemble(order) if order.step == ASSEMBLE else self._step(order, report, cancelled)
        except Exception as error:
            return failed_outcome(order.attempt_id, error)

    def close(self) -> None: ...

    def warm_up(self, stopped: Callable[[], bool]) -> None: ...

    @property
    def pid(self) -> int:
        return os.getpid()

    def kill(self) -> None: ...

    def _step(self, order: TaskOrder, report: ProgressReport, cancelled: Callable[[], bool]) -> TaskOutcome:
        began = time.monotonic()
        context = _Context(self._blobs, order, report, cancelled)
        step = next(step for step in METHODS[order.method].steps if step.name == order.step)
        task = Task(order.key, order.args, order.after, order.emits)
        result = step.run(task, context)
        key = f"jobs/{order.job_id}/{order.attempt_id}/segment" if context.segment is not None else None
        if key is not None and context.segment is not None:
            self._blobs.put(key, context.segment)
        stages = {"method": time.monotonic() - began, "decode": 0.0, "encode": 0.0}
        return TaskOutcome(order.attempt_id, result, context.artefacts, {}, key, stages, f"ran {order.key}\n")

    def _assemble(self, order: TaskOrder) -> TaskOutcome:
        key = f"jobs/{order.job_id}/{order.attempt_id}/result"
        self._blobs.put(key, b"".join(self._blobs.get(segment) for _, _, segment in order.segments))
        return TaskOutcome(order.attempt_id, {}, {}, {"result": (key, "video/mp4")}, None, {}, "joined\n")


def runner_after(slow: Path, blobs: Blobs) -> ToyRunner:
    """A runner that takes eight seconds to make while the file `slow` exists."""
    if slow.exists():
        time.sleep(8)
    return ToyRunner(blobs)


class WatchedBlobs(DiskBlobs):
    """Records which artefacts are fetched from the store."""

    def get(self, key: str) -> bytes:
        if key.endswith(".npz"):
            with (self.root.parent / "fetched").open("a") as file:
                file.write(f"{key}\n")
        return super().get(key)
