"""An in-memory task context for the analogy method, and functions that run its plan on one worker."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from numpy.typing import NDArray

from pipeline.frames import Frame, Plane
from pipeline.methods.analogy import Analogy, AnalogyParams
from pipeline.methods.base import Arrays, PlanContext, TaskResult, VideoInfo
from pipeline.perception.cuts import thumbnail


class Memory:
    """An in-memory task context that measures the wall seconds of each stage."""

    def __init__(
        self, params: AnalogyParams, inputs: Mapping[str, list[Frame]], files: Mapping[str, bytes] | None = None,
        numbered: Mapping[str, Mapping[int, NDArray[Any]]] | None = None,
    ) -> None:  # fmt: skip
        self.params, self.seed, self.inputs = params, 0, inputs
        self._files, self._numbered = files or {}, numbered or {}
        height, width = inputs["video"][0].shape[:2]
        self.size = (width, height)
        count = len(inputs["video"])
        self.video = VideoInfo(width, height, count, 25.0, count / 25)
        self.step = ""
        self.kept: dict[tuple[str, str], dict[str, NDArray[Any]]] = {}
        self.painted: dict[int, Frame] = {}
        self.stages: dict[str, float] = defaultdict(float)

    def frames(self, name: str = "video", start: int | None = None, stop: int | None = None) -> Iterator[Frame]:
        return iter(self.inputs[name][start:stop])

    deep = paints_opacity = False

    def deep_frames(self, name: str = "video", start: int | None = None, stop: int | None = None) -> Iterator[Frame]:
        return self.frames(name, start, stop)

    def mattes(self, start: int, stop: int) -> None:
        return None

    def thumbnails(self, name: str = "video", start: int | None = None, stop: int | None = None) -> Iterator[Plane]:
        return map(thumbnail, self.frames(name, start, stop))

    def has(self, name: str) -> bool:
        return name in self.inputs or name in self._numbered

    def image(self, name: str) -> Frame:
        return self.inputs[name][0]

    def json(self, name: str) -> Any:
        raise KeyError(name)

    def images(self, name: str) -> Mapping[int, NDArray[Any]]:
        return self._numbered[name]

    def entries(self, name: str) -> Mapping[str, bytes]:
        return self._files if name == "video" else {}

    def passes(self) -> Mapping[str, bytes]:
        return self._files

    pass_facts: Mapping[str, Any] = {}

    def wants_pass(self, name: str) -> bool:
        return False

    def emit_passes(self, index: int, made: Arrays) -> None: ...

    def save(self, name: str, arrays: Arrays) -> None:
        self.kept[self.step, name] = dict(arrays)

    def load(self, step: str, name: str) -> dict[str, NDArray[Any]]:
        return self.kept[step, name]

    def save_file(self, name: str, data: bytes, media_type: str) -> None: ...

    def wants(self, artefact: str) -> bool:
        return False

    def emit(self, index: int, frame: Frame) -> None:
        self.painted[index] = frame

    def warn(self, message: str) -> None: ...

    def show(self, frame: Frame) -> None: ...

    def progress(self, done: float) -> None: ...

    @contextmanager
    def clock(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.stages[stage] += time.perf_counter() - start


def render(context: Memory) -> list[Frame]:
    """Run the whole plan on one worker; returns the frames."""
    results: dict[str, dict[str, TaskResult]] = {}
    for step in Analogy.steps:
        context.step, results[step.name] = step.name, {}
        for task in step.plan(PlanContext(context.params, 0, context.video, frozenset(context.inputs), results)):
            results[step.name][task.key] = step.run(task, context)
    return [context.painted[index] for index in sorted(context.painted)]


def some(context: Memory, which: Sequence[int]) -> None:
    """Run the scan and the given tasks of the step `synthesise`, as one of several workers does."""
    scan, synthesise = Analogy.steps[:2]
    results: dict[str, dict[str, TaskResult]] = {}
    for step in (scan, synthesise):
        context.step, results[step.name] = step.name, {}
        tasks = step.plan(PlanContext(context.params, 0, context.video, frozenset(context.inputs), results))
        for task in tasks if step is scan else [tasks[index] for index in which]:
            results[step.name][task.key] = step.run(task, context)
