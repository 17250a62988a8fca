"""A method run in memory: a task context over arrays, and a plan runner.

Used by the library call, previews, benchmarks, notebooks and tests. The farm uses a task context over blobs instead.
"""

from __future__ import annotations

import random
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Generic, Protocol, TypeAlias, cast

import numpy as np
from pydantic import JsonValue

from pipeline.arrays import AnyArray, Arrays, State
from pipeline.errors import BadParameter
from pipeline.frames import Frame, Plane
from pipeline.methods.base import AnyParams, Method, P, PlanContext, Task, TaskResult, VideoInfo, no_clock
from pipeline.methods.plan_check import check_plan, dependencies
from pipeline.perception.cuts import thumbnail

DEFAULT_FPS = 25.0


class FrameSource(Protocol):
    """A video that can be read from any frame on, more than once."""

    @property
    def info(self) -> VideoInfo: ...

    def read(self, start: int, stop: int | None) -> Iterator[Frame]:
        """Frames [start, stop), uint8 (height, width, 3), one at a time."""
        ...


Input: TypeAlias = Sequence[Frame] | FrameSource | Mapping[int, AnyArray] | Mapping[str, bytes] | JsonValue
"""An input in memory; its kind determines which of these it is."""


class LocalContext(Generic[P]):
    """`pipeline.methods.base.TaskContext` in memory.

    It applies the farm's rules: a task loads only the artefacts that its `after` allows, saves a name once, and emits
    a frame once.

    Args:
        params: the method's Params.
        video: frames, uint8 (height, width, 3), all of one size; or a source of them.
        inputs: the other inputs by name: a list of frames (kinds "video", "image", "image-or-video"), a mapping from
            frame number to image ("images"), or a parsed document ("json"). The files of an archive are given as
            "<name>.entries", a mapping from path to bytes; those of a video with larger frames as "video.passes".
            What is known about its passes is "video.pass_facts", `PassFacts.as_json`.
        artefacts: names of the optional artefacts to make.
        piece: frames [first, end) of the video to paint; None: all. What is emitted for others is dropped.
        deep, paints_opacity: as in `TaskContext`. The opacity of the source is the input "matte", if it is given.

    Attributes:
        emitted: frames by index, until they are taken out.
        files: files that tasks saved, by name.
        passes_wanted: names of the passes to make.
        made_passes: the passes by frame and name, until they are taken out.
        results: results of the tasks that ran, by step name and key.
    """

    def __init__(
        self, params: P, video: Sequence[Frame] | FrameSource, inputs: Mapping[str, Input] | None = None, seed: int = 0,
        artefacts: frozenset[str] = frozenset(), piece: tuple[int, int] | None = None, deep: bool = False,
        paints_opacity: bool = False,
    ) -> None:  # fmt: skip
        self.params, self.seed, self.artefacts = params, seed, artefacts
        self.deep, self.paints_opacity = deep, paints_opacity
        self.inputs: dict[str, Input] = {"video": video, **(inputs or {})}
        self.video = _info(video) if piece is None else piece_info(_info(video), piece, params.lead_frames)
        self.size = (self.video.width, self.video.height)
        self.files: dict[str, bytes] = {}
        self.emitted: dict[int, AnyArray] = {}
        self.passes_wanted: frozenset[str] = frozenset()
        self.made_passes: dict[int, State] = {}
        self.kept: dict[tuple[str, str], State] = {}
        self.results: dict[str, dict[str, TaskResult]] = {}
        self.warnings: list[str] = []
        self.step = ""
        self.task: Task | None = None
        self._makers: dict[tuple[str, str], str] = {}

    def frames(self, name: str = "video", start: int | None = None, stop: int | None = None) -> Iterator[Frame]:
        source = cast("Sequence[Frame] | FrameSource", self._input(name))
        if name == "video" and self.video.is_piece:
            stop = self.video.stop if stop is None else stop
            start = self.video.first if start is None else start
        frames = source[start:stop] if isinstance(source, Sequence) else source.read(start or 0, stop)
        return (frame.copy() for frame in frames)

    def deep_frames(self, name: str = "video", start: int | None = None, stop: int | None = None) -> Iterator[AnyArray]:
        read = getattr(self._input(name), "read_deep", None)
        return read(start or 0, stop) if self.deep and read is not None else self.frames(name, start, stop)

    def mattes(self, start: int, stop: int) -> Iterator[AnyArray] | None:
        return self.frames("matte", start, stop) if self.has("matte") else None

    def thumbnails(self, name: str = "video", start: int | None = None, stop: int | None = None) -> Iterator[Plane]:
        return map(thumbnail, self.frames(name, start, stop))

    def has(self, name: str) -> bool:
        return name in self.inputs

    def image(self, name: str) -> Frame:
        return next(self.frames(name, 0, 1))

    def json(self, name: str) -> JsonValue:
        return cast("JsonValue", self._input(name))

    def images(self, name: str) -> Mapping[int, AnyArray]:
        return cast("Mapping[int, AnyArray]", self._input(name))

    def entries(self, name: str) -> Mapping[str, bytes]:
        return cast("Mapping[str, bytes]", self.inputs.get(f"{name}.entries", {}))

    def passes(self) -> Mapping[str, bytes]:
        return cast("Mapping[str, bytes]", self.inputs.get("video.passes", self.entries("video")))

    @property
    def pass_facts(self) -> Mapping[str, JsonValue]:
        return cast("Mapping[str, JsonValue]", self.inputs.get("video.pass_facts", {}))

    def _input(self, name: str) -> Input:
        if name not in self.inputs:
            raise BadParameter(
                f"The input {name!r} is missing.", field=f"inputs.{name}", remedy=f"Give the input {name!r}."
            )
        return self.inputs[name]

    def save(self, name: str, arrays: Arrays) -> None:
        if (self.step, name) in self.kept:
            raise ValueError(f"the artefact {self.step}/{name} is saved twice")
        self._makers[self.step, name] = self.task.key if self.task else ""
        self.kept[self.step, name] = {key: np.array(array) for key, array in arrays.items()}

    def load(self, step: str, name: str) -> State:
        if self.task is not None:
            named = {self.step: set[str](), **dependencies(self.task.after, self.step)}
            if step in named and self._makers.get((step, name)) not in named[step]:
                raise KeyError(f"{step}/{name}: task {self.task.key!r} does not name its maker in `after`")
        return {key: array.copy() for key, array in self.kept[step, name].items()}

    def forget(self, step: str, keys: Collection[str]) -> None:
        """Drop the arrays that these tasks of a step have saved."""
        for at in [at for at, key in self._makers.items() if at[0] == step and key in keys]:
            self.kept.pop(at, None)

    def save_file(self, name: str, data: bytes, media_type: str) -> None:
        if name in self.files:
            raise ValueError(f"the file {name} is saved twice")
        self.files[name] = data

    def warn(self, message: str) -> None:
        self.warnings.append(message)

    def wants(self, artefact: str) -> bool:
        return artefact in self.artefacts

    def wants_pass(self, name: str) -> bool:
        return name in self.passes_wanted

    def emit_passes(self, index: int, made: Arrays) -> None:
        kept = self.made_passes.setdefault(index, {}) if self.video.delivers(index) else {}
        for name, array in made.items():
            if name in kept or name not in self.passes_wanted:
                raise ValueError(f"the pass {name} of frame {index} is made twice, or not wanted")
            kept[name] = np.array(array)

    def emit(self, index: int, frame: AnyArray) -> None:
        if index in self.emitted:
            raise ValueError(f"frame {index} is emitted twice")
        if self.video.delivers(index):
            self.emitted[index] = frame.copy()

    def show(self, frame: Frame) -> None:
        return

    def clock(self, stage: str) -> AbstractContextManager[None]:
        return no_clock(stage)

    def progress(self, done: float) -> None:
        return

    def planned(self, step: str, tasks: Sequence[Task]) -> None:
        """Called before the tasks of a step run."""


