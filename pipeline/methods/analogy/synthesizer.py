"""Synthesis without keyframes: independent frames, or runs of frames of the sweeps of a shot."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.arrays import AnyArray, Arrays
from pipeline.compute import device
from pipeline.frames import Frame
from pipeline.methods.analogy.guided_stills import (
    STRETCH_HUES,
    guided_still_params,
    guided_still_schedule,
    is_guided_still,
    stretch_of_guides,
)
from pipeline.methods.analogy.inputs import StylePair, SynthesisInputs
from pipeline.methods.analogy.layer_inputs import inputs_of
from pipeline.methods.analogy.level_animation import Boil, LevelAnimation, LevelFrames, levels_of, tone_match
from pipeline.methods.analogy.ordered_output import OrderedOutput
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.plan import SweepTask, fine_levels
from pipeline.methods.analogy.shot_layers import LayerStatistics, paint_artefact
from pipeline.methods.analogy.style_images import StylePyramid, energy_of
from pipeline.methods.analogy.style_scaling import is_scaled, style_of
from pipeline.methods.base import Task, TaskContext, TaskResult
from pipeline.synthesis.device_memory import operations
from pipeline.synthesis.exemplar import Palette
from pipeline.synthesis.images import Bytes, Offsets, pack_offsets, unpack_offsets
from pipeline.synthesis.operations import FrameState, LoadedStyle
from pipeline.synthesis.refine import colours
from pipeline.synthesis.sweeps import FirstFrame, SearchSchedule, SolvedFrame, Sweep, order
from pipeline.synthesis.tone_matching import ToneMatch

COARSEST_ROUNDS = 2
"""Factor of iterations at the coarsest level, which starts from random offsets and costs little."""
FINE_ROUNDS = 2
"""Maximum number of rounds of a frame that continues the frame before it."""
FINE_SEARCH_PX = 2.0
"""Maximum radius of its random search, px: it has only details to improve."""
FIRST_FRAME_ROUNDS = 2
"""Factor of iterations for the first frame, which all other frames of the shot continue. In the second half of them,
the random search leaves settled pixels out."""
FIRST_FRAME_SEARCH_PX = 16.0
"""Maximum radius of its random search at a fine level, and of that of all sweeps but the first at coarse levels, px."""
COARSE_ROUNDS = 2
"""Maximum number of rounds of all sweeps but the first at the levels below fine ones: only 1 to 5 % of the pixels
change in each further round."""
STEP = "synthesise"

PreviousOffsets = Callable[[int, FrameState[Any]], Any]
"""Offsets of a frame from the sweep before, or from the coarser level; None = there are none."""


def run_sweeps(task: Task, context: TaskContext[AnalogyParams]) -> TaskResult:
    """Run the sweeps of a task over a run of frames, or synthesise the frames independently."""
    args = dict(task.args)
    earlier = [(key, SweepTask(**each)) for key, each in args.pop("earlier", [])]
    last = SweepTask(**args)
    synthesizer = Synthesizer(context, inputs_of(context, last.layer))
    synthesizer.run_sweeps([*earlier, (task.key, last)])
    return synthesizer.result(last.stop - last.start)


class Synthesizer:
    """Runs the sweeps of a task: holds its style at every level and the operations of the device."""

    keyframe_style = False
    """Whether the keyframes are the style."""

    def __init__(
        self, context: TaskContext[AnalogyParams], inputs: SynthesisInputs, pair: StylePair | None = None
    ) -> None:
        self.context, self.inputs = context, inputs
        self._latest_frames: tuple[tuple[int, int], dict[int, LevelFrames]] = (0, 0), {}
        self._finest = 0
        """Finest level of the sweeps of this task."""
        self.params: AnalogyParams = inputs.params
        with context.clock("style"):
            self.pair = pair or style_of(context, inputs)
            self._palette = Palette(self.pair.output) if pair is None and is_scaled(inputs) else None
            self._tone_match = None if self.keyframe_style else self._matched_tones()
            if self._tone_match is not None:
                colour_weight = self.params.colour_weight * self._tone_match.hue_weight
                self.params = self.params.model_copy(update={"colour_weight": colour_weight})
            self._guided_still = not self.keyframe_style and is_guided_still(context, inputs, self.pair)
            if self._guided_still:
                self.params = guided_still_params(self.params, self._stretch())
            self.pyramid = StylePyramid(self.pair, self.params, inputs.rotates)
        self.levels = levels_of(self.params, context.size, min(self.pair.output.shape[:2]))
        self.ops, self.message = operations(device(), context.size, self.pair.output, self._frames_on_device())
        self._loaded: dict[int, LoadedStyle[Any]] = {}
        self._part, self._parts = 0, 1
        self._unsaved: dict[str, Arrays] = {}
        """Results that a sweep of this task passes to a later sweep of the same task."""

    def _stretch(self) -> float:
        """How much faster guides change in the first frame than in the style."""
        frame = self._frames_of_sweep(0, 1, 0, self.tone_matching()).guides[0]
        params = self.params.model_copy(update={"colour_weight": self.params.colour_weight * STRETCH_HUES})
        return stretch_of_guides(frame, self.pair.guides, energy_of(params, self.inputs.guides, 0).guides)

    def _frames_on_device(self) -> int:
        """Number of frames whose offsets are in device memory at the same time."""
        return 2

    def result(self, frames: int) -> TaskResult:
        """The result of the task."""
        return {"frames": frames} | ({"message": self.message} if self.message else {})

    def style(self, level: int) -> LoadedStyle[Any]:
        """The style at a level, in device memory."""
        if level not in self._loaded:
            with self.context.clock("style"):
                channels = self.pair.output.shape[2]
                energy = energy_of(
                    self.params,
                    self.inputs.guides,
                    level,
                    colours=channels,
                    keyframe_style=self.keyframe_style,
                    subpixel=self._palette is not None,
                )
                self._loaded[level] = self.ops.load(self.pyramid.at(level, energy), energy)
        return self._loaded[level]

    def _matched_tones(self) -> ToneMatch | None:
        statistics = LayerStatistics.of(self.context.load("scan", self.inputs.statistics_artefact))
        return tone_match(self.params, self.pair, statistics.tones)

    def tone_matching(self) -> Callable[[Bytes], Bytes]:
        """The function that maps a guide of the video to the tones of the style; the identity if matching is off."""
        return self._tone_match or (lambda guide: guide)

    def level_frames(self, start: int, stop: int, level: int, match: Callable[[Bytes], Bytes]) -> LevelFrames:
        """Frames [start, stop) at a level, with guides mapped by `match`."""
        return LevelFrames(self.inputs, self.context.clock, start, stop, level, match)

    def animation(self, level_frames: LevelFrames, continues: bool = False) -> LevelAnimation:
        """The animation of these frames. `continues`: see `LevelAnimation`."""
        usable, boil = self.style(level_frames.level).style.first_usable, self.boil(level_frames.level)
        return LevelAnimation(level_frames, self.context.clock, usable, boil=boil, continues=continues)

    def boil(self, level: int) -> Boil | None:
        """The deliberate flicker at a level; None = off."""
        return Boil(self.params.boil, self.context.seed, level) if self.params.boil > 0 else None

    def shown(self, index: int, begin: int) -> int:
        """The frame whose painting is shown at frame `index`: itself, or the even one before it on twos."""
        return index - (index - begin) % 2 if self.params.on_twos == "on" else index

    def schedule(self, level: int, stream: int) -> SearchSchedule:
        """Effort of the search at a level; `stream` is the random stream of the sweep."""
        coarsest = level == self.levels - 1
        iterations = self._iterations(level) * (COARSEST_ROUNDS if coarsest else 1)
        search_px = float(max(self.style(level).size)) if coarsest else self._search_px()
        schedule = SearchSchedule(iterations, search_px, self.context.seed & 0xFFFFFFFF, stream)
        if not self._guided_still:
            return schedule
        return guided_still_schedule(schedule, self.inputs.params, level, coarsest)

    def _sweep_schedule(self, task: SweepTask) -> SearchSchedule:
        """Effort of the search of a sweep.

        With fine levels, few rounds for their frames, where only the first one starts anew, and for all sweeps of the
        other levels but the first of the coarsest one.
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
        first = FirstFrame(FIRST_FRAME_ROUNDS * full.iterations, first_px, full.iterations)
        return replace(full, iterations=rounds, search_px=search_px, first=first, settles=True)

    def _iterations(self, level: int) -> int:
        """Rounds of PatchMatch per frame and sweep at a level."""
        return self.params.iterations

    def _search_px(self) -> float:
        """Radius of the random search at all but the coarsest level, px."""
        return self.params.search_radius

    def run_sweeps(self, sweeps: Sequence[tuple[str, SweepTask]]) -> None:
        """Run the sweeps of a task, (key, sweep), in order. Only the last one saves its result as an artefact."""
        self._finest = max(0, min(sweep.level for _, sweep in sweeps))
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
        match = self.tone_matching()
        for index in range(run.start, run.stop):
            level_frames = [self._frames_of_sweep(index, index + 1, 0, match)]
            with self.context.clock("guides"):
                for _ in range(1, self.levels):
                    level_frames.append(level_frames[-1].halved())
            if self.shown(index, run.begin) == index:
                solved = self._all_levels(index, level_frames, (index - run.start) / (run.stop - run.start))
                with self.context.clock("colours"):
                    painting = self.painting(index, self._rendered(solved, level_frames[0]))
            self.emit_frame(index, painting, level_frames[0])
            self.context.progress((index + 1 - run.start) / (run.stop - run.start))

    def _all_levels(self, index: int, level_frames: list[LevelFrames], done: float) -> SolvedFrame[Any]:
        """One frame at full size."""
        coarser: tuple[int, SolvedFrame[Any]] | None = None
        for level in reversed(range(self.levels)):
            previous, schedule = self._upsampled(coarser), self.schedule(level, 64 + level)
            animation = self.animation(level_frames[level])
            sweep = Sweep(self.ops, self.style(level), animation, previous, schedule, True)
            with self.context.clock("synthesis"):
                coarser = level, next(sweep.run([index]))
                self.ops.finish()
            self.context.progress(done)
        assert coarser is not None
        return coarser[1]

    def _upsampled(self, coarser: tuple[int, SolvedFrame[Any]] | None) -> PreviousOffsets:
        """Offsets upsampled from a frame of the next coarser level, (level, frame)."""

        def previous(_: int, state: FrameState[Any]) -> Any:
            if coarser is None:
                return None
            level, solved = coarser
            return self.ops.upsample(self.style(level), solved.state, solved.offsets, self.style(level - 1), state)

        return previous

    def _rendered(self, solved: SolvedFrame[Any], level_frames: LevelFrames) -> AnyArray:
        """Data from which `painting` makes the picture of a solved frame: its offsets, or its colours, see there."""
        if self._palette is None:
            return self.ops.fetch(solved.offsets)
        paintable = level_frames.paintable.get(solved.index)
        on_device = None if paintable is None else self.ops.upload(paintable)
        return self.ops.fetch(self.ops.antialiased(self.style(0), solved.state, solved.offsets, on_device))

    def painting(self, index: int, rendered: AnyArray) -> Bytes:
        """The painted frame `index`, uint8 (h, w, 3), or (h, w, 4) if the style has opacity.

        Departure: a painting that is scaled has no pixels of its own that could be copied. Its strokes move by
        fractions of a pixel, see `antialias`, and every pixel then gets the nearest colour of the painting.
        """
        if self._palette is None:
            return colours(self.style(0).style, rendered)
        return self._palette.nearest(rendered)

    def emit_frame(self, index: int, painting: Bytes, level_frames: LevelFrames) -> None:
        """Emit a finished frame, or save it for the step `composite` if it is a layer."""
        if self.inputs.layer < 0:
            self.context.emit(index, np.ascontiguousarray(painting[..., :3]))
            return
        paintable, silhouette = level_frames.paintable.get(index), level_frames.silhouettes.get(index)
        if painting.shape[2] == 4:
            alpha = painting[..., 3] if paintable is None else np.where(paintable > 0, painting[..., 3], 0)
        else:
            alpha = np.full(painting.shape[:2], 255) if silhouette is None else np.where(silhouette > 0, 255, 0)
        rgba = np.dstack([painting[..., :3], alpha.astype(np.uint8)])
        self.context.save(paint_artefact(self.inputs.layer, index), {"rgba": rgba})

    def preview(self, level: int, offsets: Offsets) -> None:
        """Show the picture of a coarse level as a preview."""
        picture: Frame = np.ascontiguousarray(colours(self.style(level).style, offsets)[..., :3])
        self.context.show(picture)

    # -- a run of a sweep

    def run_sweep(self, key: str, task: SweepTask) -> None:
        """Run one sweep over frames [start, stop), starting from the artefacts of earlier tasks.

        The result is saved as an artefact, or emitted after the last sweep.
        """
        before = task.start - 1 if task.forward else task.stop
        first = max(task.start - 1, task.begin) if task.forward else task.start
        last = task.stop if task.forward else min(task.stop + 1, task.end)
        match = self.tone_matching()
        level_frames = self._frames_of_sweep(first, last, task.level, match)
        previous = self._previous_offsets(task, match)
        sweep = Sweep(
            self.ops, self.style(task.level), self.animation(level_frames, task.fine), previous,
            self._sweep_schedule(task), task.forward, keep_first=task.sweep > 0 and not task.from_coarser,
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

    def _frames_of_sweep(self, first: int, last: int, level: int, match: Callable[[Bytes], Bytes]) -> LevelFrames:
        """Frames [first, last) at a level; decoded once for the sweeps of this task that have the same frames."""
        frames, levels = self._latest_frames
        if frames != (first, last):
            self._latest_frames = (0, 0), {}  # frees them first
            levels = {self._finest: self.level_frames(first, last, self._finest, match)}
            self._latest_frames = (first, last), levels
        with self.context.clock("guides"):
            for coarser in range(max(levels) + 1, level + 1):
                levels[coarser] = levels[coarser - 1].halved()
        return levels[level]

    def _previous_offsets(self, task: SweepTask, match: Callable[[Bytes], Bytes]) -> PreviousOffsets:
        """The previous result of each frame: of the sweep before, or of the coarser level."""
        if task.first or not task.previous or (task.from_coarser and task.level + 1 >= self.levels):
            return lambda index, state: None
        unsaved = self._unsaved.get(task.previous)
        saved = self.context.load(STEP, task.previous) if unsaved is None else unsaved
        if not task.from_coarser:
            return lambda index, state: self.ops.upload(self._unpacked(saved, index, task.level))
        coarse_frames = None
        if self.inputs.rotates:
            coarse_frames = self.level_frames(task.start, task.stop, task.level + 1, match)

        def previous(index: int, state: FrameState[Any]) -> Any:
            unpacked = self._unpacked(saved, index, task.level + 1)
            offsets = self.ops.upload(unpacked)
            coarse = FrameState((unpacked.shape[1], unpacked.shape[0]), offsets, offsets)
            if coarse_frames is not None:
                coarse = self.ops.prepare(self.style(task.level + 1), coarse_frames.target(index))
            return self._upsampled((task.level + 1, SolvedFrame(index, coarse, offsets)))(index, state)

        return previous

    def _style_side(self, level: int) -> int:
        """Longer side of the style at a level, px."""
        return max(self.style(level).size)

    def _unpacked(self, saved: Arrays, index: int, level: int) -> Offsets:
        return unpack_offsets(saved[str(index)], self._style_side(level))

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
