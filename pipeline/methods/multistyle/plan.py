"""The batch form: looking is a chain, painting is not.

    scan      one pass over the video: how many frames there really are, where shots begin, whether the design is sound
    regions   only if a design names regions, or the artefact "regions" is wanted. Runs of frames, two tasks each:
              `fore-n` carries label maps and tubes forwards from run to run, `back-n` backwards from later keyframes
    maps      the same runs: the region map of every frame, and the ellipse of every region; then their list
    paint     the same runs, two tasks each: `look-n` goes on from the state that the run before it saved, and keeps
              what it saw of every frame; `run-n` paints from that, whenever it likes, and once more the two frames
              before, which linger

Looking costs half of painting, so that the chain of one long shot keeps three workers busy. Shots are independent of
each other. The result is byte for byte what one session over the whole video gives.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

from numpy.typing import NDArray

from pipeline.errors import BadInput
from pipeline.frames import Plane
from pipeline.methods.abstraction.state import part
from pipeline.methods.base import Bench, Brief, Note, Task
from pipeline.methods.multistyle import mapping
from pipeline.methods.multistyle.design import Design, parse
from pipeline.methods.multistyle.effects import effect_design
from pipeline.methods.multistyle.look import Eye
from pipeline.methods.multistyle.paint import Painter, frames_that_linger
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.sight import Sight, unpack
from pipeline.segmentation.cuts import is_cut, thumbnail

RUN_FRAMES = 12
"""Frames a task: about 4 s of work at 720p, which is what a restart repeats. Two workers even out soon."""
LONG_SHOT_RUNS = 20
"""A shot of so many runs is worked at in runs twice as long: half as many frames are painted again to linger."""
LOOKING = 0.35
"""What it costs to look at a frame, where painting it costs 1."""


def plan_scan(brief: Brief) -> list[Task]:
    return [Task("video", weight=0.03 * max(brief.video.frames, 1))]


def run_scan(task: Task, bench: Bench) -> Note:
    """Count the frames and call the cuts, exactly as the eye would; check the design."""
    params: MultistyleParams = bench.params
    before: Plane | None = None
    cuts: list[int] = []
    count = 0
    for index, frame in enumerate(bench.frames("video")):
        with bench.clock("cuts"):
            now = thumbnail(frame)
            if before is not None and is_cut(before, now, params.cut_sensitivity):
                cuts.append(index)
        before = now
        count = index + 1
        if index % 16 == 0:
            bench.progress(min(1.0, count / max(bench.video.frames, count)))
    if not count:
        raise BadInput("The video has no frames.", field="inputs.video", remedy="Upload a video that plays.")
    return {"frames": count, "cuts": cuts} | mapping.wishes(design_of(bench, count), bench, count)


def design_of(bench: Bench, frames: int) -> Design | None:
    """The job's design, checked; or that of the effect it asks for."""
    if not bench.has("design"):
        return effect_design(bench.params.effect, frames)
    return parse(bench.json("design"), frames=frames, masks=bench.has(mapping.MASKS))


def run_frames(shot: tuple[int, int]) -> int:
    """Frames a run of this shot."""
    return RUN_FRAMES if shot[1] - shot[0] < LONG_SHOT_RUNS * RUN_FRAMES else 2 * RUN_FRAMES


def runs_of(brief: Brief) -> Iterator[tuple[int, int, tuple[int, int]]]:
    """(start, stop, shot) of every run."""
    scan = brief.notes["scan"]["video"]
    for shot in pairwise([0, *scan["cuts"], scan["frames"]]):
        for start in range(*shot, run_frames(shot)):
            yield start, min(start + run_frames(shot), shot[1]), shot


def plan_paint(brief: Brief) -> list[Task]:
    looks: list[Task] = []
    paints: list[Task] = []
    total = brief.notes["scan"]["video"]["frames"]
    for start, stop, shot in runs_of(brief):
        args = {"start": start, "stop": stop, "last": stop == shot[1], "frames": total} | mapping.ellipses(
            brief, start, stop, shot
        )
        after = (_look_key(start - run_frames(shot)),) if start > shot[0] else ()
        looks.append(Task(_look_key(start), args, after, weight=LOOKING * (stop - start)))
        args = {"start": start, "stop": stop, "before": after[0] if after else None}
        weight = (1 - LOOKING) * (stop - start)
        paints.append(Task(f"run-{start:07d}", args, (_look_key(start), *after), (start, stop), weight=weight))
    return looks + paints


def _look_key(start: int) -> str:
    return f"look-{start:07d}"


def run_paint(task: Task, bench: Bench) -> Note:
    return _look(task, bench) if task.emits is None else _paint(task, bench)


def _look(task: Task, bench: Bench) -> Note:
    """Look at frames [start, stop), from the state of the run before where there is one."""
    start, stop = task.args["start"], task.args["stop"]
    design = design_of(bench, task.args["frames"])
    eye = Eye(bench.params, bench.size, bench.seed, bench.clock, design)
    if task.after:
        eye.restore(bench.load("paint", f"state-{task.after[0]}"))
    else:
        eye.age = start
    placed = mapping.placed(design, task, bench)
    kept: dict[str, NDArray[Any]] = {}
    count = 0
    for frame in bench.frames("video", start, stop):
        sight = eye.step(frame, placed(start + count))
        kept |= {f"{count}.{name}": array for name, array in sight.pack().items()}
        count += 1
        bench.progress(count / (stop - start))
    bench.save(task.key, kept)
    if not task.args["last"]:
        bench.save(f"state-{task.key}", eye.state())
        if lingering := frames_that_linger(bench.params):
            bench.save(f"last-{task.key}", _last(kept, count - lingering))
    if eye.designer is None:
        return {"frames": count}
    return {"frames": count, "laplace_residual": eye.designer.residual, "laplace_cycles": eye.designer.cycles}


def _last(kept: dict[str, NDArray[Any]], first: int) -> dict[str, NDArray[Any]]:
    """Of the frames of a run, those from `first` on, which linger in the next one."""
    return {name: array for name, array in kept.items() if int(name.partition(".")[0]) >= first}


def _paint(task: Task, bench: Bench) -> Note:
    """Paint frames [start, stop) from what was seen of them, and of the few before."""
    start, stop = task.args["start"], task.args["stop"]
    seen = bench.load("paint", _look_key(start))
    painter = Painter(bench.params, bench.size, bench.seed, bench.clock)
    if painter.linger and task.args["before"]:
        for sight in _sights(bench.load("paint", f"last-{task.args['before']}")):
            painter.recall(sight)
    sights = _sights(seen)
    for k, sight in enumerate(sights):
        bench.emit(start + k, painter.paint(sight))
        bench.progress((k + 1) / (stop - start))
    return {"frames": len(sights)}


def _sights(kept: Mapping[str, NDArray[Any]]) -> list[Sight]:
    """The sights of some frames, in order."""
    return [unpack(part(kept, str(number))) for number in sorted({int(name.partition(".")[0]) for name in kept})]


def plan_regions(brief: Brief) -> list[Task]:
    return mapping.plan_regions(brief, list(runs_of(brief)))


def plan_maps(brief: Brief) -> list[Task]:
    return mapping.plan_maps(brief, list(runs_of(brief)))


def run_regions(task: Task, bench: Bench) -> Note:
    return mapping.run_regions(task, bench, design_of(bench, task.args["frames"]))


def run_maps(task: Task, bench: Bench) -> Note:
    return mapping.run_maps(task, bench, design_of(bench, task.args["frames"]))
