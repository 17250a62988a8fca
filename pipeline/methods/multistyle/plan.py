"""Plan of a batch job: analysis is a chain of runs of frames, painting is parallel.

    scan      one pass over the video: number of frames, shot boundaries, validation of the design
    regions   only if a design has regions or the artefact "regions" is requested. Two tasks a run of frames: `fore-n`
              propagates label maps and tubes forwards from run to run, `back-n` backwards from later keyframes
    maps      a task a run: region map of every frame and ellipse of every region; then a list of all regions
    paint     three tasks a run: `flow-n` computes the optical flow, which depends on the source only; `analyze-n`
              continues from the state that the previous run saved, and saves the analysis of every frame; `run-n`
              paints from the analyses, and paints the few previous frames that temporal accumulation needs, unless
              the run before does so in the same process (`shared_paintings`)

Flow costs a fifth of a frame. The chain of analyses costs a fifth of it on the busier of its two threads, and from
`MANY_PROCESSORS` on a tenth on the busiest of seven: a single long shot keeps six processors busy. Shots are
independent. A fast flow is computed by the analysis itself. The
result is the same, byte for byte, as that of one session over the whole video.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from itertools import chain, repeat
from typing import TypeVar

from pipeline.arrays import AnyArray, Arrays, State, part
from pipeline.frames import Flow, Frame
from pipeline.kernels.executors import INLINE, RowExecutor
from pipeline.kernels.processors import usable_processors
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.given_motion import given_motion
from pipeline.methods.multistyle import region_maps
from pipeline.methods.multistyle.analysis import StrokeAnalysis, unpack
from pipeline.methods.multistyle.analyzer import Observation, StrokeAnalyzer
from pipeline.methods.multistyle.backward_flow import BYTES_PER_PX, is_prepared, run_flow, working_size
from pipeline.methods.multistyle.design import Design, parse
from pipeline.methods.multistyle.design_fields import RegionPlacement
from pipeline.methods.multistyle.effects import effect_design
from pipeline.methods.multistyle.orientation_picture import DIRECTIONS, archive, orientation_picture
from pipeline.methods.multistyle.painter import Painter, accumulated_frames
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.passes import observed_passes
from pipeline.methods.multistyle.regions import MASKS
from pipeline.methods.prepared import prepared_key, with_prepared
from pipeline.methods.scan import scan_video, shots_of

G = TypeVar("G")
T = TypeVar("T")

RUN_FRAMES = 12
"""Frames a task: about 4 s of work at 720p, which is repeated after a failure."""
LONG_SHOT_RUNS = 20
"""Shots of at least this many runs use runs of twice the length, which halves the repainted frames."""
BEHIND = 4
"""Runs that are analysed before the first one is painted, if workers are free for either. So the analyses that wait are
few, and at the end enough is left to paint for several workers."""
OBSERVED_AHEAD = 1
"""Frames that are observed before their strokes are placed."""
MANY_PROCESSORS = 4
STAGES_AHEAD, LAYER_THREADS = 3, 3
"""On so many processors, each of the three parts of an observation has a thread of its own, so many frames ahead, and
so many further threads place strokes of other layers."""
FLOW_SHARE, ANALYSIS_SHARE = 0.22, 0.36
"""Costs of the flow and of the rest of the analysis of a frame, as fractions of its whole cost."""
FLOW = "flow"
"""First part of the keys of the tasks that compute flow."""


def plan_scan(context: PlanContext[MultistyleParams]) -> list[Task]:
    return [Task("video", weight=0.01 * max(context.video.frames, 1))]


def run_scan(task: Task, context: TaskContext[MultistyleParams]) -> TaskResult:
    """Result: number of frames, cuts, and what planning needs of the design, which is validated here."""
    first, stop = _scanned(context)
    count, cuts = scan_video(context, context.params.cut_sensitivity, span=(first, stop))
    frames = max(count, context.video.total) if context.video.is_piece else count
    facts = region_maps.requirements(design_of(context, frames), context, frames)
    return {"first": first or 0, "frames": count, "cuts": cuts, "film": frames} | facts


def _scanned(context: TaskContext[MultistyleParams]) -> tuple[int | None, int | None]:
    """Frames [first, end) of the film from which the regions of the painted frames are found."""
    video = context.video
    if not video.is_piece:
        return None, None
    facts = region_maps.requirements(design_of(context, video.total), context, video.total)
    return region_maps.span_of(facts, video)


def design_of(context: TaskContext[MultistyleParams], frames: int) -> Design | None:
    """The job's design, validated, or the design of its effect; None = neither."""
    if not context.has("design"):
        return effect_design(context.params.effect, frames)
    return parse(context.json("design"), frames=frames, masks=context.has(MASKS))


def run_frames(shot: tuple[int, int]) -> int:
    """Frames a run in this shot."""
    return RUN_FRAMES if shot[1] - shot[0] < LONG_SHOT_RUNS * RUN_FRAMES else 2 * RUN_FRAMES


