"""Step "paint": patches carried back into each frame, over a painting of what belongs to none."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Labels, Plane
from pipeline.methods.base import Bench, Brief, Note, Task
from pipeline.methods.patches.ages import fine_px, presence
from pipeline.methods.patches.artefacts import keep_labels, label_png
from pipeline.methods.patches.carried import CarriedStrokes
from pipeline.methods.patches.clusters import LabelMaps
from pipeline.methods.patches.fit import apart
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.hertzmann import Painter
from pipeline.methods.patches.join import load_lays
from pipeline.methods.patches.links import Links, norm
from pipeline.methods.patches.lives import Life, lives
from pipeline.methods.patches.masking import PAPER_HEIGHT, leniency, sharpness
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.remainder import FADE, SEEN, Look, Remainder
from pipeline.methods.patches.scan import RUN, run_key, runs
from pipeline.warp.panorama import Lay, full_map

AROUND_PX=6.0
REACH_PX=4.0
HALF=0.3
LEAST=0.7
POW=4.0
TURN = 3.0
"""Frames before and after the change of two ages in which one fades over into the other."""


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


@dataclass(frozen=True)
class Painted:
    """A patch that is painted.

    Attributes:
        life: when it is there.
        ages: [start, stop) of each of its pictures; panorama and painting of those that are needed, by number.
        origin: (x, y) of the first pixel of all of them, px.
        lays: where it lies, by frame.
    """

    life: Life
    ages: list[list[int]]
    looks: dict[int, tuple[Frame, Frame]]
    origin: tuple[int, int]
    lays: dict[int, Lay]

    @classmethod
    def load(cls, life: Life, note: Note, start: int, stop: int, bench: Bench) -> Painted:
        """What frames [start, stop] need of a patch: those of one run and the next one. `note` is its task's."""
        lays, looks = load_lays(bench, life, start, stop), {}
        for number, (first, last) in enumerate(note["ages"]):
            if first - TURN <= stop and last + TURN > start:
                kept = bench.load("patch", f"{life.key}-age{number}")
                looks[number] = kept["panorama"], kept["painting"]
        x, y = note["origin"]
        return cls(life, note["ages"], looks, (x, y), lays)

    def at(self, index: int, x: Plane, y: Plane) -> Look:
        """The patch as it is in a frame, and its paint, at places of the panorama.

        Between two ages one fades over into the other.
        """
        look = np.zeros((2, *x.shape, 3), np.float32)
        for number, share in self._shares(index):
            for which, (plane, how) in enumerate(zip(self.looks[number], (cv2.INTER_LINEAR, cv2.INTER_CUBIC), strict=True)):
                look[which] += np.float32(share) * cv2.remap(plane, x, y, how, borderMode=cv2.BORDER_REPLICATE)
        return look

    def _shares(self, index: int) -> list[tuple[int, float]]:
        number = next(n for n, (first, last) in enumerate(self.ages) if first <= index < last)
        first, last = self.ages[number]
        since, until = index - first + 0.5, last - index - 0.5
        if number > 0 and since < TURN and since <= until:
            share = 0.5 + since / (2 * TURN)
            return [(number, share), (number - 1, 1 - share)]
        if number + 1 < len(self.ages) and until < TURN:
            share = 0.5 + until / (2 * TURN)
            return [(number, share), (number + 1, 1 - share)]
        return [(number, 1.0)]


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
        self._remainder = Remainder(painter, Links(bench, begin, RUN), self._grid, self._params.misfit)

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
        labels, lenient = self._maps.sure(index), leniency(frame, self._size[1] / PAPER_HEIGHT)
        total = np.zeros((2, *frame.shape), np.float32)
        share = np.zeros(frame.shape[:2], np.float32)
        for patch in self._patches:
            if (lay := patch.lays.get(index)) is not None:
                self._lay_over(total, share, patch, lay, labels, index, frame, lenient)
        left = remainder.lingers(index, 1 - share)
        total *= ((1 - left) / np.maximum(share, np.float32(1e-6)))[..., None]
        if (left > SEEN).any():
            total += remainder.paint(index, frame, left, lenient) * left[..., None]
        else:
            total /= share[..., None]
        picture, shown = np.rint(np.clip(total, 0, 255)).astype(np.uint8)
        remainder.keep(index, picture, shown)
        return picture, shown

    def _lay_over(
        self, total: Look, share: Plane, patch: Painted, lay: Lay, labels: Labels, index: int,
        frame: Frame, lenient: Plane,
    ) -> None:  # fmt: skip
        rect, x, y = full_map(lay, self._grid.ratio, self._size, patch.origin)
        box = slice(rect[1], rect[3]), slice(rect[0], rect[2])
        look = patch.at(index, x, y)
        alpha = presence(labels == patch.life.label, self._grid)[box] * np.float32(patch.life.weight(index))
        alpha = alpha * self._fit(frame[box], look[0], look[1], lenient[box])
        total[:, *box] += look * alpha[..., None]
        share[box] += alpha

    def _fit(self, frame: Frame, picture: NDArray[np.float32], paint: NDArray[np.float32], lenient: Plane) -> Plane:
        """How well the patch shows what is in the frame, 0..1: it falls from `misfit` to half as much again.

        Departure: the paper leaves out no pixel of a cluster; a mouth that opens is then never seen. Without this the
        painting's worst half per cent is 57 gray levels off the video, with it 39 (foreman, at sigma 3 px); flicker
        falls by 6 %, but so does the structure that an outside measure sees, from 0.943 to 0.926.
        """
        sharp = sharpness(picture.astype(np.uint8), frame, self._size[1] / PAPER_HEIGHT)
        lenient = lenient * np.clip(sharp, 0.2, 1) ** POW
        off = apart(frame, picture, paint, np.float32(self._params.misfit) * lenient, fine_px(self._grid))
        keep = np.clip(3 - 2 * off, 0, 1)
        keep = keep * keep * (3 - 2 * keep)
        unit = self._size[1] / PAPER_HEIGHT
        around = cv2.GaussianBlur(keep, (0, 0), AROUND_PX * unit)
        reach = 2 * int(REACH_PX * unit) + 1
        core = cv2.dilate((off > 1.25).astype(np.uint8), np.ones((reach, reach), np.uint8))
        keep = np.where((core > 0) & (off > HALF), 0, keep)
        keep = cv2.GaussianBlur(keep.astype(np.float32), (0, 0), 1.0 * unit)
        return np.asarray(keep * np.clip((around - LEAST) * 5, 0, 1), np.float32)
