"""Plan of a batch job: shots are processed in parallel, runs of frames within a shot in sequence.

    scan        one pass over the video: number of frames, and first frames of the shots
    reference   colour scheme of the reference, if there is one
    abstract    runs of at most RUN_FRAMES frames; a run continues from the state that the previous run saved, the
                first run of a shot starts without state

The saved state is the complete state of a session, so the result equals that of one session over the whole video byte
for byte, for any number of workers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.colour.scheme import ColourStats, from_histogram, learn
from pipeline.frames import Frame, Plane
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.pass_maker import MADE, PassMaker
from pipeline.methods.abstraction.session import AbstractionSession, PipelinedRunner
from pipeline.methods.abstraction.svg_archive import SvgArchive
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.given_motion import given_motion
from pipeline.methods.masks import drawn_plane, fitted
from pipeline.methods.scan import delivered_shots, scan_video

RUN_FRAMES = 96
"""Frames per task: about 3 s of work at 720p, which is repeated after a failure."""


def plan_scan(context: PlanContext[AbstractionParams]) -> list[Task]:
    return [Task("video", weight=0.05 * max(context.video.frames, 1))]


def run_scan(task: Task, context: TaskContext[AbstractionParams]) -> TaskResult:
    """Result: number of frames, and cuts as a live session finds them."""
    frames, cuts = scan_video(context, context.params.cut_sensitivity)
    return {"frames": frames, "cuts": cuts}


def plan_reference(context: PlanContext[AbstractionParams]) -> list[Task]:
    return [Task("colours")] if "reference" in context.inputs or "histogram" in context.inputs else []


def run_reference(task: Task, context: TaskContext[AbstractionParams]) -> TaskResult:
    """Compute the colour scheme and save it as the artefact "colours"."""
    with context.clock("learn"):
        if context.has("histogram"):
            scheme = from_histogram(context.json("histogram"), "inputs.histogram")
        else:
            scheme = learn(_reported(context), "inputs.reference")
    tone = np.array([scheme.saturation_mean, scheme.saturation_std, scheme.value_mean])
    context.save("colours", {"hue": scheme.hue, "tone": tone})
    return {}


def _scheme(context: TaskContext[AbstractionParams]) -> ColourStats | None:
    if not context.has("reference") and not context.has("histogram"):
        return None
    kept = context.load("reference", "colours")
    saturation, spread, value = kept["tone"].tolist()
    return ColourStats(saturation, spread, value, kept["hue"])


def _reported(context: TaskContext[AbstractionParams]) -> Iterator[Frame]:
    for frame in context.frames("reference"):
        context.progress(0.5)
        yield frame


def plan_abstract(context: PlanContext[AbstractionParams]) -> list[Task]:
    scan = context.results["scan"]["video"]
    chained = context.params.temporal == "on"
    tasks: list[Task] = []
    for shot, (begin, end) in enumerate(delivered_shots(context, scan)):
        for start in range(begin, end, RUN_FRAMES):
            stop = min(start + RUN_FRAMES, end)
            after = (_key(start - RUN_FRAMES),) if start > begin and chained else ()
            args = {"start": start, "stop": stop, "shot": shot, "begin": begin, "last": stop == end}
            tasks.append(Task(_key(start), args, after, (start, stop), weight=stop - start))
    return tasks


def _key(start: int) -> str:
    return f"run-{start:07d}"


def run_abstract(task: Task, context: TaskContext[AbstractionParams]) -> TaskResult:
    """Paint frames [start, stop), starting from the state of the previous run of the shot."""
    start, stop = task.args["start"], task.args["stop"]
    session = AbstractionSession(context.params, context.size, _scheme(context), task.args["shot"], context.clock)
    if task.after:
        session.restore(context.load("abstract", task.after[0]))
    last = session.regions.segmenter.last
    svg = SvgArchive(task.key, context.params, last) if context.wants("svg") else None
    wanted = frozenset(made.name for made in MADE if context.wants_pass(made.name))
    passes = PassMaker(wanted, context.size, last) if wanted else None
    masks = _masks(task, context)
    index = start
    with PipelinedRunner(session) as runner:
        for painting in runner.run(context.frames("video", start, stop), masks, start, given_motion(context)):
            if svg is not None:
                svg.add(index, painting, context.video.delivers(index))
            if passes is not None:
                context.emit_passes(index, passes(painting))
            context.emit(index, painting.frame)
            index += 1
            context.progress((index - start) / (stop - start))
    if not task.args["last"] and context.params.temporal == "on":
        context.save(task.key, session.state())
    if svg is not None:
        context.save_file(svg.name, svg.close(), "application/zip")
    return {"frames": index - start}


def _masks(task: Task, context: TaskContext[AbstractionParams]) -> Mapping[int, Plane]:
    if not context.has("importance"):
        return {}
    start = None if task.after else task.args["start"]
    return _Masks(context.images("importance"), start, task.args["begin"], context.size)


class _Masks(Mapping[int, Plane]):
    """Importance masks by frame number, decoded on access.

    Args:
        start: frame at which the latest mask up to it holds; None: a state from before has it.
        begin: first frame of the shot. A drawing on a frame of another shot does not hold in it.
    """

    def __init__(
        self, images: Mapping[int, AnyArray], start: int | None, begin: int, size: tuple[int, int]
    ) -> None:  # fmt: skip
        self._images, self._begin, self._size = images, begin, size
        earlier = [number for number in images if start is not None and number <= start]
        self._source = {number: number for number in images}
        if start is not None and earlier:
            self._source[start] = max(earlier)

    def __getitem__(self, number: int) -> Plane:
        source = self._source[number]
        mask = fitted(drawn_plane(self._images[source]), self._size, f"inputs.importance[{source}]")
        if source < self._begin and np.isnan(mask).any():
            mask[:] = np.nan
        return mask

    def __iter__(self) -> Iterator[int]:
        return iter(self._source)

    def __len__(self) -> int:
        return len(self._source)
