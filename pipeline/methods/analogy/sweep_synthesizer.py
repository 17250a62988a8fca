"""Synthesis without keyframes: independent frames, or runs of frames of the sweeps of a shot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from pipeline.arrays import AnyArray, Arrays
from pipeline.methods.analogy.guided_stills import (
    STRETCH_HUE_FACTOR,
    guided_still_params,
    guided_still_schedule,
    is_guided_still,
    stretch_of_guides,
)
from pipeline.methods.analogy.inputs import StylePair, SynthesisInputs
from pipeline.methods.analogy.job_inputs import JobInputs
from pipeline.methods.analogy.layer_inputs import inputs_of
from pipeline.methods.analogy.level_animation import LevelAnimation, LevelFrames, tone_match
from pipeline.methods.analogy.ordered_output import OrderedOutput
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.plan import SweepTask, fine_levels
from pipeline.methods.analogy.shot_layers import LayerStatistics
from pipeline.methods.analogy.style_images import energy_of
from pipeline.methods.analogy.style_scaling import is_scaled, style_of
from pipeline.methods.analogy.sweep_frames import SweepFrames
from pipeline.methods.analogy.synthesizer import STEP, PreviousOffsets, Synthesizer
from pipeline.methods.base import Task, TaskContext, TaskResult
from pipeline.synthesis.images import Bytes, Offsets, pack_offsets
from pipeline.synthesis.operations import FrameState
from pipeline.synthesis.sweeps import FirstFrame, SearchSchedule, SolvedFrame, Sweep, order
from pipeline.synthesis.tone_matching import ToneMatch

FINE_ROUNDS = 2
"""Maximum number of rounds at a fine level for a frame that continues the frame before it."""
FINE_SEARCH_PX = 2.0
"""Maximum radius of the random search for such a frame, px: it has only details to improve."""
FIRST_FRAME_FACTOR = 2
"""Factor of iterations at a fine level for the first frame, which all other frames of the shot continue. In the second
half of them, the random search leaves settled pixels out."""
FIRST_FRAME_SEARCH_PX = 16.0
"""Maximum radius of the random search, px: for the first frame at a fine level, and in all sweeps but the first of the
coarsest level at the other levels."""
COARSE_ROUNDS = 2
"""Maximum number of rounds of those sweeps: few pixels change in a further round."""


def run_sweeps(task: Task, context: TaskContext[AnalogyParams]) -> TaskResult:
    """Run the sweeps of a task over a run of frames, or synthesise the frames independently."""
    args = dict(task.args)
    earlier = [(key, SweepTask(**each)) for key, each in args.pop("earlier", [])]
    last = SweepTask(**args)
    inputs = inputs_of(context, last.layer)
    if isinstance(inputs, JobInputs):
        inputs.near = last.begin
    synthesizer = SweepSynthesizer(context, inputs)
    synthesizer.run_sweeps([*earlier, (task.key, last)])
    return synthesizer.result(last.stop - last.start)


class SweepSynthesizer(Synthesizer):
    """Runs the sweeps of a task over its frames."""

    def __init__(self, context: TaskContext[AnalogyParams], inputs: SynthesisInputs) -> None:
        with context.clock("style"):
            pair = style_of(context, inputs)
            match, params = _matched_tones(context, inputs, pair)
            self._frames = SweepFrames(inputs, context.clock, match)
            self._guided_still = is_guided_still(context, inputs, pair)
            if self._guided_still:
                params = params.at(context.video.first)
                guides = self._frames.at(0, 0, 1).guides[0]
                params = guided_still_params(params, _stretch(guides, pair, params, inputs))
        super().__init__(context, inputs, pair, params, is_scaled(inputs))
        self._part, self._parts = 0, 1
        self._unsaved: dict[str, Arrays] = {}
        """Results that a sweep of this task passes to a later sweep of the same task."""

    def schedule(self, level: int, stream: int) -> SearchSchedule:
        schedule = super().schedule(level, stream)
        if not self._guided_still:
            return schedule
        return guided_still_schedule(schedule, self.inputs.params, level, level == self.levels - 1)

    def animation(self, level_frames: LevelFrames, continues: bool = False) -> LevelAnimation:
        """The animation of these frames. `continues`: see `LevelAnimation`."""
        usable, boil = self.style(level_frames.level).style.first_usable, self.boil(level_frames.level)
        return LevelAnimation(level_frames, self.context.clock, usable, boil=boil, continues=continues)

    def _sweep_schedule(self, task: SweepTask) -> SearchSchedule:
        """Effort of the search of a sweep.

        If the plan has fine levels, frames that continue others get few rounds: at fine levels all frames but the
        first of a shot, at the other levels all sweeps but the first of the coarsest level.
        """
        full = self.schedule(task.level, task.level * 8 + task.sweep)
        if fine_levels(self.params, self.context.size) == 0:
            return full
        first_px = min(FIRST_FRAME_SEARCH_PX, full.search_px)
        if not task.fine:
            again = replace(full, iterations=min(COARSE_ROUNDS, full.iterations), search_px=first_px)
            starts = task.level == self.levels - 1 and task.sweep == 0
            return replace(full if starts else again, settles=True)
        rounds, search_px = min(FINE_ROUNDS, full.iterations), min(FINE_SEARCH_PX, full.search_px)
        first = FirstFrame(FIRST_FRAME_FACTOR * full.iterations, first_px, full.iterations)
        return replace(full, iterations=rounds, search_px=search_px, first=first, settles=True)

    def run_sweeps(self, sweeps: Sequence[tuple[str, SweepTask]]) -> None:
        """Run the sweeps of a task, (key, sweep), in order. Only the last one saves its result as an artefact."""
        self._frames.finest = max(0, min(sweep.level for _, sweep in sweeps))
        for self._part, (key, sweep) in enumerate(sweeps):
            self._parts = len(sweeps)
            if sweep.level < 0:
                self.synthesise_independently(sweep)
            elif sweep.level < self.levels:
                self.run_sweep(key, sweep)
            else:
                self._progress(1.0)  # a level coarser than fits

    def _progress(self, done: float) -> None:
        """Report the progress of the current sweep, 0..1."""
        self.context.progress((self._part + done) / self._parts)

    @property
    def _is_last_part(self) -> bool:
        return self._part + 1 == self._parts

    # -- independent frames

    def synthesise_independently(self, run: SweepTask) -> None:
        """Synthesise each frame of a run independently, from coarse to fine, and emit it."""
        for index in range(run.start, run.stop):
            level_frames = [self._frames.at(0, index, index + 1)]
            with self.context.clock("guides"):
                for _ in range(1, self.levels):
                    level_frames.append(level_frames[-1].halved())
            if self.shown(index, run.begin) == index:
                done = (index - run.start) / (run.stop - run.start)
                animations = [self.animation(each) for each in level_frames]
                solved = self._all_levels(index, animations.__getitem__, done)
                with self.context.clock("colours"):
                    painting = self.painting(index, self._rendered(solved, level_frames[0]))
            self.emit_frame(index, painting, level_frames[0])
            self.context.progress((index + 1 - run.start) / (run.stop - run.start))

    # -- a run of a sweep

    def run_sweep(self, key: str, task: SweepTask) -> None:
        """Run one sweep over frames [start, stop), starting from the artefacts of earlier tasks.

        The result is saved as an artefact, or emitted after the last sweep.
        """
        before = task.start - 1 if task.forward else task.stop
        first = max(task.start - 1, task.begin) if task.forward else task.start
        last = task.stop if task.forward else min(task.stop + 1, task.end)
        level_frames = self._frames.at(task.level, first, last)
        previous = self._previous_offsets(task)
        sweep = Sweep(
            self.ops, self.style(task.level), self.animation(level_frames, task.fine), previous,
            self._sweep_schedule(task), task.forward, keep_first=task.sweep > 0 and not task.from_coarser,
            energy=partial(self.energy, task.level),
        )  # fmt: skip
        if task.neighbour:
            state = self.ops.prepare(self.style(task.level), level_frames.target(before))
            sweep.last = SolvedFrame(before, state, self._load_edge(task.neighbour, before, task.level))
        edge = task.stop - 1 if task.forward else task.start
        if task.last:
            found = self._emit_run(sweep, task, level_frames, edge)
        else:
            found = {solved.index: self.ops.fetch(solved.offsets) for solved in self._solved_frames(sweep, task)}
        if (task.stop < task.end) if task.forward else (task.start > task.begin):
            packed = pack_offsets(found[edge], self._style_side(task.level))
            self.context.save(f"{key}-edge", {str(edge): packed})
        if not task.last:
            self._save(key, task.level, found)
            self.preview(task.level, found[edge])

    def _previous_offsets(self, task: SweepTask) -> PreviousOffsets:
        """The previous result of each frame: of the sweep before, or of the coarser level."""
        if task.first or not task.previous or (task.from_coarser and task.level + 1 >= self.levels):
            return lambda index, state: None
        unsaved = self._unsaved.get(task.previous)
        saved = self.context.load(STEP, task.previous) if unsaved is None else unsaved
        if not task.from_coarser:
            return lambda index, state: self.ops.upload(self._unpacked(saved, index, task.level))
        coarse_frames = None
        if self.inputs.rotates:
            coarse_frames = self._frames.decoded(task.level + 1, task.start, task.stop)

        def previous(index: int, state: FrameState[Any]) -> Any:
            unpacked = self._unpacked(saved, index, task.level + 1)
            offsets = self.ops.upload(unpacked)
            coarse = FrameState((unpacked.shape[1], unpacked.shape[0]), offsets, offsets)
            if coarse_frames is not None:
                coarse = self.ops.prepare(self.style(task.level + 1), coarse_frames.target(index))
            return self._upsampled((task.level + 1, SolvedFrame(index, coarse, offsets)))(index, state)

        return previous

    def _load_edge(self, task: str, index: int, level: int) -> Any:
        """Offsets of the edge frame of another run, in device memory."""
        return self.ops.upload(self._unpacked(self.context.load(STEP, f"{task}-edge"), index, level))

    def _solved_frames(self, sweep: Sweep[Any], task: SweepTask) -> Iterator[SolvedFrame[Any]]:
        """The frames of a sweep, each as soon as the device has solved it."""
        count = task.stop - task.start
        solved_frames = sweep.run(order(task.start, task.stop, task.forward))
        for done in range(count):
            with self.context.clock("synthesis"):
                solved = next(solved_frames)
                self.ops.finish()
            yield solved
            self._progress((done + 1) / count)

    def _emit_run(self, sweep: Sweep[Any], task: SweepTask, level_frames: LevelFrames, edge: int) -> dict[int, Offsets]:
        """Run the last sweep and emit its frames; returns the offsets of the frame `edge`.

        A thread finishes each painting while the device works on the next frame.
        """
        found: dict[int, Offsets] = {}
        with OrderedOutput(
            range(task.start, task.stop), lambda index: self.shown(index, task.begin), self.painting,
            lambda index, painting: self.emit_frame(index, painting, level_frames),
        ) as output:  # fmt: skip
            for solved in self._solved_frames(sweep, task):
                if self.shown(solved.index, task.begin) == solved.index:
                    with self.context.clock("colours"):
                        rendered = self._rendered(solved, level_frames)
                    output.add(solved.index, rendered)
                if solved.index == edge:
                    found[edge] = self.ops.fetch(solved.offsets)
        return found

    def _save(self, key: str, level: int, found: Mapping[int, Offsets]) -> None:
        """Save the result of a sweep, or keep it for a later sweep of this task."""
        side = self._style_side(level)
        arrays: dict[str, AnyArray] = {str(index): pack_offsets(offsets, side) for index, offsets in found.items()}
        if self._is_last_part:
            self.context.save(key, arrays)
        else:
            self._unsaved[key] = arrays


def _matched_tones(
    context: TaskContext[AnalogyParams], inputs: SynthesisInputs, pair: StylePair
) -> tuple[ToneMatch | None, AnalogyParams]:
    """The function that maps a guide to the tones of the style, None if matching is off; and the parameters with the
    weight of hues that fits it."""
    params, statistics = inputs.params, LayerStatistics.of(context.load("scan", inputs.statistics_artefact))
    match = tone_match(params, pair, statistics.tones)
    if match is None:
        return None, params
    return match, params.model_copy(update={"colour_weight": params.colour_weight * match.hue_weight})


def _stretch(guides: Bytes, pair: StylePair, params: AnalogyParams, inputs: SynthesisInputs) -> float:
    """Ratio of the squared gradients of the guides in the first frame, uint8 (h, w, channels), to the style's."""
    params = params.model_copy(update={"colour_weight": params.colour_weight * STRETCH_HUE_FACTOR})
    return stretch_of_guides(guides, pair.guides, energy_of(params, inputs.guides, 0).guides)
