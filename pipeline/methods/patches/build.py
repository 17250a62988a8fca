"""Step "patch": join a patch's warps, relax them together, take its mean colours, and paint it: once (section 5).

    <life>-join       where it lies in each of its frames, relaxed, and how large its panorama is
    <life>-sum-<n>    colours of the n-th AGE frames, summed
    <life>            which of them look alike: the patch's ages
    <life>-look-<n>   mean and painting of the age that begins there, if one does

A patch that is small over all its frames does all of it in one task, <life>: most are, and a background is not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from pipeline.frames import Frame
from pipeline.methods.base import Bench, Brief, Note, Task
from pipeline.methods.patches.ages import Ages, Room, Sum, ages, picture, spans, sum_up
from pipeline.methods.patches.artefacts import keep_energy, keep_patch
from pipeline.methods.patches.clusters import LabelMaps
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.guidance import style_of, styles_of
from pipeline.methods.patches.hertzmann import Painter
from pipeline.methods.patches.join import Hops, joined, load_lays, save_lays, settle, sheet_of
from pipeline.methods.patches.lives import Life, lives
from pipeline.warp.panorama import Lay
from pipeline.warp.springs import Relaxed, distortion

SMALL = 6.0
"""Area of a patch over all its frames, in frames, below which it is one task."""


def plan_patch(brief: Brief) -> list[Task]:
    if brief.params.temporal != "on":
        return []
    size = Grid.of((brief.video.width, brief.video.height)).size
    pairs, stages = _pair_energies(brief), list[list[Task]]()
    for life in lives(brief):
        args = {"life": life.args(), "pairs": pairs.get(life.key, [0.0, 0.0, 0, 0])}
        weight = 0.1 * (life.stop - life.start) + 1
        small = life.area < SMALL * size[0] * size[1]
        stages.append([Task(life.key, args, weight=weight)] if small else _parts(life, args))
    return sorted((task for tasks in stages for task in tasks), key=lambda task: len(task.after))


def _parts(life: Life, args: Mapping[str, Any]) -> list[Task]:
    """A large patch, in tasks; each has more to wait for than those that it waits for."""
    key, count = life.key, len(spans(life))
    join = Task(f"{key}-join", {**args, "part": "join"}, weight=0.04 * (life.stop - life.start))
    sums = [_part(life, "sum", n, (join.key,), 0.4) for n in range(count)]
    needs = tuple(task.key for task in sums)
    found = Task(key, {"life": args["life"], "part": "ages"}, (join.key, *needs), weight=0.05 * count)
    return [join, *sums, found, *(_part(life, "look", n, (join.key, *needs, key), 1 / count) for n in range(count))]


def _part(life: Life, part: str, number: int, after: tuple[str, ...], weight: float) -> Task:
    args = {"life": life.args(), "part": part, "number": number}
    return Task(f"{life.key}-{part}-{number}", args, after, weight=weight)


def _pair_energies(brief: Brief) -> dict[str, list[float]]:
    """Of each patch, over all its pairs of frames: energy before and after, iterations, and how many pairs."""
    found: dict[str, list[float]] = {}
    for note in brief.notes["register"].values():
        for key, row in note["energies"].items():
            found[key] = [a + b for a, b in zip(found.get(key, [0.0, 0.0, 0, 0]), row, strict=True)]
    return found


def run_patch(task: Task, bench: Bench) -> Note:
    """Artefacts: "<life>-<run>" with the lays of a run's frames, "<life>-age<n>" with a panorama and its painting."""
    parts: Mapping[str, Callable[[Task, Life, Bench], Note]] = {
        "whole": _run_whole, "join": _run_join, "sum": _run_sum, "ages": _run_ages, "look": _run_look,
    }  # fmt: skip
    return parts[task.args.get("part", "whole")](task, Life(**task.args["life"]), bench)


def _run_whole(task: Task, life: Life, bench: Bench) -> Note:
    maps, grid = LabelMaps(bench, life.begin), Grid.of(bench.size)
    lays, room, note = _laid(task, life, maps, bench)
    with bench.clock("mean"):
        sums = {span: sum_up(span, life, lays, maps, room, bench) for span in spans(life)}
        found = ages(sums.values(), life, room, grid, bench.params)
    for number, (start, stop) in enumerate(found.spans):
        mine = (part for span, part in sums.items() if start <= span[0] < stop)
        _paint(number, mine, found.every, life, room, bench)
        bench.progress(0.5 + 0.5 * (number + 1) / len(found.spans))
    return note | _told(found, room)