def required_inputs(method: Method, video: Sequence[Frame]) -> dict[str, Input]:
    """Substitutes for the inputs that a method requires besides the video, for benchmarks and tests of every method.

    Args:
        video: frames for each required input of kind "video".
    """
    return {spec.name: video for spec in method.inputs[1:] if spec.required and spec.kind == "video"}


def run_plan(method: Method, context: LocalContext[AnyParams], shuffle: int | None = None) -> dict[str, list[Task]]:
    """Run a method's whole plan in this thread.

    Args:
        shuffle: seed of a random order of the tasks that respects their dependencies; None: the order of the plan.

    Returns:
        The tasks of each step, by step name, in the order in which they ran. Frames are in `context.emitted`.
    """
    done: dict[str, list[Task]] = {step.name: [] for step in method.steps_of(context.params)}
    for step, task in iterate_plan(method, context, shuffle):
        done[step].append(task)
    return done


def iterate_plan(
    method: Method, context: LocalContext[AnyParams], shuffle: int | None = None, steps: int | None = None,
    forget: bool = False,
) -> Iterator[tuple[str, Task]]:  # fmt: skip
    """Run a method's plan task by task: (step name, task) after each, so that emitted frames can be taken out.

    Args:
        shuffle: as for `run_plan`.
        steps: how many steps to run; None: all.
        forget: drop the arrays of a task of the last of these steps once no other task of it needs them.

    Raises: PlanError, if the method plans tasks that cannot be run.
    """
    results = context.results = {}
    order: dict[str, int] = {}
    method_steps = method.steps_of(context.params)
    for step in method_steps[:steps]:
        plan_context = PlanContext(context.params, context.seed, context.video, frozenset(context.inputs), results)
        tasks = step.plan(plan_context)
        check_plan(tasks, step.name, results, [one.name for one in method_steps])
        context.planned(step.name, tasks)
        results[step.name] = {}
        for task in tasks:
            order[f"{step.name}/{task.key}"] = len(order)
        last = forget and step is method_steps[:steps][-1]
        unfinished = {task.key: task for task in tasks}
        for task in _in_order(tasks, step.name, shuffle):
            context.step, context.task = step.name, replace(task, after=in_plan_order(task.after, step.name, order))
            results[step.name][task.key] = step.run(context.task, context)
            yield step.name, task
            del unfinished[task.key]
            if last:
                needed = {name for other in unfinished.values() for name in other.after} | unfinished.keys()
                context.forget(step.name, results[step.name].keys() - needed)


