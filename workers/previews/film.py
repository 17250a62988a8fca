"""The film of a layer at the size of a preview: the tasks of its plan, as far as the wanted frames need them.

A preview shows what the film has, because it runs the film's own plan over the whole video, with the frame numbers,
keys and inputs of the film; only the pictures are smaller. What tasks save and emit stays in the cache, so that
another frame, or a later call, repeats nothing that is still there.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from graphlib import TopologicalSorter
from typing import cast

from pipeline.arrays import Arrays, State
from pipeline.errors import UnreadableMedia
from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.base import (
    AnyParams,
    Method,
    PlanContext,
    Step,
    Task,
    TaskResult,
)
from pipeline.methods.local import FrameSource, Input, in_plan_order
from pipeline.methods.plan_check import dependencies
from pipeline.methods.previews import FilmPlane, FilmPlaneKind
from workers.jobs.estimates import MeasuredPreview
from workers.jobs.wall_time import OneByOne
from workers.previews.artefact_files import ArtefactFiles
from workers.previews.byte_cache import ByteCache
from workers.previews.costs import StepCost, TaskClock, longest_chain, whole_cost
from workers.previews.inputs import layer_inputs
from workers.previews.memory import Check, PreviewTaskContext
from workers.previews.model import LayerSources
from workers.previews.warm import WarmFrames

Progress = Callable[[str, float], None]
"""Called with the title of a step and the fraction of its tasks, as far as the frame needs them, that is done."""
Name = tuple[str, str]
"""Step and key of a task, or step and name of an artefact."""
_PLAN_BYTES = 1 << 16


@dataclass(frozen=True)
class Kept:
    """What previews keep between calls: source frames, painted frames with other values, and artefacts."""

    sources: WarmFrames
    cache: ByteCache
    artefacts: ArtefactFiles


@dataclass
class _Plan:
    """The state of a film that is not pictures or arrays.

    Attributes:
        tasks, results: by step and key; of steps that are planned, and of tasks that ran.
        saved: names of the artefacts of each task that ran.
        costs: what the tasks that ran have cost, by step.
    """

    tasks: dict[str, dict[str, Task]] = field(default_factory=dict)
    results: dict[str, dict[str, TaskResult]] = field(default_factory=dict)
    saved: dict[Name, list[str]] = field(default_factory=dict)
    costs: dict[str, StepCost] = field(default_factory=dict)
    turn: threading.Lock = field(default_factory=threading.Lock)


class PreviewFilm:
    """Frames of a layer's film at a preview's size.

    Args:
        side_px: longest side of the pictures; the video is never enlarged.
        regions: computes the entries of the method's `regions_artefact` of the whole video.
    """

    def __init__(
        self, layer: LayerSources, kept: Kept, side_px: int, regions: Callable[[], Mapping[str, bytes]]
    ) -> None:
        info = kept.sources.info(layer.video)
        self.side_px = min(side_px, max(info.width, info.height))
        self.pixels = info.frames * info.width * info.height * (self.side_px / max(info.width, info.height)) ** 2
        """Of all frames together."""
        self._layer, self._kept, self._regions = layer, kept, regions
        self._name = ("film", layer.digest, self.side_px)

    def peek(self, number: int) -> Frame | None:
        """The frame, if it is painted already."""
        found: Frame | None = self._kept.cache.peek((*self._name, number))
        return None if found is None else found.copy()

    def cost(self) -> MeasuredPreview | None:
        """The cost of the whole film at this size, from the tasks that have run; None if none has, or if the plan is
        kept no more."""
        plan: _Plan | None = self._kept.cache.peek(self._name)
        if plan is None:
            return None
        info, chosen = self._kept.sources.info(self._layer.video), method(self._layer.method)
        weights, chains = dict[str, float](), dict[str, float]()
        for step in chosen.steps_of(parse_params(chosen, self._layer.params)):
            if (tasks := plan.tasks.get(step.name)) is None:
                weights[step.name] = chains[step.name] = step.weight * info.frames
            else:
                weights[step.name] = sum(task.weight for task in tasks.values())
                chains[step.name] = longest_chain(tasks)
        whole, chain = whole_cost(plan.costs, weights), whole_cost(plan.costs, chains)
        if whole is None or chain is None or not info.frames or not whole.cpu_s:
            return None
        one_by_one = OneByOne(whole.seconds / chain.seconds, max(0.0, whole.idle_s / whole.seconds))
        pixels = round(self.pixels / info.frames)
        return MeasuredPreview(dict(self._layer.params), info.frames, pixels, whole.seconds, whole.cpu_s, 0, one_by_one)

    def frames(
        self, numbers: Sequence[int], check: Check, progress: Progress = lambda note, done: None,
        painted: Callable[[int, Frame], None] = lambda number, picture: None,
    ) -> Iterator[tuple[int, Frame]]:  # fmt: skip
        """Yield these frames in order; the last frame of the film for later ones.

        Args:
            painted: called with every frame as soon as it is painted, also those that nobody asked for.

        Raises: the errors of `check`, of the method, and UnreadableMedia (the film has no frame at all).
        """
        with self._run(check, progress, painted) as run:
            for number in numbers:
                yield number, run.frame(number)

    def plane(
        self, kind: FilmPlaneKind, number: int, check: Check, progress: Progress = lambda note, done: None
    ) -> FilmPlane | None:
        """Regions or stroke directions that the film uses in a frame (`Method.film_plane`). Raises as `frames`."""
        with self._run(check, progress, lambda number, picture: None) as run:
            return method(self._layer.method).film_plane(kind, number, run)

    def _inputs(self, exit_stack: ExitStack) -> Mapping[str, Input]:
        inputs = layer_inputs(self._layer, self._kept.sources, self.side_px, exit_stack)
        info = self._kept.sources.info(self._layer.video)
        whole = self.side_px == max(info.width, info.height)
        return inputs if whole else method(self._layer.method).scaled_inputs(inputs, self._regions)

    @contextmanager
    def _run(self, check: Check, progress: Progress, painted: Callable[[int, Frame], None]) -> Iterator[_Run]:
        plan: _Plan = self._kept.cache.get(self._name, _Plan, lambda _: _PLAN_BYTES)
        while not plan.turn.acquire(timeout=0.02):
            check()
        try:
            with ExitStack() as exit_stack:
                inputs = self._inputs(exit_stack)
                store = _Store(self._kept, self._name, painted)
                yield _Run(self._layer, plan, store, _FilmContext(self._layer, inputs, check, store), progress)
        finally:
            self._kept.cache.put(self._name, plan, _PLAN_BYTES)  # it is used later than all that the run has kept
            plan.turn.release()


class _Store:
    """Artefacts and frames of a film that are kept, and those that a run needs in memory."""

    def __init__(self, kept: Kept, name: tuple[object, ...], painted: Callable[[int, Frame], None]) -> None:
        self._cache, self._artefacts, self._name, self._painted = kept.cache, kept.artefacts, name, painted
        self.held: dict[Name, State] = {}
        self.fresh: dict[int, Frame] = {}
        """Frames that the present task has emitted."""

    def has(self, name: Name) -> bool:
        return name in self.held or self._artefacts.has((*self._name, *name))

    def artefact(self, name: Name) -> State | None:
        """A copy of an artefact's arrays; None: they are kept no more."""
        if name in self.held:
            return {key: array.copy() for key, array in self.held[name].items()}
        return self._artefacts.get((*self._name, *name))

    def hold_only(self, names: set[Name]) -> None:
        """Drop all other artefacts from memory; their files stay."""
        self.held = {name: arrays for name, arrays in self.held.items() if name in names}

    def save(self, name: Name, arrays: Arrays) -> None:
        self.held[name] = {key: array.copy() for key, array in arrays.items()}
        self._artefacts.put((*self._name, *name), arrays)

    def frame(self, number: int) -> Frame | None:
        found: Frame | None = self.fresh.get(number)
        if found is None:
            found = self._cache.peek((*self._name, number))
        return None if found is None else found.copy()

    def emit(self, number: int, frame: Frame) -> None:
        kept = self.fresh[number] = frame.copy()
        self._cache.put((*self._name, number), kept, kept.nbytes)
        self._painted(number, kept)