def runs_of(context: PlanContext[MultistyleParams]) -> Iterator[tuple[int, int, tuple[int, int]]]:
    """(first frame, frame after the last, shot) of every run. Without regions, which would occupy a second worker, the
    first run is short, because that worker waits for it."""
    scan = context.results["scan"]["video"]
    for shot in shots_of(context, scan):
        start = shot[0]
        while start < shot[1]:
            length = run_frames(shot) if start or scan["maps"] else -(-RUN_FRAMES // 2)
            stop = min(start + length, shot[1])
            yield start, stop, shot
            start = stop


def _painted_runs(context: PlanContext[MultistyleParams]) -> Iterator[tuple[int, int, tuple[int, int]]]:
    """The runs to analyse; a piece of a film has regions of others, too."""
    video = context.video
    for run in runs_of(context):
        shown = run[0] < video.stop and run[1] > video.first and run[2][1] > video.first + video.lead
        if shown or not video.is_piece:
            yield run


def plan_paint(context: PlanContext[MultistyleParams]) -> list[Task]:
    analyses: list[Task] = []
    paints: list[Task] = []
    total = context.results["scan"]["video"]["film"]
    size = context.video.width, context.video.height
    flows = is_prepared(context.params, size)
    for start, stop, shot in _painted_runs(context):
        args = {"start": start, "stop": stop, "last": stop == shot[1], "frames": total} | region_maps.ellipses(
            context, start, stop, shot
        )
        after = (analyses[-1].key,) if start > shot[0] and analyses else ()
        share = ANALYSIS_SHARE + (0.0 if flows else FLOW_SHARE)
        analyses.append(Task(_analysis_key(start), args, after, weight=share * (stop - start)))
        if context.video.is_piece and stop <= context.video.first + context.video.lead:
            continue  # its state is needed, and its frames are not
        args = {"start": start, "stop": stop, "before": after[0] if after else None, "last": stop == shot[1]}
        weight = (1 - FLOW_SHARE - ANALYSIS_SHARE) * (stop - start)
        paints.append(Task(f"run-{start:07d}", args, (_analysis_key(start), *after), (start, stop), weight=weight))
    groups = [[task] for task in analyses]
    if flows:
        groups = with_prepared(analyses, FLOW, FLOW_SHARE, BYTES_PER_PX * math.prod(working_size(size)))
    return _painted_behind(groups, paints)


def _painted_behind(analyses: Sequence[Sequence[Task]], paints: Sequence[Task]) -> list[Task]:
    """The tasks in the order in which workers prefer them: a run is painted `BEHIND` runs after its analysis.

    Args:
        analyses: the tasks of the analysis of each run.
    """
    ahead = min(BEHIND, len(analyses))
    ahead += len(analyses) - len(paints)  # those of the frames before a piece
    pairs = zip(analyses[ahead:], paints, strict=False)
    return [
        *chain.from_iterable(analyses[:ahead]),
        *(task for own, paint in pairs for task in (*own, paint)),
        *paints[max(0, len(analyses) - ahead) :],
    ]


def _analysis_key(start: int) -> str:
    return f"analyze-{start:07d}"


def run_paint(task: Task, context: TaskContext[MultistyleParams]) -> TaskResult:
    if task.emits is not None:
        return _paint(task, context)
    return run_flow(task, context) if task.key.startswith(FLOW) else _analyze(task, context)


def _analyze(task: Task, context: TaskContext[MultistyleParams]) -> TaskResult:
    """Analyse frames [start, stop), starting from the state of the previous run of the shot."""
    start, stop = task.args["start"], task.args["stop"]
    design = design_of(context, task.args["frames"])
    analyzer = StrokeAnalyzer(context.params, context.size, context.seed, context.clock, design)
    before = [key for key in task.after if not key.startswith(FLOW)]
    if before:
        analyzer.restore(context.load("paint", f"state-{before[0]}"))
    else:
        analyzer.number = start
    flow = context.load("paint", prepared_key(FLOW, start)) if len(task.after) > len(before) else {}
    placed = region_maps.placed(design, task, context)
    kept: State = {}
    count = 0
    motion = given_motion(context)
    given = (
        flow[str(number)] if str(number) in flow else motion.flow(number, number - 1, analyzer.work)
        for number in range(start, stop)
    )  # fmt: skip
    wanted = [name for name in ("flow", "orientation") if context.wants_pass(name)]
    frames, many = context.frames("video", start, stop), usable_processors() >= MANY_PROCESSORS
    with ThreadPoolExecutor(LAYER_THREADS, "impasto-layers") as threads:
        analyzer.background = RowExecutor(threads, LAYER_THREADS) if many else INLINE
        for seen in _observed(analyzer, frames, map(placed, range(start, stop)), given, start):
            analysis = analyzer.place_strokes(seen)
            if wanted:
                made = observed_passes(seen)
                context.emit_passes(start + count, {name: made[name] for name in wanted})
            kept |= {f"{count}.{name}": array for name, array in analysis.pack().items()}
            count += 1
            context.progress(count / (stop - start))
    recalled = 0 if task.args["last"] else accumulated_frames(context.params)
    context.save(task.key, _frames_of(kept, 0, count - recalled))
    if recalled:
        context.save(f"last-{task.key}", _frames_of(kept, count - recalled, count))
    if not task.args["last"]:
        context.save(f"state-{task.key}", analyzer.state())
    if analyzer.design is None:
        return {"frames": count}
    return {"frames": count, "laplace_residual": analyzer.design.residual, "laplace_cycles": analyzer.design.cycles}


def _observed(
    analyzer: StrokeAnalyzer,
    frames: Iterator[Frame],
    placed: Iterator[RegionPlacement | None],
    given: Iterator[Flow | None],
    first: int,
) -> Iterator[Observation]:
    """Observations of the frames from number `first` on, made by threads that are some frames ahead."""
    many = usable_processors() >= MANY_PROCESSORS
    with ExitStack() as stack:
        threads = [stack.enter_context(ThreadPoolExecutor(1, "impasto-observe")) for _ in range(3 if many else 1)]
        sensing, denoising, orienting = threads if many else 3 * threads
        ahead = deque[Future[Observation]]()
        for number, (frame, regions, flow) in enumerate(zip(frames, placed, given, strict=False), first):
            sensed = sensing.submit(analyzer.sense, frame, regions, flow, number)
            denoised = denoising.submit(_applied, analyzer.denoise, sensed)
            ahead.append(orienting.submit(_applied, analyzer.orient, denoised))
            if len(ahead) > (STAGES_AHEAD if many else OBSERVED_AHEAD):
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()


def _applied(function: Callable[[G], T], given: Future[G]) -> T:
    return function(given.result())


def _frames_of(kept: State, first: int, stop: int) -> State:
    """Packed analyses of the frames [first, stop) of a run."""
    return {name: array for name, array in kept.items() if first <= int(name.partition(".")[0]) < stop}


def _paint(task: Task, context: TaskContext[MultistyleParams]) -> TaskResult:
    """Paint frames [start, stop) from their analyses and those of the few previous frames."""
    start, stop = task.args["start"], task.args["stop"]
    key = _analysis_key(start)
    wanted = [name for name in ("stroke-ids", "layers") if context.wants_pass(name)]
    painter = Painter(context.params, context.size, context.seed, context.clock, 1, context.deep,
                      not context.paints_opacity, bool(wanted))  # fmt: skip
    before: list[StrokeAnalysis] = []
    if painter.accumulated and task.args["before"]:
        before = _unpacked(context.load("paint", f"last-{task.args['before']}"))
    found = context.mattes(start - len(before), stop) if context.paints_opacity else None
    mattes: Iterator[AnyArray | None] = repeat(None) if found is None else chain(found, repeat(None))
    for analysis in before:
        painter.load_previous(analysis, shared=True, matte=next(mattes))
    recalled = 0 if task.args["last"] else painter.accumulated
    frames = _unpacked(context.load("paint", key))
    if recalled:
        frames += _unpacked(context.load("paint", f"last-{key}"))
    for k, analysis in enumerate(frames):
        context.emit(start + k, painter.paint(analysis, k >= len(frames) - recalled, next(mattes)))
        if painter.traces is not None:
            made = {"stroke-ids": painter.traces.owners, "layers": painter.traces.shares}
            context.emit_passes(start + k, {name: made[name] for name in wanted})
        context.progress((k + 1) / (stop - start))
    if context.wants(DIRECTIONS):
        pictures = {
            start + k: orientation_picture(analysis, context.size) for k, analysis in enumerate(frames)
            if context.video.delivers(start + k)
        }  # fmt: skip
        context.save_file(f"{DIRECTIONS}-{start:07d}.zip", archive(pictures), "application/zip")
    return {"frames": len(frames)}


def _unpacked(kept: Arrays) -> list[StrokeAnalysis]:
    """Analyses of several frames, in order."""
    return [unpack(part(kept, str(number))) for number in sorted({int(name.partition(".")[0]) for name in kept})]


def plan_regions(context: PlanContext[MultistyleParams]) -> list[Task]:
    return region_maps.plan_regions(context, list(runs_of(context)))


def plan_maps(context: PlanContext[MultistyleParams]) -> list[Task]:
    return region_maps.plan_maps(context, list(runs_of(context)))


def run_regions(task: Task, context: TaskContext[MultistyleParams]) -> TaskResult:
    return region_maps.run_regions(task, context, design_of(context, task.args["frames"]))


def run_maps(task: Task, context: TaskContext[MultistyleParams]) -> TaskResult:
    return region_maps.run_maps(task, context, design_of(context, task.args["frames"]))
