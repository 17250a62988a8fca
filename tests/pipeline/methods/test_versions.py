"""A step whose formats have changed has another version, so that no program continues from what it cannot read.

The formats are recorded in formats.json: names and types in a step's task args, results and artefacts; for the first
step also the parameters and the list of steps. `python -m tests.pipeline.methods.test_versions` records them.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Arrays
from pipeline.frames import Frame
from pipeline.method_names import BUILT_IN
from pipeline.methods import method, parse_params
from pipeline.methods.base import AnyParams, Method, Task
from pipeline.methods.local import LocalContext, iterate_plan, required_inputs

RECORDED = Path(__file__).with_name("formats.json")
WIDTH, HEIGHT, FRAMES = 64, 48, 8
REMEDY = (
    "The formats of the step {step!r} of {method!r} have changed: {change}. Raise the step's `version` in its `Step`; "
    "if this program still reads the old formats, name the old version in `reads`. Then record the new ones: "
    "python -m tests.pipeline.methods.test_versions"
)


class _Recorder(LocalContext[AnyParams]):
    """Records the artefacts of each step."""

    saved: dict[str, set[str]]

    def save(self, name: str, arrays: Arrays) -> None:
        super().save(name, arrays)
        found = self.saved.setdefault(self.step, set())
        for key, array in arrays.items():
            value = np.asarray(array)
            found.add(f"{_name(name)}: {_name(key)} {value.dtype.kind}{value.dtype.itemsize} {value.ndim}d")


def _name(name: str) -> str:
    return re.sub(r"\d+", "#", name)


def _shape(value: Any, path: str = "") -> set[str]:
    """Paths and types of a JSON value; numbers in names are replaced, because they count frames and regions."""
    if isinstance(value, dict):
        return {f"{path}{{}}"}.union(*(_shape(part, f"{path}.{_name(key)}") for key, part in value.items()))
    if isinstance(value, list | tuple):
        return {f"{path}[]"}.union(*(_shape(part, f"{path}[]") for part in value))
    kind = "number" if isinstance(value, int | float) and not isinstance(value, bool) else type(value).__name__
    return {f"{path} {kind}"}


def _video() -> list[Frame]:
    """A square that moves over a ramp, in two shots."""
    frames = []
    for index in range(FRAMES):
        frame = np.empty((HEIGHT, WIDTH, 3), np.uint8)
        frame[...] = np.linspace(20, 200, WIDTH, dtype=np.uint8)[:, None]
        frame[12:28, 4 + 3 * index : 20 + 3 * index] = (230, 180, 60)
        frames.append(frame if index < FRAMES // 2 else 255 - frame)
    return frames


def formats_of(chosen: Method) -> dict[str, dict[str, Any]]:
    """Step -> version and formats, from a run with defaults and every optional artefact."""
    params, video = parse_params(chosen, {}), _video()
    context = _Recorder(params, video, required_inputs(chosen, video), artefacts=frozenset(chosen.artefacts))
    context.saved = {}
    tasks: dict[str, list[Task]] = {}
    for name, task in iterate_plan(chosen, context):
        tasks.setdefault(name, []).append(task)
    found: dict[str, dict[str, Any]] = {}
    for step in chosen.steps_of(params):
        args = set().union(*(_shape(task.args) for task in tasks.get(step.name, [])))
        results = set().union(*(_shape(result) for result in context.results[step.name].values()))
        formats = {
            "args": sorted(args),
            "results": sorted(results),
            "artefacts": sorted(context.saved.get(step.name, ())),
        }
        found[step.name] = {"version": step.version, "formats": formats}
    first = found[chosen.steps_of(params)[0].name]["formats"]
    first["parameters"], first["steps"] = sorted(chosen.Params.model_fields), list(found)
    return found


@pytest.mark.parametrize("name", BUILT_IN)
def test_a_step_whose_formats_have_changed_has_another_version(name: str) -> None:
    recorded = json.loads(RECORDED.read_text()).get(name, {})
    now = formats_of(method(name))
    for step, found in now.items():
        before = recorded.get(step, {"version": 0, "formats": {}})
        change = _change(before["formats"], found["formats"])
        if found["version"] == before["version"]:
            assert not change, REMEDY.format(step=step, method=name, change=change)
        assert found["version"] >= before["version"], "a version never falls"
    assert now == recorded, "record the formats: python -m tests.pipeline.methods.test_versions"


def _change(before: dict[str, list[str]], now: dict[str, list[str]]) -> str:
    lines = (
        f"{part}: {'-' if line in before.get(part, ()) else '+'} {line}"
        for part in now
        for line in sorted(set(before.get(part, ())) ^ set(now[part]))
    )
    return "; ".join(lines)


def test_a_forgotten_version_is_noticed() -> None:
    formats = {"args": ["{}", ".shot number"], "results": []}
    assert _change(formats, {"args": ["{}", ".shot number", ".age number"], "results": []}) == "args: + .age number"
    assert _change(formats, {"args": ["{}"], "results": []}) == "args: - .shot number"
    assert not _change(formats, formats)


if __name__ == "__main__":
    RECORDED.write_text(json.dumps({name: formats_of(method(name)) for name in BUILT_IN}, indent=1) + "\n")