def _run_join(task: Task, life: Life, bench: Bench) -> Note:
    _, room, note = _laid(task, life, LabelMaps(bench, life.begin), bench)
    room.save(bench, life)
    return note


def _run_sum(task: Task, life: Life, bench: Bench) -> Note:
    span, room = spans(life)[task.args["number"]], Room.load(bench, life)
    lays, maps = load_lays(bench, life, *span), LabelMaps(bench, life.begin)
    with bench.clock("mean"):
        sum_up(span, life, lays, maps, room, bench).save(bench, task.key)
    return {}


def _run_ages(task: Task, life: Life, bench: Bench) -> Note:
    room, grid = Room.load(bench, life), Grid.of(bench.size)
    with bench.clock("mean"):
        found = ages(_sums(life, life.start, life.stop, bench), life, room, grid, bench.params)
    found.save(bench, life)
    return _told(found, room)


def _run_look(task: Task, life: Life, bench: Bench) -> Note:
    start, found = spans(life)[task.args["number"]][0], Ages.load(bench, life)
    for number, (first, stop) in enumerate(found.spans):
        if first == start:
            _paint(number, _sums(life, first, stop, bench), found.every, life, Room.load(bench, life), bench)
    return {}


def _sums(life: Life, start: int, stop: int, bench: Bench) -> Iterable[Sum]:
    numbers = [number for number, span in enumerate(spans(life)) if start <= span[0] < stop]
    return (Sum.load(bench, f"{life.key}-sum-{number}") for number in numbers)


def _told(found: Ages, room: Room) -> Note:
    """What the last step has to know of a patch."""
    return {"origin": list(room.origin), "ages": [list(span) for span in found.spans]}


def _laid(task: Task, life: Life, maps: LabelMaps, bench: Bench) -> tuple[dict[int, Lay], Room, Note]:
    """Join and relax; keep the lays."""
    with bench.clock("join"):
        lays = joined(life, Hops(life, bench), Grid.of(bench.size).size)
    with bench.clock("relax"):
        unsettled = dict(lays)
        relaxed = settle(lays, life, maps, bench.params)
    save_lays(bench, life, lays)
    if bench.wants("energy"):
        _report(task, life, unsettled, lays, maps, relaxed, bench)
    energies = {"before": relaxed.before, "after": relaxed.after, "iterations": relaxed.iterations}
    return lays, Room.around(lays, Grid.of(bench.size)), {**energies, "frames": len(lays)}


def _report(
    task: Task, life: Life, before: dict[int, Lay], after: dict[int, Lay], maps: LabelMaps, relaxed: Relaxed,
    bench: Bench,
) -> None:  # fmt: skip
    """Energies, and maps of the frame furthest from the master."""
    index = max(after, key=lambda frame: (abs(frame - life.master), frame))
    sheet = sheet_of(before[index], maps.sure(index) == life.label, bench.params, 1)
    pairs = dict(zip(("before", "after", "iterations", "pairs"), task.args["pairs"], strict=True))
    report = {
        "label": life.label, "frames": [life.start, life.stop], "master": life.master, "pairs": pairs,
        "all": {"before": relaxed.before, "after": relaxed.after, "iterations": relaxed.iterations}, "map": index,
    }  # fmt: skip
    maps_of = [distortion(sheet, lays[index].positions()) for lays in (before, after)]
    keep_energy(bench, life.key, report, maps_of[0], maps_of[1])


def _paint(number: int, sums: Iterable[Sum], every: Sum, life: Life, room: Room, bench: Bench) -> None:
    """The picture and the painting of one age."""
    with bench.clock("mean"):
        panorama: Frame = picture(sums, every, room, Grid.of(bench.size), bench.params.misfit)
    with bench.clock("paint"):
        painting = painter_of(life, bench).picture(panorama)
    bench.save(f"{life.key}-age{number}", {"panorama": panorama, "painting": painting})
    keep_patch(bench, f"{life.key}-age{number}", panorama, painting)


def painter_of(life: Life, bench: Bench) -> Painter:
    """Table 1 by the area of the region over all its frames; a patch may have a style of its own."""
    style, ratio = style_of(life.label, bench.params, styles_of(bench)), Grid.of(bench.size).ratio
    return Painter.of(style, life.area * ratio[0] * ratio[1], bench.size[1], bench.params, bench.seed)