def in_plan_order(after: Sequence[str], step: str, order: Mapping[str, int]) -> tuple[str, ...]:
    """`Task.after` in plan order. `order`: place in the plan by "step/key"."""
    return tuple(sorted(set(after), key=lambda name: order[name if "/" in name else f"{step}/{name}"]))


def _in_order(tasks: Sequence[Task], step: str, shuffle: int | None) -> Iterator[Task]:
    waiting, done = list(tasks), set[str]()
    draw = random.Random(shuffle)  # noqa: S311 (an order of tasks, no secret)
    while waiting:
        ready = [task for task in waiting if dependencies(task.after, step).get(step, set()) <= done]
        task = ready[0] if shuffle is None else draw.choice(ready)
        waiting.remove(task)
        done.add(task.key)
        yield task


def piece_info(video: VideoInfo, piece: tuple[int, int], lead: int) -> VideoInfo:
    """Facts for painting frames [first, end) of a film, and up to `lead` frames before them."""
    first, stop = max(0, piece[0] - lead), min(piece[1], video.frames or piece[1])
    seconds = video.duration_s * (stop - first) / video.frames if video.frames else 0.0
    return replace(
        video, frames=max(0, stop - first), duration_s=seconds, first=first, film=video.frames, lead=piece[0] - first
    )


def _info(video: Sequence[Frame] | FrameSource) -> VideoInfo:
    if not isinstance(video, Sequence):
        return video.info
    height, width = video[0].shape[:2] if video else (16, 16)
    return VideoInfo(width, height, len(video), DEFAULT_FPS, len(video) / DEFAULT_FPS)
