"""A method of three steps whose last step loads artefacts of the first one directly."""

from __future__ import annotations

from typing import Any, ClassVar

from pydantic import Field

from pipeline.methods.base import InputSpec, Method, Params, PlanContext, Step, Task, TaskResult


class RelayParams(Params):
    tasks: int = Field(default=4, ge=0)
    after: tuple[str, ...] = ()
    """The `after` of the first task of the last step, instead of its real dependencies."""
    load: str = ""
    """An additional artefact of the step "scan" that tasks of the last step load; "" for none."""


def _scan(task: Task, context: Any) -> TaskResult:
    context.save(task.key, b"%d" % task.args["value"])
    return {}


def _draw(task: Task, context: Any) -> TaskResult:
    context.save(task.key, b"[" + context.load("scan", "even") + context.load("scan", "odd") + b"]")
    return {}


def _plan_mix(context: PlanContext[RelayParams]) -> list[Task]:
    """A chain; every task names the scan that it needs, the drawing of its number and the task before it."""
    params = context.params
    tasks = [Task(f"mix-{i}", {"i": i}, _after(i), (i, i + 1)) for i in range(params.tasks)]
    if params.after and tasks:
        tasks[0] = Task("mix-0", {"i": 0}, params.after, (0, 1))
    return tasks


def _after(i: int) -> tuple[str, ...]:
    earlier = (f"scan/{_parity(i)}", f"draw/run-{i}")
    return (*earlier, f"mix-{i - 1}") if i else earlier


def _parity(i: int) -> str:
    return "odd" if i % 2 else "even"


def _mix(task: Task, context: Any) -> TaskResult:
    i = task.args["i"]
    drawn = context.load("scan", _parity(i)) + context.load("draw", f"run-{i}")
    if context.params.load:
        context.load("scan", context.params.load)
    if i:
        drawn += context.load("mix", f"mix-{i - 1}")[:1]
    context.save(task.key, drawn)
    context.segment = drawn
    return {"after": list(task.after)}


class Relay(Method):
    name: ClassVar[str] = "relay"
    title: ClassVar[str] = "Relay"
    summary: ClassVar[str] = "Writes numbers."
    paper: ClassVar[str] = "nobody"
    Params: ClassVar[type[Params]] = RelayParams
    inputs: ClassVar[tuple[InputSpec, ...]] = (InputSpec("data", "json", True, "Data", "Anything."),)
    steps: ClassVar[tuple[Step[Any], ...]] = (
        Step("scan", "Scan", lambda context: [Task("even", {"value": 0}), Task("odd", {"value": 1})], _scan),
        Step("draw", "Draw", lambda context: [Task(f"run-{i}") for i in range(context.params.tasks)], _draw),
        Step("mix", "Mix", _plan_mix, _mix),
    )
