"""Step "paint": each frame is composited from warped patches, over a painting of the pixels that no patch covers."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.frames import Frame, Plane
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.patches.artefacts import LabelPictures
from pipeline.methods.patches.carried import CarriedStrokes
from pipeline.methods.patches.clusters import LabelMaps
from pipeline.methods.patches.fit import Rendering, patch_fits
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.hertzmann import Painter
from pipeline.methods.patches.links import Links
from pipeline.methods.patches.lives import Life, lives
from pipeline.methods.patches.masking import leniency
from pipeline.methods.patches.painted import Painted
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.remainder import FADE, SEEN, Remainder
from pipeline.methods.patches.scan import RUN, run_key, runs
from pipeline.methods.patches.soft_labels import SoftLabels
from pipeline.warp.panorama import Lay, full_map


def plan_paint(context: PlanContext[PatchesParams]) -> list[Task]:
    every = lives(context) if context.params.temporal == "on" else []
    chained = context.params.temporal == "strokes"
    tasks: list[Task] = []
    before = ""
    for start, stop, begin, end in runs(context, RUN // context.params.hold * context.params.hold):
        here = [life.args() for life in every if life.begin == begin and life.start < stop and life.stop > start]
        results = [context.results["patch"][life["key"]] for life in here]
        args = {"start": start, "stop": stop, "begin": begin, "end": end, "lives": here, "notes": results}
        after = (before,) if chained and start > begin else ()
        tasks.append(Task(run_key(start), args, after, (start, stop), weight=stop - start))
        before = run_key(start)
    return tasks


def run_paint(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Emit frames [start, stop)."""
    params = context.params
    start, stop, begin = task.args["start"], task.args["stop"], task.args["begin"]
    paint = _frame_painter(task, context)
    shown: Frame | None = None
    for index, frame in _ahead(held_frames(context, task, params.hold), task, paint, params.hold):
        if frame is not None:
            with context.clock("composite"):
                shown = paint(index, frame)
        assert shown is not None
        context.emit(index, shown)
        context.progress((index + 1 - start) / (stop - start))
    if isinstance(paint, Carrier):
        paint.save(task.key)
    pictures = LabelPictures(context)
    if params.temporal == "on" and pictures.wanted:
        maps, grid = LabelMaps(context, begin), Grid.of(context.size)
        for index, frame in enumerate(context.frames("video", start, stop), start=start):
            pictures.add(index, SoftLabels(maps.sure(index), frame, grid))
        pictures.save(task.key)
    return {}


def held_frames(context: TaskContext[PatchesParams], task: Task, hold: int) -> Iterator[tuple[int, Frame | None]]:
    """Frames of a run and the next frame of the shot; None where the previous painting is repeated."""
    start, stop, end = (task.args[name] for name in ("start", "stop", "end"))
    for index, frame in enumerate(context.frames("video", start, min(stop + 1, end)), start=start):
        yield index, frame if (index - start) % hold == 0 else None


def _ahead(
    source: Iterator[tuple[int, Frame | None]], task: Task, paint: Compositor | Carrier | Alone, hold: int
) -> Iterator[tuple[int, Frame | None]]:
    """Yield the run's frames with a delay, so that the next run's first frame is known before the cross-fade begins."""
    waiting = deque[tuple[int, Frame | None]]()
    most = FADE * hold if isinstance(paint, Compositor) else 1
    for index, frame in source:
        if index < task.args["stop"]:
            waiting.append((index, frame))
        elif isinstance(paint, Compositor) and frame is not None:
            paint.turn_to(index, frame)
        if len(waiting) >= most:
            yield waiting.popleft()
    yield from waiting


def _frame_painter(task: Task, context: TaskContext[PatchesParams]) -> Compositor | Carrier | Alone:
    if context.params.temporal == "off":
        return Alone.of(context.params, context.size, context.seed)
    return Carrier(task, context) if context.params.temporal == "strokes" else Compositor(task, context)


@dataclass(frozen=True)
class Alone:
    """First baseline: Hertzmann's painter, applied to each frame separately."""

    painter: Painter

    @classmethod
    def of(cls, params: PatchesParams, size: tuple[int, int], seed: int) -> Alone:
        return cls(Painter.of(params.style, size[0] * size[1], size[1], params, seed))

    def __call__(self, index: int, frame: Frame) -> Frame:
        return self.painter.picture(frame)


