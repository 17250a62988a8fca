"""The local runner: dependencies on tasks of earlier steps."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest

from pipeline.methods.base import InputSpec, Method, Params, Step, Task, TaskResult
from pipeline.methods.local import LocalContext, run_plan
from pipeline.methods.plan_check import PlanError


def _save(task: Task, context: Any) -> TaskResult:
    context.save(task.key, {"value": np.array(len(task.key))})
    return {}


def _load(task: Task, context: Any) -> TaskResult:
    return {"after": list(task.after), "value": int(context.load("first", context.params.load)["value"])}


class LoadParams(Params):
    after: tuple[str, ...] = ("last-0", "first/bb", "first/a")
    load: str = "bb"


class Loads(Method):
    name: ClassVar[str] = "loads"
    title: ClassVar[str] = "Loads"
    summary: ClassVar[str] = "Loads artefacts of the first of three steps."
    paper: ClassVar[str] = "nobody"
    Params: ClassVar[type[Params]] = LoadParams
    inputs: ClassVar[tuple[InputSpec, ...]] = ()
    steps: ClassVar[tuple[Step[Any], ...]] = (
        Step("first", "First", lambda context: [Task("a"), Task("bb"), Task("ccc")], _save),
        Step("second", "Second", lambda context: [], _save),
        Step("last", "Last", lambda context: [Task("last-0"), Task("last-1", after=context.params.after)], _load),
    )


def _context(**params: Any) -> LocalContext[LoadParams]:
    return LocalContext(LoadParams(**params), [np.zeros((16, 16, 3), np.uint8)])


@pytest.mark.parametrize("shuffle", [None, 1, 2])
def test_dependencies_are_given_in_plan_order(shuffle: int | None) -> None:
    ran = run_plan(Loads(), context := _context(), shuffle)
    assert [task.key for task in ran["last"]] == ["last-0", "last-1"]
    assert context.task is not None
    assert context.task.after == ("first/a", "first/bb", "last-0")


def test_an_artefact_of_a_step_is_withheld_when_other_tasks_of_it_are_named() -> None:
    with pytest.raises(KeyError, match="first/ccc: task 'last-1' does not name its maker"):
        run_plan(Loads(), _context(load="ccc"))


def test_an_unknown_dependency_is_refused() -> None:
    with pytest.raises(PlanError, match="The step 'first' has no task 'd'"):
        run_plan(Loads(), _context(after=("first/d",)))
