"""A bench in memory, and the plan runner of a farm in twenty lines."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.methods.base import Arrays, Brief, Method, Note, Params, Task, VideoInfo


class FakeBench:
    """`pipeline.methods.base.Bench` over lists; keeps copies, as a blob store would."""

    def __init__(
        self, params: Params, frames: list[Frame], inputs: Mapping[str, Any] | None = None, seed: int = 0,
        artefacts: frozenset[str] = frozenset(),
    ) -> None:  # fmt: skip
        self.params, self.seed, self.artefacts = params, seed, artefacts
        self.inputs: dict[str, Any] = {"video": frames, **(inputs or {})}
        height, width = frames[0].shape[:2] if frames else (16, 16)
        self.size = (width, height)
        self.video = VideoInfo(width, height, len(frames), 25.0, len(frames) / 25)
        self.step = ""
        self.task: Task | None = None
        self.makers: dict[tuple[str, str], str] = {}
        self.kept: dict[tuple[str, str], dict[str, NDArray[Any]]] = {}
        self.files: dict[str, bytes] = {}
        self.emitted: dict[int, Frame] = {}
        self.order: list[int] = []
        self.done: list[float] = []
        self.shown = 0

    def frames(self, name: str = "video", start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        return iter([frame.copy() for frame in self.inputs[name][start:stop]])

    def has(self, name: str) -> bool:
        return name in self.inputs

    def image(self, name: str) -> Frame:
        return next(self.frames(name))

    def json(self, name: str) -> Any:
        return self.inputs[name]

    def images(self, name: str) -> Mapping[int, NDArray[Any]]:
        found: Mapping[int, NDArray[Any]] = self.inputs[name]
        return found

    def entries(self, name: str) -> Mapping[str, bytes]:
        found: Mapping[str, bytes] = self.inputs.get(f"{name}.entries", {})
        return found

    def show(self, frame: Frame) -> None:
        assert frame.ndim == 3 and frame.dtype == np.uint8
        self.shown += 1

    def save(self, name: str, arrays: Arrays) -> None:
        assert (self.step, name) not in self.kept
        self.makers[self.step, name] = self.task.key if self.task else ""
        self.kept[self.step, name] = {key: np.array(array) for key, array in arrays.items()}

    def load(self, step: str, name: str) -> dict[str, NDArray[Any]]:
        told = step != self.step or self.task is None or self.makers.get((step, name)) in self.task.after
        assert told, f"{name} is of a task that this one does not come after"
        return {key: array.copy() for key, array in self.kept[step, name].items()}

    def save_file(self, name: str, data: bytes, media_type: str) -> None:
        assert name not in self.files and media_type
        self.files[name] = data

    def wants(self, artefact: str) -> bool:
        return artefact in self.artefacts

    def emit(self, index: int, frame: Frame) -> None:
        assert index not in self.emitted
        self.emitted[index] = frame.copy()
        self.order.append(index)

    def clock(self, stage: str) -> AbstractContextManager[None]:
        assert stage
        return nullcontext()

    def progress(self, done: float) -> None:
        self.done.append(done)


def run_plan(chosen: Method, bench: FakeBench, shuffle: int | None = None) -> dict[str, list[Task]]:
    """Run a method's whole plan: in order, or in any order that its chains allow (`shuffle` = which)."""
    notes: dict[str, dict[str, Note]] = {}
    tasks: dict[str, list[Task]] = {}
    for step in chosen.steps:
        brief = Brief(bench.params, bench.seed, bench.video, frozenset(bench.inputs), notes)
        bench.step, tasks[step.name] = step.name, list(step.plan(brief))
        assert list(step.plan(brief)) == tasks[step.name], "a plan is a pure function of its brief"
        for task in ordered(tasks[step.name], shuffle):  # a step without tasks has no notes, as on the farm
            task = replace(task, after=tuple(sorted(task.after)))  # no method may count on their order
            bench.order, bench.task = [], task
            notes.setdefault(step.name, {})[task.key] = step.run(task, bench)
            assert bench.order == list(range(*task.emits)) if task.emits else not bench.order
    return tasks


def ordered(tasks: list[Task], shuffle: int | None) -> Iterator[Task]:
    waiting, done = list(tasks), set[str]()
    draw = random.Random(shuffle)
    while waiting:
        ready = [task for task in waiting if set(task.after) <= done]
        task = draw.choice(ready) if shuffle is not None else ready[0]
        waiting.remove(task)
        done.add(task.key)
        yield task


def painted(bench: FakeBench) -> NDArray[np.uint8]:
    """Every emitted frame in order, (n, h, w, 3)."""
    assert sorted(bench.emitted) == list(range(len(bench.emitted)))
    return np.stack([bench.emitted[index] for index in sorted(bench.emitted)])
