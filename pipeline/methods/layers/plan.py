"""Plan and tasks of the method `layers`: the steps of all layers side by side, then the composite."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise, repeat

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.compositing import lay_over
from pipeline.methods import parse_params
from pipeline.methods.base import AnyParams, PlanContext, Step, Task, TaskContext, TaskResult, resources_per_pixel
from pipeline.methods.layers.layer_context import PIECE_FRAMES, LayerContext, frames_name
from pipeline.methods.layers.names import MATTE, VIDEO, input_name, prefix, stage
from pipeline.methods.layers.params import LayerParams, LayersParams
from pipeline.video.depth import as_float, as_uint16, with_opacity

RUN_FRAMES = 4 * PIECE_FRAMES
"""Frames of a task of the composite."""
_COMPOSITE_BYTES = 80.0
"""A pixel: a frame of each kind as float32, and the PNG images of a piece."""
_COMPOSITE_WEIGHT = 0.05


def plan_stage(index: int, context: PlanContext[LayersParams]) -> list[Task]:
    """The tasks of step `index` of every layer that has that step."""
    return list(chain.from_iterable(
        _layer_tasks(index, context, number, layer) for number, layer in enumerate(context.params.layers)
    ))  # fmt: skip


def _layer_tasks(index: int, context: PlanContext[LayersParams], number: int, layer: LayerParams) -> Iterator[Task]:
    own = _layer_plan(context, number, layer)
    steps = layer.chosen.steps_of(own.params)
    if index >= len(steps):
        return
    default = layer.chosen.resources(steps[index].name, own)
    for task in steps[index].plan(own):
        emits = None if task.emits is None else list(task.emits)
        yield replace(
            task,
            key=prefix(number) + task.key,
            args={"layer": number, "step": index, "key": task.key, "args": task.args, "emits": emits},
            after=tuple(_in_job(number, name, steps) for name in task.after),
            emits=None,
            resources=task.resources or default,
        )


def _in_job(number: int, name: str, steps: Sequence[Step[AnyParams]]) -> str:
    """A name of `Task.after` in the layer's own plan -> that of the job: "step/key" or "key"."""
    step, slash, key = name.rpartition("/")
    at = [one.name for one in steps].index(step) if slash else 0
    return f"{stage(at)}/{prefix(number)}{key}" if slash else prefix(number) + name


def _in_layer(number: int, name: str, steps: Sequence[Step[AnyParams]]) -> str:
    """The inverse of `_in_job`."""
    step, slash, key = name.rpartition("/")
    own = key.removeprefix(prefix(number))
    return f"{steps[[stage(at) for at in range(len(steps))].index(step)].name}/{own}" if slash else own


def _layer_plan(context: PlanContext[LayersParams], number: int, layer: LayerParams) -> PlanContext[AnyParams]:
    """The plan context that a job of the layer's method alone would have."""
    params, begin = parse_params(layer.chosen, layer.params), prefix(number)
    names = {name.removeprefix(input_name(number, "")) for name in context.inputs if name.startswith(f"layer{number}.")}
    results = {
        step.name: {key.removeprefix(begin): made["result"]
                    for key, made in context.results[stage(index)].items() if key.startswith(begin)}
        for index, step in enumerate(layer.chosen.steps_of(params)) if stage(index) in context.results
    }  # fmt: skip
    return PlanContext(params, layer.seed, context.video, frozenset(names - {MATTE} | {VIDEO}), results, context.deep)


def run_stage(task: Task, context: TaskContext[LayersParams]) -> TaskResult:
    """A task of one layer. The result has the layer's own, and the runs of frames that were kept."""
    number, args = task.args["layer"], task.args
    layer = context.params.layers[number]
    own = LayerContext(context, number, layer)
    step = layer.chosen.steps_of(own.params)[args["step"]]
    after = tuple(_in_layer(number, name, layer.chosen.steps_of(own.params)) for name in task.after)
    result = step.run(Task(args["key"], args["args"], after, args["emits"] and tuple(args["emits"])), own)
    own.finish()
    return {"result": result, "pieces": own.pieces}


@dataclass(frozen=True)
class _Piece:
    """An artefact of a layer's painted frames [start, stop), and the task that made it."""

    step: str
    key: str
    start: int
    stop: int


