"""What a task of the step `synthesise` does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.compute import device
from pipeline.frames import Frame
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.plan import Job
from pipeline.methods.analogy.shots import Shot, Stills, levels_of, matching
from pipeline.methods.analogy.styles import Styles, given_guides, goal_of, read_pair
from pipeline.methods.base import Bench, Note, Task
from pipeline.synthesis.engine import colours, show
from pipeline.synthesis.images import Bytes, Offsets
from pipeline.synthesis.keeping import kept, restored
from pipeline.synthesis.opencl import Kernels
from pipeline.synthesis.operations import Loaded, Sitting
from pipeline.synthesis.sweeps import Rounds, Seated, Sweep, order

COARSE_ROUNDS = 2
"""Times as many iterations at the coarsest level, where all begins at random and a round costs next to nothing."""
STEP = "synthesise"


def run_synthesis(task: Task, bench: Bench) -> Note:
    """One run of one sweep, or frames on their own."""
    job = Job(**task.args)
    studio = Studio(bench)
    if job.level < 0:
        studio.alone(job)
    elif job.level >= studio.levels:
        studio.pass_on(task.key)
    else:
        studio.sweep(task.key, job)
    return {"frames": job.stop - job.start}


class Studio:
    """A task's style and device."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.params: AnalogyParams = bench.params
        with bench.clock("style"):
            self.pair = read_pair(bench)
            self.styles = Styles(self.pair, self.params)
        self.levels = levels_of(self.params, bench.size, min(self.pair.output.shape[:2]))
        self.guides = given_guides(bench)
        self.ops = Kernels(device())
        self._loaded: dict[int, Loaded[Any]] = {}

    def style(self, level: int) -> Loaded[Any]:
        if level not in self._loaded:
            with self.bench.clock("style"):
                goal = goal_of(self.params, self.guides, level)
                self._loaded[level] = self.ops.load(self.styles.at(level, goal), goal)
        return self._loaded[level]

    def match(self) -> Callable[[Bytes], Bytes]:
        tones = self.bench.load("scan", "tones")
        return matching(self.params, self.pair, tones)

    def rounds(self, level: int, stream: int) -> Rounds:
        coarsest = level == self.levels - 1
        iterations = self.params.iterations * (COARSE_ROUNDS if coarsest else 1)
        reach = float(max(self.style(level).size)) if coarsest else self.params.search_radius
        return Rounds(iterations, reach, self.bench.seed & 0xFFFFFFFF, stream)

    # -- each frame on its own

    def alone(self, job: Job) -> None:
        """Synthesise each frame from coarse to fine and emit it."""
        match = self.match()
        for index in range(job.start, job.stop):
            stills = [Stills(self.bench, index, index + 1, level, match) for level in range(self.levels)]
            frame = self._still(index, stills, (index - job.start) / (job.stop - job.start))
            self.bench.emit(index, frame)
            self.bench.progress((index + 1 - job.start) / (job.stop - job.start))

    def _still(self, index: int, stills: list[Stills], done: float) -> Frame:
        above: tuple[int, Seated[Any]] | None = None
        for level in reversed(range(self.levels)):
            shot = Shot(stills[level], self.params, self.bench.clock)
            known = self._upsampled(above)
            sweep = Sweep(self.ops, self.style(level), shot, known, self.rounds(level, 64 + level), True)
            with self.bench.clock("synthesis"):
                above = level, next(sweep.run([index]))
                self.ops.device.finish()
            self.bench.progress(done)
        assert above is not None
        return self._shown(0, above[1].offsets)

    def _upsampled(self, above: tuple[int, Seated[Any]] | None) -> Callable[[int, Sitting[Any]], Any]:
        def known(_: int, sitting: Sitting[Any]) -> Any:
            if above is None:
                return None
            level, seen = above
            return self.ops.upsample(self.style(level), seen.sitting, seen.offsets, self.style(level - 1), sitting)

        return known

    def _shown(self, level: int, offsets: Any) -> Frame:
        return show(self.ops, self.style(level), offsets)

    # -- a run of a sweep

    def sweep(self, key: str, job: Job) -> None:
        """Frames [start, stop) in the sweep's order, from what earlier tasks have saved; save or emit them."""
        edge = job.start - 1 if job.forward else job.stop
        first = max(job.start - 1, job.begin) if job.forward else job.start
        last = job.stop if job.forward else min(job.stop + 1, job.end)
        match = self.match()
        stills = Stills(self.bench, first, last, job.level, match)
        before = self._before(job, match)
        sweep = Sweep(
            self.ops, self.style(job.level), Shot(stills, self.params, self.bench.clock), before,
            self.rounds(job.level, job.level * 8 + job.sweep), job.forward, keep_first=not job.forward and job.known != "",
        )  # fmt: skip
        if job.neighbour:
            sitting = self.ops.seat(self.style(job.level), stills.target(edge))
            sweep.last = Seated(edge, sitting, self._restore(f"{job.neighbour}-edge", edge, job.level))
        found = self._collect(sweep, job)
        self._hand_over(key, job, found)

    def _before(self, job: Job, match: Callable[[Bytes], Bytes]) -> Callable[[int, Sitting[Any]], Any]:
        """What is known of a frame: the sweep before, or the coarser level, whose sittings only its directions need."""
        if job.first or not job.known or (job.coarser and job.level + 1 >= self.levels):
            return lambda index, sitting: None
        saved = self.bench.load(STEP, job.known)
        if not job.coarser:
            return lambda index, sitting: self.ops.upload(self._offsets(saved, index, job.level))
        above = Stills(self.bench, job.start, job.stop, job.level + 1, match)

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
            self.bench.progress((done + 1) / count)
        return found

    def _hand_over(self, key: str, job: Job, found: dict[int, Offsets]) -> None:
        longest = self._longest(job.level)
        edge = job.stop - 1 if job.forward else job.start
        if job.last:
            self.bench.save(f"{key}-edge", {str(edge): kept(found[edge], longest)})
            for index in range(job.start, job.stop):
                self.bench.emit(index, self._painted(found[index]))
            return
        self.bench.save(key, {str(index): kept(offsets, longest) for index, offsets in found.items()})
        self.bench.save(f"{key}-edge", {str(edge): kept(found[edge], longest)})

    def _painted(self, offsets: Offsets) -> Frame:
        return np.ascontiguousarray(colours(self.style(0).style, offsets)[..., :3])

    def pass_on(self, key: str) -> None:
        """A level coarser than fits: nothing to do."""
        self.bench.progress(1.0)