class Carrier:
    """Second baseline: strokes advected from frame to frame. Each run continues the strokes of the previous run."""

    def __init__(self, task: Task, context: TaskContext[PatchesParams]) -> None:
        self._context, self._params = context, context.params
        self._grid, self._begin = Grid.of(context.size), task.args["begin"]
        self._links = Links(context, self._begin, RUN)
        self._strokes = CarriedStrokes(Alone.of(context.params, context.size, context.seed).painter)
        if task.after:
            self._strokes.restore(context.load("paint", task.after[0]))

    def __call__(self, index: int, frame: Frame) -> Frame:
        pair = self._links.ahead(index - 1) if index > self._begin else None
        if pair is None:
            return self._strokes.step(frame, index)
        flow = self._grid.enlarge(pair[0]) * np.array(self._grid.ratio, np.float32)
        hidden = self._grid.enlarge(pair[1]) < np.float32(1 / 255)
        return self._strokes.step(frame, index, flow.astype(np.float32), hidden)

    def save(self, key: str) -> None:
        """Save the strokes for the next run."""
        self._context.save(key, self._strokes.state())


class _Mattes:
    """Mattes of all labels of a frame, normalised so that they sum to 1 at every pixel."""

    def __init__(self, soft: SoftLabels) -> None:
        self.soft = soft
        self._alphas: dict[int, Plane] = {}
        shape = soft.frame.shape[:2]
        self._total = np.zeros(shape, np.float32)
        for label in np.unique(soft.labels).tolist():
            box, plane = soft.box(label), np.zeros(shape, np.float32)
            plane[box] = soft.alpha(label, box)
            self._alphas[label] = plane
            self._total += plane

    def normalized(self, label: int) -> Plane:
        """Matte of a label, float32 (h, w), 0..1; 0 everywhere if the frame does not have it."""
        found = self._alphas.get(label)
        if found is None:
            return np.zeros_like(self._total)
        return np.asarray(found / np.maximum(self._total, np.float32(1e-3)), np.float32)


class Compositor:
    """Composites the frames of a run from patches and the remainder."""

    def __init__(self, task: Task, context: TaskContext[PatchesParams]) -> None:
        begin = task.args["begin"]
        self._params: PatchesParams = context.params
        self._grid, self._size = Grid.of(context.size), context.size
        self._maps = LabelMaps(context, begin)
        start, stop = task.args["start"], task.args["stop"]
        self._patches = [
            Painted.load(Life(**row), result, start, stop, context)
            for row, result in zip(task.args["lives"], task.args["notes"], strict=True)
        ]
        painter = Alone.of(context.params, context.size, context.seed).painter
        self._remainder = Remainder(painter, Links(context, begin, RUN), self._grid)

    def __call__(self, index: int, frame: Frame) -> Frame:
        """Frame `index`, painted."""
        return self._compose(index, frame, self._remainder)[1]

    def turn_to(self, index: int, frame: Frame) -> None:
        """Prepare the remainder's cross-fade to frame `index`, the first frame of the next run."""
        if self._remainder.used:
            picture, shown = self._compose(index, frame, replace(self._remainder, last=None, left=None, shown={}))
            self._remainder.turn_to(index, picture, shown, self._params.hold)

    def _compose(self, index: int, frame: Frame, remainder: Remainder) -> tuple[Frame, Frame]:
        """Source picture and painting, uint8 (h, w, 3) each: weighted means of patches and remainder."""
        labels, limit = self._maps.sure(index), np.float32(self._params.misfit) * leniency(frame, self._grid.unit)
        total = np.zeros((2, *frame.shape), np.float32)
        share = np.zeros(frame.shape[:2], np.float32)
        mattes = _Mattes(SoftLabels(labels, frame, self._grid))
        for patch in self._patches:
            if (lay := patch.lays.get(index)) is not None:
                self._lay_over(total, share, patch, lay, mattes, index, limit)
        left = remainder.lingers(index, 1 - share)
        total *= ((1 - left) / np.maximum(share, np.float32(1e-6)))[..., None]
        if (left > SEEN).any():
            total += remainder.paint(index, frame, left, limit) * left[..., None]
        else:
            total /= share[..., None]
        picture, shown = np.rint(np.clip(total, 0, 255)).astype(np.uint8)
        remainder.keep(index, picture, shown)
        return picture, shown

    def _lay_over(
        self, total: Rendering, share: Plane, patch: Painted, lay: Lay, mattes: _Mattes, index: int, limit: Plane
    ) -> None:
        rect, x, y = full_map(lay, self._grid.ratio, self._size, patch.origin)
        box = slice(rect[1], rect[3]), slice(rect[0], rect[2])
        rendering = patch.at(index, x, y)
        alpha = mattes.normalized(patch.life.label)[box] * np.float32(patch.life.weight(index))
        alpha = alpha * patch_fits(mattes.soft.frame[box], rendering, limit[box], self._grid)
        total[:, *box] += rendering * alpha[..., None]
        share[box] += alpha