def plan_composite(context: PlanContext[LayersParams]) -> list[Task]:
    """Runs of frames that all layers have; each waits for, and sees, only the tasks that painted them."""
    pieces = [_pieces(context, number) for number in range(len(context.params.layers))]
    first = max((min((piece.start for piece in own), default=0) for own in pieces), default=0)
    total = min((max((piece.stop for piece in own), default=0) for own in pieces), default=0)
    starts = [first, *range((first // RUN_FRAMES + 1) * RUN_FRAMES, total, RUN_FRAMES)] if first < total else []
    return [_run(context, pieces, start, stop) for start, stop in pairwise([*starts, total])]


def _run(context: PlanContext[LayersParams], pieces: Sequence[Sequence[_Piece]], start: int, stop: int) -> Task:
    chosen = [[piece for piece in own if start <= piece.start < stop] for own in pieces]
    return Task(
        f"frames-{start:07d}",
        {"pieces": [[[piece.step, piece.start, piece.stop] for piece in own] for own in chosen]},
        after=tuple(dict.fromkeys(f"{piece.step}/{piece.key}" for own in chosen for piece in own)),
        emits=(start, stop),
        weight=_COMPOSITE_WEIGHT * len(pieces) * (stop - start),
        resources=resources_per_pixel(context.video, _COMPOSITE_BYTES),
    )


def _pieces(context: PlanContext[LayersParams], number: int) -> list[_Piece]:
    """Every artefact of a layer's painted frames, in order."""
    found = [
        _Piece(step, key, start, stop)
        for step, tasks in context.results.items()
        for key, made in tasks.items() if key.startswith(prefix(number))
        for start, stop in made["pieces"]
    ]  # fmt: skip
    return sorted(found, key=lambda piece: piece.start)


def run_composite(task: Task, context: TaskContext[LayersParams]) -> TaskResult:
    """Lay the layers' frames over each other and emit them."""
    assert task.emits is not None
    (start, stop), layers = task.emits, context.params.layers
    painted = [_painted(context, number, pieces) for number, pieces in enumerate(task.args["pieces"])]
    mattes = [_mattes(context, number, layer, start, stop) for number, layer in enumerate(layers)]
    alone = context.params.alone
    source = context.mattes(start, stop) if alone else None
    ground = iter(()) if layers[0].covers or alone else context.deep_frames(VIDEO, start, stop)
    for index in range(start, stop):
        below = next(ground, None)
        with context.clock("composite"):
            if alone:
                shapes = [next(mattes[0]), None if source is None else next(source)[..., 0]]
                result = _alone(next(painted[0]), layers[0].opacity, shapes, context.deep)
            else:
                result = _laid(below, layers, [next(own) for own in painted], [next(own) for own in mattes])
        context.emit(index, result)
        context.progress((index + 1 - start) / (stop - start))
    return {}


def _laid(
    below: AnyArray | None, layers: Sequence[LayerParams], pictures: Sequence[AnyArray],
    mattes: Sequence[NDArray[np.uint8] | None],
) -> AnyArray:  # fmt: skip
    """The layers laid over each other: uint8; float32 with white at 1, if a picture has more than 8 bits."""
    deep = any(each.dtype != np.uint8 for each in (*pictures, *(() if below is None else (below,))))
    below = _levels(below) if deep and below is not None else below
    for layer, picture, matte in zip(layers, pictures, mattes, strict=True):
        above = _levels(picture) if deep else picture
        below = above if below is None else lay_over(below, above, layer.opacity, layer.blend, matte)
    assert below is not None
    return below / np.float32(255) if deep else below


def _levels(picture: AnyArray) -> AnyArray:
    """The picture as float32 with white at 255."""
    return as_float(picture) * np.float32(255)


def _alone(picture: AnyArray, opacity: float, mattes: Sequence[AnyArray | None], deep: bool) -> AnyArray:
    """A layer's picture with its opacity: that of the layer, times its matte and that of the source; `deep`: uint16."""
    share = np.full(picture.shape[:2], opacity, np.float32)
    for matte in mattes:
        share *= np.float32(1) if matte is None else as_float(matte)
    return with_opacity(as_uint16(picture) if deep else picture, as_uint16(share))


def _painted(context: TaskContext[LayersParams], number: int, pieces: Sequence[Sequence[int]]) -> Iterator[AnyArray]:
    for step, first, stop in pieces:
        kept = context.load(str(step), frames_name(number, first))
        for index in range(first, stop):
            picture = cv2.imdecode(kept[str(index)], cv2.IMREAD_UNCHANGED)
            assert picture is not None
            yield cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)


def _mattes(
    context: TaskContext[LayersParams], number: int, layer: LayerParams, start: int, stop: int
) -> Iterator[NDArray[np.uint8] | None]:
    """The layer's matte for frames [start, stop); a matte that ends earlier holds its last picture."""
    if not layer.matted:
        yield from repeat(None)
    name, last = input_name(number, MATTE), None
    for frame in context.frames(name, start, stop):
        last = np.ascontiguousarray(frame[..., 0])
        yield last
    if last is None:
        last = np.ascontiguousarray(context.image(name)[..., 0])
    yield from repeat(last)