class _FilmContext(PreviewTaskContext):
    """The task context of a film: artefacts and frames go to the store."""

    def __init__(self, layer: LayerSources, inputs: Mapping[str, Input], check: Check, store: _Store) -> None:
        params: AnyParams = parse_params(method(layer.method), layer.params)
        video, others = inputs["video"], {name: given for name, given in inputs.items() if name != "video"}
        super().__init__(check, params, cast("FrameSource", video), others, layer.seed)
        self._store = store
        self.told: Callable[[float], None] = lambda done: None
        self.saved: list[str] = []
        """Names of the artefacts that the present task has saved."""
        self.make: Callable[[str, str], None] = lambda step, name: None
        """Makes an artefact of a step on which the present task depends without naming the artefact's maker."""

    def save(self, name: str, arrays: Arrays) -> None:
        self._store.save((self.step, name), arrays)
        self.saved.append(name)

    def load(self, step: str, name: str) -> State:
        found = self._store.artefact((step, name))
        if found is None:
            self.make(step, name)
            found = self._store.artefact((step, name))
        if found is None:
            raise KeyError(f"{step}/{name}")
        return found

    def save_file(self, name: str, data: bytes, media_type: str) -> None:
        return

    def emit(self, index: int, frame: Frame) -> None:
        self._store.emit(index, frame)

    def progress(self, done: float) -> None:
        super().progress(done)
        self.told(min(max(done, 0.0), 1.0))


