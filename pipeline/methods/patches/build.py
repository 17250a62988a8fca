"""Step "patch": concatenate and relax the warps of each patch, average its colours, and paint it once (section 5).

    <life>-join       relaxed placement in each frame, and size of the panorama
    <life>-sum-<n>    colour sum of the n-th span of AGE frames
    <life>            division into ages (periods of similar appearance)
    <life>-age-<n>    mean and painting of the age that begins with the n-th sum, if there is one

Small patches do all of this in a single task, <life>. Large ones, such as backgrounds, are divided as listed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from pipeline.frames import Frame
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.patches.ages import Ages, Room, Sum, ages, picture, spans, sum_up
from pipeline.methods.patches.artefacts import keep_energy, keep_patch
from pipeline.methods.patches.clusters import LabelMaps
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.guidance import style_of, styles_of
from pipeline.methods.patches.hertzmann import Painter
from pipeline.methods.patches.join import Hops, joined, load_lays, save_lays, settle, sheet_of
from pipeline.methods.patches.lives import Life, lives
from pipeline.methods.patches.params import PatchesParams
from pipeline.warp.panorama import Lay
from pipeline.warp.springs import Relaxed, distortion

SMALL = 6.0
"""Area of a patch summed over its frames, in frame areas, below which it is a single task."""


def plan_patch(context: PlanContext[PatchesParams]) -> list[Task]:
    if context.params.temporal != "on":
        return []
    size = Grid.of((context.video.width, context.video.height)).size
    pairs, stages = _pair_energies(context), list[list[Task]]()
    for life in lives(context):
        args = {"life": life.args(), "pairs": pairs.get(life.key, [0.0, 0.0, 0, 0])}
        weight = 0.1 * (life.stop - life.start) + 1
        small = life.area < SMALL * size[0] * size[1]
        stages.append([Task(life.key, args, weight=weight)] if small else _parts(life, args))
    return sorted((task for tasks in stages for task in tasks), key=lambda task: len(task.after))


def _parts(life: Life, args: Mapping[str, Any]) -> list[Task]:
    """Tasks of a large patch. Each task has more dependencies than any task that it depends on."""
    key, count = life.key, len(spans(life))
    join = Task(f"{key}-join", {**args, "part": "join"}, weight=0.04 * (life.stop - life.start))
    sums = [_part(life, "sum", n, (join.key,), 0.4) for n in range(count)]
    needs = tuple(task.key for task in sums)
    found = Task(key, {"life": args["life"], "part": "ages"}, (join.key, *needs), weight=0.05 * count)
    return [join, *sums, found, *(_part(life, "age", n, (join.key, *needs, key), 1 / count) for n in range(count))]


def _part(life: Life, part: str, number: int, after: tuple[str, ...], weight: float) -> Task:
    args = {"life": life.args(), "part": part, "number": number}
    return Task(f"{life.key}-{part}-{number}", args, after, weight=weight)


def _pair_energies(context: PlanContext[PatchesParams]) -> dict[str, list[float]]:
    """Sums over the frame pairs of each patch: energy before and after relaxation, iterations, number of pairs."""
    found: dict[str, list[float]] = {}
    for result in context.results["register"].values():
        for key, row in result["energies"].items():
            found[key] = [a + b for a, b in zip(found.get(key, [0.0, 0.0, 0, 0]), row, strict=True)]
    return found


def run_patch(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Artefacts: "<life>-<run>" with the lays of a run's frames, "<life>-age<n>" with a panorama and its painting."""
    parts: Mapping[str, Callable[[Task, Life, TaskContext[PatchesParams]], TaskResult]] = {
        "whole": _run_whole, "join": _run_join, "sum": _run_sum, "ages": _run_ages, "age": _run_age,
    }  # fmt: skip
    return parts[task.args.get("part", "whole")](task, Life(**task.args["life"]), context)


def _run_whole(task: Task, life: Life, context: TaskContext[PatchesParams]) -> TaskResult:
    maps, grid = LabelMaps(context, life.begin), Grid.of(context.size)
    lays, room, result = _laid(task, life, maps, context)
    with context.clock("mean"):
        sums = {span: sum_up(span, life, lays, maps, room, context) for span in spans(life)}
        found = ages(sums.values(), life, room, grid, context.params)
    for number, (start, stop) in enumerate(found.spans):
        mine = (part for span, part in sums.items() if start <= span[0] < stop)
        _paint(number, mine, found.every, life, room, context)
        context.progress(0.5 + 0.5 * (number + 1) / len(found.spans))
    return result | _told(found, room)


