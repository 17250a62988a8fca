"""Step "paint": patches carried back into each frame, over a painting of what belongs to none."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.frames import Frame, Labels, Plane
from pipeline.methods.base import Bench, Brief, Note, Task
from pipeline.methods.patches.ages import presence
from pipeline.methods.patches.artefacts import keep_labels, label_png
from pipeline.methods.patches.carried import CarriedStrokes
from pipeline.methods.patches.clusters import LabelMaps
from pipeline.methods.patches.fit import Look, patch_fits
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.hertzmann import Painter
from pipeline.methods.patches.links import Links
from pipeline.methods.patches.lives import Life, lives
from pipeline.methods.patches.masking import leniency
from pipeline.methods.patches.painted import Painted
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.remainder import FADE, SEEN, Remainder
from pipeline.methods.patches.scan import RUN, run_key, runs
from pipeline.warp.panorama import Lay, full_map


def plan_paint(brief: Brief) -> list[Task]:
    every = lives(brief) if brief.params.temporal == "on" else []
    chained = brief.params.temporal == "strokes"
    tasks: list[Task] = []
    before = ""
    for start, stop, begin, end in runs(brief, RUN // brief.params.hold * brief.params.hold):
        here = [life.args() for life in every if life.begin == begin and life.start < stop and life.stop > start]
        notes = [brief.notes["patch"][life["key"]] for life in here]
        args = {"start": start, "stop": stop, "begin": begin, "end": end, "lives": here, "notes": notes}
        after = (before,) if chained and start > begin else ()
        tasks.append(Task(run_key(start), args, after, (start, stop), weight=stop - start))
        before = run_key(start)
    return tasks


def run_paint(task: Task, bench: Bench) -> Note:
    """Emit frames [start, stop)."""
    params: PatchesParams = bench.params
    start, stop, begin = task.args["start"], task.args["stop"], task.args["begin"]
    paint = _frame_painter(task, bench)
    shown: Frame | None = None
    for index, frame in _ahead(held_frames(bench, task, params.hold), task, paint, params.hold):
        if frame is not None:
            with bench.clock("composite"):
                shown = paint(index, frame)
        assert shown is not None
        bench.emit(index, shown)
        bench.progress((index + 1 - start) / (stop - start))
    if isinstance(paint, Carrier):
        paint.save(task.key)
    if params.temporal == "on" and bench.wants("labels"):
        maps, grid = LabelMaps(bench, begin), Grid.of(bench.size)
        keep_labels(bench, task.key, {index: label_png(maps.sure(index), grid) for index in range(start, stop)})
    return {}


def held_frames(bench: Bench, task: Task, hold: int) -> Iterator[tuple[int, Frame | None]]:
    """Frames of a run, and the one after them in the shot; None where the last painting is held."""
    start, stop, end = (task.args[name] for name in ("start", "stop", "end"))
    for index, frame in enumerate(bench.frames("video", start, min(stop + 1, end)), start=start):
        yield index, frame if (index - start) % hold == 0 else None


def _ahead(
    source: Iterator[tuple[int, Frame | None]], task: Task, paint: Compositor | Carrier | Alone, hold: int
) -> Iterator[tuple[int, Frame | None]]:
    """The run's frames, when those that will fade over to the next run's first one know of it."""
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


def _frame_painter(task: Task, bench: Bench) -> Compositor | Carrier | Alone:
    if bench.params.temporal == "off":
        return Alone.of(bench.params, bench.size, bench.seed)
    return Carrier(task, bench) if bench.params.temporal == "strokes" else Compositor(task, bench)


@dataclass(frozen=True)
class Alone:
    """Every frame on its own: Hertzmann's painter, the honest baseline."""

    painter: Painter

    @classmethod
    def of(cls, params: PatchesParams, size: tuple[int, int], seed: int) -> Alone:
        return cls(Painter.of(params.style, size[0] * size[1], size[1], params, seed))

    def __call__(self, index: int, frame: Frame) -> Frame:
        return self.painter.picture(frame)


class Carrier:
    """Strokes carried from frame to frame, the second baseline; runs are a chain and hand their strokes on."""

    def __init__(self, task: Task, bench: Bench) -> None:
        self._bench, self._params = bench, bench.params
        self._grid, self._begin = Grid.of(bench.size), task.args["begin"]
        self._links = Links(bench, self._begin, RUN)
        self._strokes = CarriedStrokes(Alone.of(bench.params, bench.size, bench.seed).painter)
        if task.after:
            self._strokes.restore(bench.load("paint", task.after[0]))

    def __call__(self, index: int, frame: Frame) -> Frame:
        pair = self._links.ahead(index - 1) if index > self._begin else None
        if pair is None:
            return self._strokes.step(frame, index)
        flow = self._grid.enlarge(pair[0]) * np.array(self._grid.ratio, np.float32)
        hidden = self._grid.enlarge(pair[1]) < np.float32(1 / 255)
        return self._strokes.step(frame, index, flow.astype(np.float32), hidden)

    def save(self, key: str) -> None:
        """Keep the strokes for the next run."""
        self._bench.save(key, self._strokes.state())


class Compositor:
    """Puts the frames of a run together from patches."""

    def __init__(self, task: Task, bench: Bench) -> None:
        begin = task.args["begin"]
        self._params: PatchesParams = bench.params
        self._grid, self._size = Grid.of(bench.size), bench.size
        self._maps = LabelMaps(bench, begin)
        start, stop = task.args["start"], task.args["stop"]
        self._patches = [
            Painted.load(Life(**row), note, start, stop, bench)
            for row, note in zip(task.args["lives"], task.args["notes"], strict=True)
        ]
        painter = Alone.of(bench.params, bench.size, bench.seed).painter
        self._remainder = Remainder(painter, Links(bench, begin, RUN), self._grid)

    def __call__(self, index: int, frame: Frame) -> Frame:
        """Frame `index`, painted."""
        return self._look(index, frame, self._remainder)[1]

    def turn_to(self, index: int, frame: Frame) -> None:
        """Frame `index` begins the next run: what is left of this one fades over to how it will be painted."""
        if self._remainder.used:
            picture, shown = self._look(index, frame, replace(self._remainder, last=None, left=None, shown={}))
            self._remainder.turn_to(index, picture, shown, self._params.hold)

    def _look(self, index: int, frame: Frame, remainder: Remainder) -> tuple[Frame, Frame]:
        """What is painted and how: float sums of patches and of what is left, weights summing to 1 everywhere."""
        labels, limit = self._maps.sure(index), np.float32(self._params.misfit) * leniency(frame, self._grid.unit)
        total = np.zeros((2, *frame.shape), np.float32)
        share = np.zeros(frame.shape[:2], np.float32)
        for patch in self._patches:
            if (lay := patch.lays.get(index)) is not None:
                self._lay_over(total, share, patch, lay, labels, index, frame, limit)
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
        self, total: Look, share: Plane, patch: Painted, lay: Lay, labels: Labels, index: int,
        frame: Frame, limit: Plane,
    ) -> None:  # fmt: skip
        rect, x, y = full_map(lay, self._grid.ratio, self._size, patch.origin)
        box = slice(rect[1], rect[3]), slice(rect[0], rect[2])
        look = patch.at(index, x, y)
        alpha = presence(labels == patch.life.label, self._grid)[box] * np.float32(patch.life.weight(index))
        alpha = alpha * patch_fits(frame[box], look, limit[box], self._grid)
        total[:, *box] += look * alpha[..., None]
        share[box] += alpha
