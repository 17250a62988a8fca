"""Synthesis of an interval between painted keyframes: all levels and sweeps in one task.

Section 4 of benard2013stylizing. Each keyframe, paired with the frame that it was painted over, is a style example.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.methods.analogy.inputs import StylePair, SynthesisInputs
from pipeline.methods.analogy.layer_inputs import inputs_of
from pipeline.methods.analogy.level_animation import KeyframeAnimation, LevelFrames, estimated_velocities, levels_of
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.plan import KeyInterval
from pipeline.methods.analogy.shot_layers import LayerStatistics
from pipeline.methods.analogy.style_images import energy_of, keyframe_style
from pipeline.methods.analogy.synthesizer import STEP, PreviousOffsets, Synthesizer
from pipeline.methods.base import Task, TaskContext, TaskResult
from pipeline.synthesis.atlas import downscaled_offsets
from pipeline.synthesis.images import NOWHERE, pack_offsets, unpack_offsets
from pipeline.synthesis.operations import FrameState
from pipeline.synthesis.sweeps import SolvedFrame, Sweep, order, trace_ribbons
from pipeline.synthesis.tone_matching import ToneMatch, tone_statistics


def run_interval(task: Task, context: TaskContext[AnalogyParams]) -> TaskResult:
    """Synthesise one interval and emit its frames."""
    args = dict(task.args["interval"])
    interval = KeyInterval(**{**args, "keys": tuple(args["keys"])})
    synthesizer = KeyframeSynthesizer(context, interval)
    synthesizer.paint(task.key)
    return synthesizer.result(interval.last - interval.first)


class KeyframeSynthesizer(Synthesizer):
    """Synthesizer of one interval. The keyframes are the style and are reproduced exactly."""

    keyframe_style = True

    def __init__(self, context: TaskContext[AnalogyParams], interval: KeyInterval) -> None:
        inputs = inputs_of(context, interval.layer, keyframe_style=True)
        levels = levels_of(inputs.params, context.size, min(context.size))
        pad = energy_of(inputs.params, inputs.guides, 0).pad
        further = _given_style_pair(context, inputs) if inputs.layer < 0 and inputs.has_style_pair() else None
        style = keyframe_style(context, inputs, interval, levels, pad, further)
        self.interval = interval
        super().__init__(context, inputs, style.pair)
        self.levels, self._painted = levels, style.painted
        if interval.fixed_frame >= 0:
            edge = context.load(STEP, f"{interval.fixed_task}-edge")[str(interval.fixed_frame)]
            self._painted[interval.fixed_frame] = unpack_offsets(edge, self._style_side(0))

        self._velocities = estimated_velocities(inputs, context.clock, interval.start, interval.stop)

    def _frames_on_device(self) -> int:
        return self.interval.stop - self.interval.start

    def _iterations(self, level: int) -> int:
        return self.params.key_iterations

    def _search_px(self) -> float:
        return self.params.key_search_radius

    def paint(self, key: str) -> None:
        """Run all levels and sweeps, emit the frames, and save the boundary frames for the next interval."""
        solved: dict[int, SolvedFrame[Any]] = {}
        interval = self.interval
        for level in reversed(range(self.levels)):
            solved, level_frames = self._level(level, solved)
            if level:
                self.preview(level, self.ops.fetch(solved[(interval.first + interval.last) // 2].offsets))
        for index in range(interval.first, interval.last):
            shown = index if index in self._painted else self.shown(index, interval.start)
            self.emit_frame(index, self.ops.fetch(solved[shown].offsets), level_frames)
        ends = sorted({interval.start, interval.last} & set(solved))
        side = self._style_side(0)
        edge = {str(index): pack_offsets(self.ops.fetch(solved[index].offsets), side) for index in ends}
        self.context.save(f"{key}-edge", edge)

    def _level(
        self, level: int, coarser: dict[int, SolvedFrame[Any]]
    ) -> tuple[dict[int, SolvedFrame[Any]], LevelFrames]:
        """Run all sweeps of a level; returns its frames."""
        interval, style = self.interval, self.style(level)
        level_frames = self.level_frames(interval.start, interval.stop, level, lambda guide: guide)
        animation = KeyframeAnimation(
            level_frames,
            self.context.clock,
            style.style.first_usable,
            self._painted,
            self._velocities,
            self.boil(level),
        )
        self._trace_ribbons(animation, level)
        solved = coarser
        for number in range(2 * self.params.sweeps):
            forward = number % 2 == 0
            previous = self._previous_result(level, solved, from_coarser=number == 0)
            schedule = self.schedule(level, level * 8 + number)
            sweep = Sweep(self.ops, style, animation, previous, schedule, forward, keep_first=number > 0)
            solved = self._run(sweep, forward, (self.levels - 1 - level) * 2 * self.params.sweeps + number)
        return solved, level_frames

    def _previous_result(
        self, level: int, solved: dict[int, SolvedFrame[Any]], from_coarser: bool
    ) -> PreviousOffsets:  # fmt: skip
        """The previous result of each frame: of the sweep before, or of the coarser level."""

        def previous(index: int, state: FrameState[Any]) -> Any:
            if index not in solved:
                return None
            if from_coarser:
                return self._upsampled((level + 1, solved[index]))(index, state)
            return solved[index].offsets

        return previous

    def _run(self, sweep: Sweep[Any], forward: bool, number: int) -> dict[int, SolvedFrame[Any]]:
        """Run sweep `number` of the task; returns its frames."""
        found: dict[int, SolvedFrame[Any]] = {}
        total = self.levels * 2 * self.params.sweeps
        with self.context.clock("synthesis"):
            for solved in sweep.run(order(self.interval.start, self.interval.stop, forward)):
                found[solved.index] = SolvedFrame(solved.index, _without_inputs(solved.state), solved.offsets)
                self.context.progress(min(1.0, (number + 0.5) / total))
        return found

    def _trace_ribbons(self, animation: KeyframeAnimation, level: int) -> None:
        """Trace each pixel to the first and the last frame of the interval, where these are fully painted."""
        interval = self.interval
        ends = [index for index in (interval.start, interval.stop - 1) if index in animation.full]
        for index in range(interval.start, interval.stop):
            width, height = animation.target(index).size
            animation.ribbon_offsets[index] = np.full((2, height, width, 2), NOWHERE, np.float32)
        for end in ends:
            at_start = end == interval.start
            frames = range(end, interval.stop) if at_start else range(end, interval.start - 1, -1)
            with self.context.clock("ribbons"):
                start = downscaled_offsets(self._painted[end], level)
                for index, offsets in trace_ribbons(self.ops, self.style(level), animation, frames, start):
                    animation.ribbon_offsets[index][0 if at_start else 1] = offsets
        if not ends:
            animation.ribbon_offsets.clear()


def _without_inputs(state: FrameState[Any]) -> FrameState[Any]:
    """The part of a finished frame that its neighbours need; frees the rest."""
    return FrameState(state.size, state.field, state.field, state.bins)


def _given_style_pair(context: TaskContext[AnalogyParams], inputs: SynthesisInputs) -> StylePair:
    """The style pair given in addition to keyframes, its guide matched to the tones of the video."""
    pair = inputs.style_pair()
    if not pair.derived or inputs.params.tone_match == "off":
        return pair
    statistics = LayerStatistics.of(context.load("scan", inputs.statistics_artefact))
    own = tone_statistics([pair.guide])
    return replace(pair, guide=ToneMatch(own, statistics.tones)(pair.guide))
