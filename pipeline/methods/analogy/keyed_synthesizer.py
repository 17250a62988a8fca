"""Synthesis of an interval between painted keyframes: all levels and sweeps in one task."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.methods.analogy.interval import KeyedAnimation, KeyInterval, keyframe_style
from pipeline.methods.analogy.layer_source import source_of
from pipeline.methods.analogy.layers import LayerStatistics
from pipeline.methods.analogy.level_frames import LevelFrames, estimated_velocities, levels_of
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.sources import Source, StylePair
from pipeline.methods.analogy.style_pyramid import energy_of
from pipeline.methods.analogy.synthesizer import STEP, Synthesizer
from pipeline.methods.base import Task, TaskContext, TaskResult
from pipeline.synthesis.atlas import downscaled_offsets
from pipeline.synthesis.images import NOWHERE, pack_offsets, unpack_offsets
from pipeline.synthesis.operations import FrameState
from pipeline.synthesis.sweeps import SolvedFrame, Sweep, carried_ribbons, order
from pipeline.synthesis.tone_matching import ToneMatch, tone_statistics


def run_interval(task: Task, context: TaskContext[AnalogyParams]) -> TaskResult:
    """Synthesise one interval and emit its frames."""
    found = dict(task.args["interval"])
    interval = KeyInterval(**{**found, "keys": tuple(found["keys"])})
    synthesizer = KeyedSynthesizer(context, interval)
    synthesizer.paint(task.key)
    return synthesizer.result(interval.last - interval.first)


class KeyedSynthesizer(Synthesizer):
    """Synthesizer of one interval. The keyframes are the style and are reproduced exactly."""

    keyed = True

    def __init__(self, context: TaskContext[AnalogyParams], interval: KeyInterval) -> None:
        source = source_of(context, interval.layer, keyed=True)
        levels = levels_of(source.params, context.size, min(context.size))
        pad = energy_of(source.params, source.guides, 0).pad
        extra = _given_style_pair(context, source) if source.layer < 0 and source.has_pair() else None
        found = keyframe_style(context, source, interval, levels, pad, extra)
        self.interval = interval
        super().__init__(context, source, found.pair)
        self.levels, self._given = levels, found.given
        if interval.held >= 0:
            edge = context.load(STEP, f"{interval.task}-edge")[str(interval.held)]
            self._given[interval.held] = unpack_offsets(edge, self._longest(0))

        self._velocities = estimated_velocities(source, context.clock, interval.start, interval.stop)

    def _frames_held(self) -> int:
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
            shown = index if index in self._given else self.shown(index, interval.start)
            self.emit_frame(index, self.ops.fetch(solved[shown].offsets), level_frames)
        ends = {interval.start, interval.last} & set(solved)
        longest = self._longest(0)
        edge = {str(i): pack_offsets(self.ops.fetch(solved[i].offsets), longest) for i in sorted(ends)}
        self.context.save(f"{key}-edge", edge)

    def _level(self, level: int, above: dict[int, SolvedFrame[Any]]) -> tuple[dict[int, SolvedFrame[Any]], LevelFrames]:
        interval, style = self.interval, self.style(level)
        level_frames = self.level_frames(interval.start, interval.stop, level, lambda guide: guide)
        shot = KeyedAnimation(
            level_frames, self.context.clock, style.style.first, self._given, self._velocities, self.boil(level)
        )
        self._trace_ribbons(shot, level)
        for sweep in range(2 * self.params.sweeps):
            forward = sweep % 2 == 0
            known = self._known(level, above, coarser_level=sweep == 0)
            rounds = self.rounds(level, level * 8 + sweep)
            sweep_run = Sweep(self.ops, style, shot, known, rounds, forward, keep_first=sweep > 0)
            above = self._run_sweep(sweep_run, forward, (self.levels - 1 - level) * 2 * self.params.sweeps + sweep)
        return above, level_frames

    def _known(
        self, level: int, before: dict[int, SolvedFrame[Any]], coarser_level: bool
    ) -> Callable[[int, FrameState[Any]], Any]:
        def known(index: int, state: FrameState[Any]) -> Any:
            if index not in before:
                return None
            if coarser_level:
                return self._upsampled((level + 1, before[index]))(index, state)
            return before[index].offsets

        return known

    def _run_sweep(self, sweep: Sweep[Any], forward: bool, number: int) -> dict[int, SolvedFrame[Any]]:
        found: dict[int, SolvedFrame[Any]] = {}
        total = self.levels * 2 * self.params.sweeps
        with self.context.clock("synthesis"):
            for seen in sweep.run(order(self.interval.start, self.interval.stop, forward)):
                found[seen.index] = SolvedFrame(seen.index, _without_inputs(seen.state), seen.offsets)
                self.context.progress(min(1.0, (number + 0.5) / total))
        return found

    def _trace_ribbons(self, shot: KeyedAnimation, level: int) -> None:
        """Trace each pixel to the first and the last frame of the interval, where these are fully painted."""
        interval = self.interval
        ends = [i for i in (interval.start, interval.stop - 1) if i in shot.full]
        for index in range(interval.start, interval.stop):
            width, height = shot.target(index).size
            shot.carried[index] = np.full((2, height, width, 2), NOWHERE, np.float32)
        for end in ends:
            way = range(end, interval.stop) if end == interval.start else range(end, interval.start - 1, -1)
            plane = 0 if end == interval.start else 1
            with self.context.clock("ribbons"):
                start = downscaled_offsets(self._given[end], level)
                for index, places in carried_ribbons(self.ops, self.style(level), shot, way, start):
                    shot.carried[index][plane] = places
        if not ends:
            shot.carried.clear()


def _without_inputs(state: FrameState[Any]) -> FrameState[Any]:
    """The part of a finished frame that its neighbours need; frees the rest."""
    return FrameState(state.size, state.field, state.field, state.bins)


def _given_style_pair(context: TaskContext[AnalogyParams], source: Source) -> StylePair:
    """The style pair given in addition to keyframes, its guide matched to the tones of the video."""
    pair = source.pair()
    if not pair.derived or source.params.tone_match == "off":
        return pair
    found = LayerStatistics.of(context.load("scan", source.statistics_artefact))
    own = tone_statistics([pair.guide])
    return replace(pair, guide=ToneMatch(own, found.tones)(pair.guide))
