"""A task at work: a source, its style at every level, a device; frames on their own, or a run of a sweep."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.compute import device
from pipeline.frames import Frame
from pipeline.methods.analogy.composite import paint_name
from pipeline.methods.analogy.layers import Found
from pipeline.methods.analogy.memory import operations
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.plan import Job
from pipeline.methods.analogy.shots import Shot, Stills, levels_of, matching
from pipeline.methods.analogy.sources import Pair, Source
from pipeline.methods.analogy.styles import Styles, goal_of
from pipeline.methods.base import Arrays, Bench, Note
from pipeline.synthesis.engine import colours
from pipeline.synthesis.images import Bytes, Offsets
from pipeline.synthesis.keeping import kept, restored
from pipeline.synthesis.operations import Loaded, Sitting
from pipeline.synthesis.sweeps import Rounds, Seated, Sweep, order

COARSE_ROUNDS = 2
"""Times as many iterations at the coarsest level, where all begins at random and a round costs next to nothing."""
STEP = "synthesise"


class Studio:
    """A task's style and device."""

    keyed = False

    def __init__(self, bench: Bench, source: Source, pair: Pair | None = None) -> None:
        self.bench, self.source = bench, source
        self.params: AnalogyParams = source.params
        with bench.clock("style"):
            self.pair = pair or source.pair()
            self.styles = Styles(self.pair, self.params)
        self.levels = levels_of(self.params, bench.size, min(self.pair.output.shape[:2]))
        self.ops, self.says = operations(device(), bench.size, self.pair.output, self._frames_held())
        self._loaded: dict[int, Loaded[Any]] = {}
        self._part, self._parts = 0, 1
        self._between: dict[str, Arrays] = {}
        """What jobs of this task have left for the next one of it."""

    def _frames_held(self) -> int:
        """Frames whose offsets are kept at once."""
        return 2

    def note(self, frames: int) -> Note:
        """What a task has to tell."""
        return {"frames": frames} | ({"says": self.says} if self.says else {})

    def style(self, level: int) -> Loaded[Any]:
        if level not in self._loaded:
            with self.bench.clock("style"):
                colours_ = self.pair.output.shape[2]
                goal = goal_of(self.params, self.source.guides, level, colours=colours_, keyed=self.keyed)
                self._loaded[level] = self.ops.load(self.styles.at(level, goal), goal)
        return self._loaded[level]

    def match(self) -> Callable[[Bytes], Bytes]:
        found = Found.of(self.bench.load("scan", self.source.found))
        return matching(self.params, self.pair, found.tones)

    def stills(self, start: int, stop: int, level: int, match: Callable[[Bytes], Bytes]) -> Stills:
        return Stills(self.source, self.bench.clock, start, stop, level, match)

    def shot(self, stills: Stills) -> Shot:
        return Shot(stills, self.bench.clock, self.style(stills.level).style.first)

    def rounds(self, level: int, stream: int) -> Rounds:
        coarsest = level == self.levels - 1
        iterations = self.params.iterations * (COARSE_ROUNDS if coarsest else 1)
        reach = float(max(self.style(level).size)) if coarsest else self.params.search_radius
        return Rounds(iterations, reach, self.bench.seed & 0xFFFFFFFF, stream)

    def do(self, jobs: Sequence[tuple[str, Job]]) -> None:
        """The jobs of a task, by their names, in order. What any but the last leaves is for the next ones alone."""
        for self._part, (key, job) in enumerate(jobs):
            self._parts = len(jobs)
            if job.level < 0:
                self.alone(job)
            elif job.level < self.levels:
                self.sweep(key, job)
            else:
                self._progress(1.0)  # a level coarser than fits

    def _progress(self, done: float) -> None:
        """Of the job that is being done, 0..1."""
        self.bench.progress((self._part + done) / self._parts)

    @property
    def _last_part(self) -> bool:
        return self._part + 1 == self._parts

    # -- each frame on its own

    def alone(self, job: Job) -> None:
        """Synthesise each frame from coarse to fine and emit it."""
        match = self.match()
        for index in range(job.start, job.stop):
            stills = [self.stills(index, index + 1, level, match) for level in range(self.levels)]
            offsets = self._still(index, stills, (index - job.start) / (job.stop - job.start))
            self.hand_out(index, offsets, stills[0])
            self.bench.progress((index + 1 - job.start) / (job.stop - job.start))

    def _still(self, index: int, stills: list[Stills], done: float) -> Offsets:
        above: tuple[int, Seated[Any]] | None = None
        for level in reversed(range(self.levels)):
            known = self._upsampled(above)
            rounds = self.rounds(level, 64 + level)
            sweep = Sweep(self.ops, self.style(level), self.shot(stills[level]), known, rounds, True)
            with self.bench.clock("synthesis"):
                above = level, next(sweep.run([index]))
                self.ops.finish()
            self.bench.progress(done)
        assert above is not None
        found: Offsets = self.ops.fetch(above[1].offsets)
        return found

    def _upsampled(self, above: tuple[int, Seated[Any]] | None) -> Callable[[int, Sitting[Any]], Any]:
        def known(_: int, sitting: Sitting[Any]) -> Any:
            if above is None:
                return None
            level, seen = above
            return self.ops.upsample(self.style(level), seen.sitting, seen.offsets, self.style(level - 1), sitting)

        return known

    def hand_out(self, index: int, offsets: Offsets, stills: Stills) -> None:
        """A finished frame: emitted, or saved for the step `composite`."""
        shown = colours(self.style(0).style, offsets)
        if self.source.layer < 0:
            self.bench.emit(index, np.ascontiguousarray(shown[..., :3]))
            return
        region, mask = stills.regions.get(index), stills.masks.get(index)
        if shown.shape[2] == 4:
            alpha = shown[..., 3] if region is None else np.where(region > 0, shown[..., 3], 0)
        else:
            alpha = np.full(shown.shape[:2], 255) if mask is None else np.where(mask > 0, 255, 0)
        rgba = np.dstack([shown[..., :3], alpha.astype(np.uint8)])
        self.bench.save(paint_name(self.source.layer, index), {"rgba": rgba})

    def preview(self, level: int, offsets: Offsets) -> None:
        """A coarse picture, as soon as there is one."""
        shown: Frame = np.ascontiguousarray(colours(self.style(level).style, offsets)[..., :3])
        self.bench.show(shown)

    # -- a run of a sweep

    def sweep(self, key: str, job: Job) -> None:
        """Frames [start, stop) in the sweep's order, from what earlier tasks have saved; save or emit them."""
        edge = job.start - 1 if job.forward else job.stop
        first = max(job.start - 1, job.begin) if job.forward else job.start
        last = job.stop if job.forward else min(job.stop + 1, job.end)
        match = self.match()
        stills = self.stills(first, last, job.level, match)
        before = self._before(job, match)
        sweep = Sweep(
            self.ops, self.style(job.level), self.shot(stills), before,
            self.rounds(job.level, job.level * 8 + job.sweep), job.forward, keep_first=job.sweep > 0,
        )  # fmt: skip
        if job.neighbour:
            sitting = self.ops.seat(self.style(job.level), stills.target(edge))
            sweep.last = Seated(edge, sitting, self._restore(f"{job.neighbour}-edge", edge, job.level))
        found = self._collect(sweep, job)
        self._hand_over(key, job, found, stills)

    def _before(self, job: Job, match: Callable[[Bytes], Bytes]) -> Callable[[int, Sitting[Any]], Any]:
        """What is known of a frame: the sweep before, or the coarser level, whose sittings only its directions need."""
        if job.first or not job.known or (job.coarser and job.level + 1 >= self.levels):
            return lambda index, sitting: None
        saved = self._between[job.known] if job.known in self._between else self.bench.load(STEP, job.known)
        if not job.coarser:
            return lambda index, sitting: self.ops.upload(self._offsets(saved, index, job.level))
        above = self.stills(job.start, job.stop, job.level + 1, match)

        def known(index: int, sitting: Sitting[Any]) -> Any:
            seat = self.ops.seat(self.style(job.level + 1), above.target(index))
            seen = Seated(index, seat, self.ops.upload(self._offsets(saved, index, job.level + 1)))
            return self._upsampled((job.level + 1, seen))(index, sitting)

        return known

    def _longest(self, level: int) -> int:
        return max(self.style(level).size)

    def _offsets(self, saved: Mapping[str, NDArray[Any]], index: int, level: int) -> Offsets:
        return restored(saved[str(index)], self._longest(level))

    def _restore(self, name: str, index: int, level: int) -> Any:
        return self.ops.upload(self._offsets(self.bench.load(STEP, name), index, level))

    def _collect(self, sweep: Sweep[Any], job: Job) -> dict[int, Offsets]:
        """Run it."""
        found: dict[int, Offsets] = {}
        count = job.stop - job.start
        steps = iter(sweep.run(order(job.start, job.stop, job.forward)))
        for done in range(count):
            with self.bench.clock("synthesis"):
                seen = next(steps)
                found[seen.index] = self.ops.fetch(seen.offsets)
            self._progress((done + 1) / count)
        return found

    def _hand_over(self, key: str, job: Job, found: dict[int, Offsets], stills: Stills) -> None:
        longest = self._longest(job.level)
        edge = job.stop - 1 if job.forward else job.start
        if (job.stop < job.end) if job.forward else (job.start > job.begin):
            self.bench.save(f"{key}-edge", {str(edge): kept(found[edge], longest)})
        if job.last:
            for index in range(job.start, job.stop):
                self.hand_out(index, found[index], stills)
            return
        arrays = {str(index): kept(offsets, longest) for index, offsets in found.items()}
        if self._last_part:
            self.bench.save(key, arrays)
        else:
            self._between[key] = arrays
        self.preview(job.level, found[edge])