def _run_join(task: Task, life: Life, context: TaskContext[PatchesParams]) -> TaskResult:
    _, room, result = _laid(task, life, LabelMaps(context, life.begin), context)
    room.save(context, life)
    return result


def _run_sum(task: Task, life: Life, context: TaskContext[PatchesParams]) -> TaskResult:
    span, room = spans(life)[task.args["number"]], Room.load(context, life)
    lays, maps = load_lays(context, life, *span), LabelMaps(context, life.begin)
    with context.clock("mean"):
        sum_up(span, life, lays, maps, room, context).save(context, task.key)
    return {}


def _run_ages(task: Task, life: Life, context: TaskContext[PatchesParams]) -> TaskResult:
    room, grid = Room.load(context, life), Grid.of(context.size)
    with context.clock("mean"):
        found = ages(_sums(life, life.start, life.stop, context), life, room, grid, context.params)
    found.save(context, life)
    return _told(found, room)


def _run_age(task: Task, life: Life, context: TaskContext[PatchesParams]) -> TaskResult:
    start, found = spans(life)[task.args["number"]][0], Ages.load(context, life)
    for number, (first, stop) in enumerate(found.spans):
        if first == start:
            _paint(number, _sums(life, first, stop, context), found.every, life, Room.load(context, life), context)
    return {}


def _sums(life: Life, start: int, stop: int, context: TaskContext[PatchesParams]) -> Iterable[Sum]:
    numbers = [number for number, span in enumerate(spans(life)) if start <= span[0] < stop]
    return (Sum.load(context, f"{life.key}-sum-{number}") for number in numbers)


def _told(found: Ages, room: Room) -> TaskResult:
    """Result of a patch's task, as the step "paint" reads it."""
    return {"origin": list(room.origin), "ages": [list(span) for span in found.spans]}


def _laid(
    task: Task, life: Life, maps: LabelMaps, context: TaskContext[PatchesParams]
) -> tuple[dict[int, Lay], Room, TaskResult]:
    """Concatenate and relax the warps of a patch, and save its placements."""
    with context.clock("join"):
        lays = joined(life, Hops(life, context), Grid.of(context.size).size)
    with context.clock("relax"):
        unsettled = dict(lays)
        relaxed = settle(lays, life, maps, context.params)
    save_lays(context, life, lays)
    if context.wants("energy"):
        _report(task, life, unsettled, lays, maps, relaxed, context)
    energies = {"before": relaxed.before, "after": relaxed.after, "iterations": relaxed.iterations}
    return lays, Room.around(lays, Grid.of(context.size)), {**energies, "frames": len(lays)}


def _report(
    task: Task, life: Life, before: dict[int, Lay], after: dict[int, Lay], maps: LabelMaps, relaxed: Relaxed,
    context: TaskContext[PatchesParams],
) -> None:  # fmt: skip
    """Save the energies, and distortion maps of the frame furthest from the master."""
    index = max(after, key=lambda frame: (abs(frame - life.master), frame))
    sheet = sheet_of(before[index], maps.sure(index) == life.label, context.params, 1)
    pairs = dict(zip(("before", "after", "iterations", "pairs"), task.args["pairs"], strict=True))
    report = {
        "label": life.label, "frames": [life.start, life.stop], "master": life.master, "pairs": pairs,
        "all": {"before": relaxed.before, "after": relaxed.after, "iterations": relaxed.iterations}, "map": index,
    }  # fmt: skip
    maps_of = [distortion(sheet, lays[index].positions()) for lays in (before, after)]
    keep_energy(context, life.key, report, maps_of[0], maps_of[1])


def _paint(
    number: int, sums: Iterable[Sum], every: Sum, life: Life, room: Room, context: TaskContext[PatchesParams]
) -> None:
    """Compute and save panorama and painting of one age."""
    with context.clock("mean"):
        panorama: Frame = picture(sums, every, room, Grid.of(context.size), context.params.misfit)
    with context.clock("paint"):
        painting = painter_of(life, context).picture(panorama)
    context.save(f"{life.key}-age{number}", {"panorama": panorama, "painting": painting})
    keep_patch(context, f"{life.key}-age{number}", panorama, painting)


def painter_of(life: Life, context: TaskContext[PatchesParams]) -> Painter:
    """Painter of a patch: brush sizes from table 1 by the patch's area over all frames, and the patch's style."""
    style, ratio = style_of(life.label, context.params, styles_of(context)), Grid.of(context.size).ratio
    return Painter.of(style, life.area * ratio[0] * ratio[1], context.size[1], context.params, context.seed)