class _Run:
    """Runs tasks of a film, for the time of one call."""

    def __init__(self, layer: LayerSources, plan: _Plan, store: _Store, context: _FilmContext, told: Progress) -> None:
        self._method: Method = method(layer.method)
        self._steps: dict[str, Step[AnyParams]] = {step.name: step for step in self._method.steps_of(context.params)}
        self._plan, self._store, self._context, self._told = plan, store, context, told
        self.context = context
        self._clock = TaskClock()
        self._needed: list[set[Name]] = []
        """Tasks whose artefacts the tasks that run now, each within the one before, still need."""
        context.make = self._make

    def frame(self, number: int) -> Frame:
        """Frame `number`, or the film's last frame."""
        if (known := self._store.frame(number)) is not None:
            return known
        start, stop, name = self._maker(number)
        number = max(start, min(number, stop - 1))
        if (known := self._store.frame(number)) is None:
            self._plan.saved.pop(name, None)  # it ran before, but its frame is kept no more
            self._require([name])
            known = self._store.frame(number)
        self._store.fresh.clear()
        if known is None:
            raise UnreadableMedia("This frame of the video cannot be decoded.", field="frame", value=number,
                                  remedy="Choose an earlier frame, or upload the video again.")  # fmt: skip
        return known

    def tasks(self, step: str) -> Mapping[str, Task]:
        return self._tasks(step)

    def results(self, step: str) -> Mapping[str, TaskResult]:
        return self._results(step)

    def load(self, step: str, key: str, name: str) -> State:
        self._require([(step, key)], [(step, key)])
        found = self._store.artefact((step, name))
        if found is None:
            raise KeyError(f"{step}/{name}")
        return found

    def _maker(self, number: int) -> tuple[int, int, Name]:
        """First frame, frame after the last, and name of the task that emits a frame, or the film's last frames."""
        found = [(*task.emits, (step, key)) for step in self._steps for key, task in self._tasks(step).items()
                 if task.emits is not None]  # fmt: skip
        if not found:
            raise UnreadableMedia("The video has no frames.", field="frame", value=number, remedy="Use another file.")
        return next((one for one in found if one[0] <= number < one[1]), max(found))

    def _tasks(self, step: str) -> dict[str, Task]:
        """Tasks of a step. Results of earlier steps on which its plan depends are computed first."""
        if step not in self._plan.tasks:
            context = self._context
            results = _Results(self._results, tuple(self._steps)[: tuple(self._steps).index(step)])
            planned = self._steps[step].plan(
                PlanContext(context.params, context.seed, context.video, frozenset(context.inputs), results)
            )
            self._plan.tasks[step] = {task.key: task for task in planned}
        return self._plan.tasks[step]

    def _results(self, step: str) -> dict[str, TaskResult]:
        """Results of all tasks of a step."""
        done = self._plan.results.setdefault(step, {})
        self._require([(step, key) for key in self._tasks(step) if key not in done])
        return {key: done[key] for key in self._tasks(step)}

    def _make(self, step: str, name: str) -> None:
        """Run the task that makes an artefact, after all tasks of the step if that task is unknown."""
        if not (maker := self._makers(step, name)):
            self._require([(step, key) for key in self._tasks(step)])
            maker = self._makers(step, name)  # what it made may be lost again
        self._require(maker, maker)

    def _makers(self, step: str, name: str) -> list[Name]:
        return [task for task, saved in self._plan.saved.items() if task[0] == step and name in saved]

    def _require(self, wanted: Sequence[Name], hold: Sequence[Name] = ()) -> None:
        """Run these tasks and those that they come after, except those whose artefacts are still kept.

        Args:
            hold: tasks whose artefacts stay in memory.
        """
        graph: dict[Name, list[Name]] = {}
        pending = list(wanted)
        while pending:
            name = pending.pop()
            if name not in graph and not self._kept(name):
                graph[name] = self._before(name)
                pending += graph[name]
        order = [name for name in TopologicalSorter(graph).static_order() if name in graph]
        for at, name in enumerate(order):
            later = {before for other in order[at + 1 :] for before in graph[other]} | set(hold)
            self._needed.append(later | set(graph[name]))
            self._run_task(name, [other for other in order if other[0] == name[0]])
            self._needed.pop()
            needed = later.union(*self._needed)
            self._store.hold_only(
                {(step, one) for step, key in needed for one in self._plan.saved.get((step, key), ())}
            )

    def _kept(self, name: Name) -> bool:
        saved = self._plan.saved.get(name)
        return saved is not None and all(self._store.has((name[0], one)) for one in saved)

    def _before(self, name: Name) -> list[Name]:
        """Names of the tasks that `Task.after` names."""
        step, key = name
        named = dependencies(self._tasks(step)[key].after, step)
        return [(of, one) for of in sorted(named) for one in sorted(named[of])]

    def _run_task(self, name: Name, alike: Sequence[Name]) -> None:
        """Run a task. `alike`: the tasks of its step that run in this call."""
        step, key = name
        context, title, place = self._context, self._steps[step].title, alike.index(name)
        before = context.step, context.task, context.saved, context.told
        context.step, context.task, context.saved = step, self._tasks(step)[key], []
        context.told = lambda done: self._told(title, (place + done) / len(alike))
        context.told(0.0)
        try:
            with self._clock.measured(self._plan.costs.setdefault(step, StepCost()), context.task.weight):
                result = self._steps[step].run(self._in_plan_order(name), context)
            self._plan.results.setdefault(step, {})[key] = result
            self._plan.saved[name] = context.saved
        finally:
            context.step, context.task, context.saved, context.told = before

    def _in_plan_order(self, name: Name) -> Task:
        """The task as it runs: with `after` in plan order."""
        names = [f"{step}/{key}" for step, tasks in self._plan.tasks.items() for key in tasks]
        task = self._tasks(name[0])[name[1]]
        return replace(task, after=in_plan_order(task.after, name[0], {one: at for at, one in enumerate(names)}))


class _Results(Mapping[str, Mapping[str, TaskResult]]):
    """Results of the tasks of earlier steps by step, which are computed on access."""

    def __init__(self, results_of: Callable[[str], dict[str, TaskResult]], steps: Sequence[str]) -> None:
        self._results_of, self._names = results_of, steps

    def __getitem__(self, step: str) -> Mapping[str, TaskResult]:
        if step not in self._names:
            raise KeyError(step)
        return self._results_of(step)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)
