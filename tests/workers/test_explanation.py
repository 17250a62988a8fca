"""The plan of a job before it runs, against the plan of a real run; and the replay of tasks with several threads."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.base import Method
from pipeline.methods.local import LocalContext, iterate_plan, required_inputs
from workers.contract.request import JobRequest
from workers.jobs.replay import TimedTask, critical_path, replayed
from workers.scheduling.explanation import Explanation, explained

SIZE, FRAMES = (64, 48), 14


def _video() -> list[Frame]:
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    return [np.dstack([x * 3, y * 4, np.full_like(x, 90)]).astype(np.uint8) + np.uint8(n) for n in range(FRAMES)]


def _run(chosen: Method, params: dict[str, Any] | None = None) -> tuple[dict[str, set[str]], dict[str, Any]]:
    """Step -> keys of the tasks of a real run, without numbers; the results."""
    video = _video()
    context = LocalContext(parse_params(chosen, params or {}), video, required_inputs(chosen, video))
    keys: dict[str, set[str]] = {}
    for step, task in iterate_plan(chosen, context):
        keys.setdefault(step, set()).add(re.sub(r"\d+", "N", task.key))
    return keys, context.results


def _explained(chosen: Method, results: dict[str, Any], params: dict[str, Any] | None = None) -> Explanation:
    """The explanation after the first step of that run."""
    inputs = {"video": "", **dict.fromkeys(required_inputs(chosen, []), "")}
    info = {"video": {"width": SIZE[0], "height": SIZE[1], "frames": FRAMES, "fps": 25.0, "duration_s": FRAMES / 25}}
    first = chosen.steps[0].name
    return explained(JobRequest(chosen.name, inputs, params or {}), info, {first: results[first]}, 100.0)


@pytest.mark.parametrize("name", ["abstraction", "multistyle", "steady"])
def test_an_explanation_has_the_tasks_of_the_real_run(name: str) -> None:
    keys, results = _run(method(name))
    found = _explained(method(name), results)
    planned: dict[str, set[str]] = {}
    for kind in found.kinds:
        planned.setdefault(kind.step, set()).add(kind.kind)
    assert planned.pop("assemble") == {"assemble"}
    assert planned == keys
    assert not any(kind.expected for kind in found.kinds)
    assert sum(kind.cpu_s for kind in found.kinds) == pytest.approx(100, abs=0.1)


def test_steps_that_depend_on_others_are_planned_from_typical_results() -> None:
    patches = method("patches")
    _, results = _run(patches)
    found = _explained(patches, results)
    assert {kind.step for kind in found.kinds if kind.expected} == {"register", "patch", "paint"}
    assert {kind.step for kind in found.kinds if not kind.expected} == {"scan", "cluster", "assemble"}


def test_more_processors_never_take_longer_nor_less_than_the_critical_path() -> None:
    for name in ("abstraction", "multistyle", "patches"):
        _, results = _run(method(name))
        found = _explained(method(name), results)
        seconds = [each.seconds for each in found.durations]
        assert [each.processors for each in found.durations] == [1, 2, 4, 8, 16, 64]
        assert seconds == sorted(seconds, reverse=True)
        assert seconds[-1] >= found.path_s - 0.01
        assert seconds[0] >= found.cpu_s - 0.01


def test_a_plan_that_depends_on_what_is_found_is_refused() -> None:
    multistyle = method("multistyle")
    _, results = _run(multistyle)
    facts = {**results["scan"]["video"], "maps": True, "tubes": True, "channels": {}}
    with pytest.raises(BadParameter, match="'regions'"):
        _explained(multistyle, {"scan": {"video": facts}})


def test_a_task_with_threads_uses_idle_processors() -> None:
    task = TimedTask(0, "a", 6.0, threads=3.0)
    assert [replayed([task], count, 0.0) for count in (1, 2, 3, 64)] == pytest.approx([6.0, 3.0, 2.0, 2.0])


def test_running_tasks_share_the_processors() -> None:
    tasks = [TimedTask(0, "a", 6.0, threads=3.0), TimedTask(0, "b", 2.0)]
    assert replayed(tasks, 2, 0.0) == pytest.approx(3.0 + 2.0), "the first task keeps both processors busy"
    assert replayed(tasks, 4, 0.0) == pytest.approx(2.0)


def test_the_critical_path_follows_the_slowest_dependency_through_all_steps() -> None:
    tasks = [
        TimedTask(0, "scan", 1.0),
        TimedTask(1, "flow", 4.0, threads=4.0), TimedTask(1, "faces", 2.0),
        TimedTask(1, "paint", 3.0, ("flow", "faces")), TimedTask(1, "other", 4.5),
    ]  # fmt: skip
    assert [task.key for task in critical_path(tasks)] == ["scan", "faces", "paint"]
