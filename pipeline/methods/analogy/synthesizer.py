"""Synthesis without keyframes: independent frames, or runs of frames of the sweeps of a shot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.compute import device
from pipeline.frames import Frame
from pipeline.methods.analogy.device_memory import operations
from pipeline.methods.analogy.layers import LayerStatistics, paint_name
from pipeline.methods.analogy.level_frames import Boil, LevelAnimation, LevelFrames, levels_of, matching
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.plan import SweepTask
from pipeline.methods.analogy.sources import Source, StylePair
from pipeline.methods.analogy.style_pyramid import StylePyramid, energy_of
from pipeline.methods.base import Arrays, TaskContext, TaskResult
from pipeline.synthesis.images import Bytes, Offsets, pack_offsets, unpack_offsets
from pipeline.synthesis.operations import FrameState, LoadedStyle
from pipeline.synthesis.refine import colours
from pipeline.synthesis.sweeps import SearchSchedule, SolvedFrame, Sweep, order

COARSE_ROUNDS = 2
"""Factor of iterations at the coarsest level, which starts from random offsets and costs little."""
STEP = "synthesise"


class Synthesizer:
    """Runs the sweeps of a task: holds its style at every level and the operations of the device."""

    keyed = False

    def __init__(self, context: TaskContext[AnalogyParams], source: Source, pair: StylePair | None = None) -> None:
        self.context, self.source = context, source
        self.params: AnalogyParams = source.params
        with context.clock("style"):
            self.pair = pair or source.pair()
            self.pyramid = StylePyramid(self.pair, self.params)
        self.levels = levels_of(self.params, context.size, min(self.pair.output.shape[:2]))
        self.ops, self.message = operations(device(), context.size, self.pair.output, self._frames_held())
        self._loaded: dict[int, LoadedStyle[Any]] = {}
        self._part, self._parts = 0, 1
        self._between: dict[str, Arrays] = {}
        """Results that a sweep of this task leaves for a later sweep of the same task."""

    def _frames_held(self) -> int:
        """Number of frames whose offsets are in device memory at the same time."""
        return 2

    def result(self, frames: int) -> TaskResult:
        """The result of the task."""
        return {"frames": frames} | ({"says": self.message} if self.message else {})

    def style(self, level: int) -> LoadedStyle[Any]:
        if level not in self._loaded:
            with self.context.clock("style"):
                colours_ = self.pair.output.shape[2]
                energy = energy_of(self.params, self.source.guides, level, colours=colours_, keyed=self.keyed)
                self._loaded[level] = self.ops.load(self.pyramid.at(level, energy), energy)
        return self._loaded[level]

    def match(self) -> Callable[[Bytes], Bytes]:
        found = LayerStatistics.of(self.context.load("scan", self.source.statistics_artefact))
        return matching(self.params, self.pair, found.tones)

    def level_frames(self, start: int, stop: int, level: int, match: Callable[[Bytes], Bytes]) -> LevelFrames:
        return LevelFrames(self.source, self.context.clock, start, stop, level, match)

    def shot(self, level_frames: LevelFrames) -> LevelAnimation:
        first = self.style(level_frames.level).style.first
        return LevelAnimation(level_frames, self.context.clock, first, boil=self.boil(level_frames.level))

    def boil(self, level: int) -> Boil | None:
        """The deliberate flicker at a level; None = off."""
        return Boil(self.params.boil, self.context.seed, level) if self.params.boil > 0 else None

    def shown(self, index: int, begin: int) -> int:
        """The frame whose painting is shown at frame `index`: itself, or the even one before it on twos."""
        return index - (index - begin) % 2 if self.params.on_twos == "on" else index

    def rounds(self, level: int, stream: int) -> SearchSchedule:
        coarsest = level == self.levels - 1
        iterations = self._iterations(level) * (COARSE_ROUNDS if coarsest else 1)
        reach = float(max(self.style(level).size)) if coarsest else self._search_px()
        return SearchSchedule(iterations, reach, self.context.seed & 0xFFFFFFFF, stream)

    def _iterations(self, level: int) -> int:
        """Rounds of PatchMatch a frame and sweep at a level."""
        return self.params.iterations

    def _search_px(self) -> float:
        """Radius of the random search at all but the coarsest level, px."""
        return self.params.search_radius

    def run_sweeps(self, jobs: Sequence[tuple[str, SweepTask]]) -> None:
        """Run the sweeps of a task, (key, sweep), in order. Only the last one saves its result as an artefact."""
        for self._part, (key, job) in enumerate(jobs):
            self._parts = len(jobs)
            if job.level < 0:
                self.synthesise_independently(job)
            elif job.level < self.levels:
                self.sweep(key, job)
            else:
                self._progress(1.0)  # a level coarser than fits

    def _progress(self, done: float) -> None:
        """Report the progress of the current sweep, 0..1."""
        self.context.progress((self._part + done) / self._parts)

    @property
    def _last_part(self) -> bool:
        return self._part + 1 == self._parts

    # -- each frame on its own

    def synthesise_independently(self, job: SweepTask) -> None:
        """Synthesise each frame independently, from coarse to fine, and emit it."""
        match = self.match()
        for index in range(job.start, job.stop):
            level_frames = [self.level_frames(index, index + 1, level, match) for level in range(self.levels)]
            if self.shown(index, job.begin) == index:
                offsets = self._still(index, level_frames, (index - job.start) / (job.stop - job.start))
            self.emit_frame(index, offsets, level_frames[0])
            self.context.progress((index + 1 - job.start) / (job.stop - job.start))

    def _still(self, index: int, level_frames: list[LevelFrames], done: float) -> Offsets:
        above: tuple[int, SolvedFrame[Any]] | None = None
        for level in reversed(range(self.levels)):
            known = self._upsampled(above)
            rounds = self.rounds(level, 64 + level)
            sweep = Sweep(self.ops, self.style(level), self.shot(level_frames[level]), known, rounds, True)
            with self.context.clock("synthesis"):
                above = level, next(sweep.run([index]))
                self.ops.finish()
            self.context.progress(done)
        assert above is not None
        found: Offsets = self.ops.fetch(above[1].offsets)
        return found

    def _upsampled(self, above: tuple[int, SolvedFrame[Any]] | None) -> Callable[[int, FrameState[Any]], Any]:
        def known(_: int, state: FrameState[Any]) -> Any:
            if above is None:
                return None
            level, seen = above
            return self.ops.upsample(self.style(level), seen.state, seen.offsets, self.style(level - 1), state)

        return known

    def emit_frame(self, index: int, offsets: Offsets, level_frames: LevelFrames) -> None:
        """Emit a finished frame, or save it for the step `composite` if it is a layer."""
        shown = colours(self.style(0).style, offsets)
        if self.source.layer < 0:
            self.context.emit(index, np.ascontiguousarray(shown[..., :3]))
            return
        region, mask = level_frames.regions.get(index), level_frames.masks.get(index)
        if shown.shape[2] == 4:
            alpha = shown[..., 3] if region is None else np.where(region > 0, shown[..., 3], 0)
        else:
            alpha = np.full(shown.shape[:2], 255) if mask is None else np.where(mask > 0, 255, 0)
        rgba = np.dstack([shown[..., :3], alpha.astype(np.uint8)])
        self.context.save(paint_name(self.source.layer, index), {"rgba": rgba})

    def preview(self, level: int, offsets: Offsets) -> None:
        """Show the picture of a coarse level as a preview."""
        shown: Frame = np.ascontiguousarray(colours(self.style(level).style, offsets)[..., :3])
        self.context.show(shown)

    # -- a run of a sweep

    def sweep(self, key: str, job: SweepTask) -> None:
        """Run one sweep over frames [start, stop), starting from the artefacts of earlier tasks; save or emit the
        result."""
        edge = job.start - 1 if job.forward else job.stop
        first = max(job.start - 1, job.begin) if job.forward else job.start
        last = job.stop if job.forward else min(job.stop + 1, job.end)
        match = self.match()
        level_frames = self.level_frames(first, last, job.level, match)
        before = self._before(job, match)
        sweep = Sweep(
            self.ops, self.style(job.level), self.shot(level_frames), before,
            self.rounds(job.level, job.level * 8 + job.sweep), job.forward, keep_first=job.sweep > 0,
        )  # fmt: skip
        if job.neighbour:
            state = self.ops.prepare(self.style(job.level), level_frames.target(edge))
            sweep.last = SolvedFrame(edge, state, self._restore(f"{job.neighbour}-edge", edge, job.level))
        found = self._collect(sweep, job)
        self._save_or_emit(key, job, found, level_frames)

    def _before(self, job: SweepTask, match: Callable[[Bytes], Bytes]) -> Callable[[int, FrameState[Any]], Any]:
        """The previous result of a frame: of the sweep before, or of the coarser level."""
        if job.first or not job.known or (job.coarser and job.level + 1 >= self.levels):
            return lambda index, state: None
        saved = self._between[job.known] if job.known in self._between else self.context.load(STEP, job.known)
        if not job.coarser:
            return lambda index, state: self.ops.upload(self._offsets(saved, index, job.level))
        above = self.level_frames(job.start, job.stop, job.level + 1, match)

        def known(index: int, state: FrameState[Any]) -> Any:
            coarse = self.ops.prepare(self.style(job.level + 1), above.target(index))
            seen = SolvedFrame(index, coarse, self.ops.upload(self._offsets(saved, index, job.level + 1)))
            return self._upsampled((job.level + 1, seen))(index, state)

        return known

    def _longest(self, level: int) -> int:
        return max(self.style(level).size)

    def _offsets(self, saved: Mapping[str, NDArray[Any]], index: int, level: int) -> Offsets:
        return unpack_offsets(saved[str(index)], self._longest(level))

    def _restore(self, name: str, index: int, level: int) -> Any:
        return self.ops.upload(self._offsets(self.context.load(STEP, name), index, level))

    def _collect(self, sweep: Sweep[Any], job: SweepTask) -> dict[int, Offsets]:
        """Run a sweep and download its offsets, by frame number."""
        found: dict[int, Offsets] = {}
        count = job.stop - job.start
        steps = iter(sweep.run(order(job.start, job.stop, job.forward)))
        for done in range(count):
            with self.context.clock("synthesis"):
                seen = next(steps)
                found[seen.index] = self.ops.fetch(seen.offsets)
            self._progress((done + 1) / count)
        return found

    def _save_or_emit(self, key: str, job: SweepTask, found: dict[int, Offsets], level_frames: LevelFrames) -> None:
        longest = self._longest(job.level)
        edge = job.stop - 1 if job.forward else job.start
        if (job.stop < job.end) if job.forward else (job.start > job.begin):
            self.context.save(f"{key}-edge", {str(edge): pack_offsets(found[edge], longest)})
        if job.last:
            for index in range(job.start, job.stop):
                self.emit_frame(index, found[self.shown(index, job.begin)], level_frames)
            return
        arrays = {str(index): pack_offsets(offsets, longest) for index, offsets in found.items()}
        if self._last_part:
            self.context.save(key, arrays)
        else:
            self._between[key] = arrays
        self.preview(job.level, found[edge])
