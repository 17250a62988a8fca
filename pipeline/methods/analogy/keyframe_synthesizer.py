"""Synthesis of an interval between painted keyframes: all levels and sweeps in one task.

Section 4 of benard2013stylizing. Each keyframe, paired with the frame that it was painted over, is a style example.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, replace
from functools import partial
from typing import Any

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.methods.analogy.inputs import StylePair, SynthesisInputs
from pipeline.methods.analogy.key_intervals import KeyInterval, interval_key
from pipeline.methods.analogy.key_settings import weighted
from pipeline.methods.analogy.layer_inputs import inputs_of
from pipeline.methods.analogy.level_animation import (
    EstimatedVelocities,
    KeyframeAnimation,
    LevelFrames,
    levels_of,
    style_tones,
)
from pipeline.methods.analogy.ordered_output import OrderedOutput
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.shot_layers import LayerStatistics
from pipeline.methods.analogy.style_images import energy_of, keyframe_style
from pipeline.methods.analogy.style_scaling import style_of
from pipeline.methods.analogy.synthesizer import STEP, PreviousOffsets, Synthesizer
from pipeline.methods.base import Task, TaskContext, TaskResult
from pipeline.synthesis.atlas import AtlasImage, downscaled_offsets, relocated
from pipeline.synthesis.images import NOWHERE, Bytes, Offsets, pack_offsets, unpack_offsets
from pipeline.synthesis.key_blend import KeyPicture, Synthesised, with_blended_colours
from pipeline.synthesis.operations import FrameState
from pipeline.synthesis.refine import sampled
from pipeline.synthesis.ribbons import ribbons_to_keys
from pipeline.synthesis.sweeps import SolvedFrame, Sweep, order
from pipeline.synthesis.tone_matching import ToneMatch

_LAST_HALVED_LEVEL = 1
"""Coarsest level at which a sweep covers only the half of an interval that is nearer to its key."""


def run_interval(task: Task, context: TaskContext[AnalogyParams]) -> TaskResult:
    """Synthesise one interval and emit its frames."""
    args = dict(task.args["interval"])
    fixed = tuple((int(index), int(start)) for index, start in args["fixed"])
    before, after = args.get("weights", (1.0, 1.0))
    interval = KeyInterval(**{**args, "keys": tuple(args["keys"]), "fixed": fixed, "weights": (before, after)})
    synthesizer = KeyframeSynthesizer(context, interval)
    synthesizer.paint(task.key)
    return synthesizer.result(interval.last - interval.first)


class KeyframeSynthesizer(Synthesizer):
    """Synthesizer of one interval. The keyframes are the style and are reproduced exactly."""

    keyframe_style = True

    def __init__(self, context: TaskContext[AnalogyParams], interval: KeyInterval) -> None:
        inputs = inputs_of(context, interval.layer, keyframe_style=True)
        frames = LevelFrames(inputs, context.clock, interval.start, interval.stop, 0)
        velocities = EstimatedVelocities(frames)  # while the keyframes are read
        levels = levels_of(inputs.params, context.size, min(context.size))
        pad = energy_of(inputs.params.at(0), inputs.guides, 0).pad
        further = _given_style_pair(context, inputs) if inputs.layer < 0 and inputs.has_style_pair() else None
        style = keyframe_style(context, inputs, interval, frames, levels, pad, further)
        self.interval = interval
        super().__init__(context, inputs, style.pair, inputs.params)
        self.levels, self._painted = levels, style.painted
        self._images = style.images
        for index, start in interval.fixed:
            edge = context.load(STEP, f"{interval_key(start, interval.layer)}-edge")
            offsets = unpack_offsets(edge[str(index)], int(edge["side"]))
            self._painted[index] = relocated(offsets, _images(edge["images"]), self._images)
        self._ribbons: dict[int, Offsets] = {}
        self._frames = [frames]
        for level in range(1, levels):
            with context.clock("guides"):
                self._frames.append(self._frames[level - 1].halved())
        self._animations = {level: self._animation(level, velocities) for level in reversed(range(levels))}
        velocities.threads.shutdown(wait=False)

    def _animation(self, level: int, velocities: EstimatedVelocities) -> KeyframeAnimation:
        usable = self.style(level).style.first_usable
        frames, clock = self._frames[level], self.context.clock
        weights = self.interval.weights
        return KeyframeAnimation(frames, clock, usable, self._painted, velocities, weights, self.boil(level))

    def _frames_on_device(self) -> int:
        return self.interval.stop - self.interval.start

    @property
    def _coherent(self) -> bool:
        return self.params.temporal == "on"

    def _iterations(self, level: int) -> int:
        return self.params.key_iterations if self._coherent else self.params.iterations

    def _search_px(self) -> float:
        return self.params.key_search_radius if self._coherent else self.params.search_radius

    def paint(self, key: str) -> None:
        """Run all levels and sweeps, emit the frames, and save the boundary frames for the next interval."""
        if not self._coherent:
            self._paint_independently()
            return
        interval, solved = self.interval, dict[int, SolvedFrame[Any]]()
        for level in reversed(range(1, self.levels)):
            solved = self._level(level, solved)
            self.preview(level, self.ops.fetch(solved[(interval.first + interval.last) // 2].offsets))
        with OrderedOutput(range(interval.first, interval.last), self._shown_at, self.painting, self._emit) as output:
            solved = self._level(0, solved, output)
        ends = sorted({interval.start, interval.last} & set(solved))
        side = self._style_side(0)
        edge = {str(index): pack_offsets(self.ops.fetch(solved[index].offsets), side) for index in ends}
        images = [[name, *astuple(image)[:4], *image.cell] for name, image in self._images.items()]
        self.context.save(f"{key}-edge", {**edge, "side": np.array(side), "images": np.array(images, np.int32)})

    def _paint_independently(self) -> None:
        """Synthesise each frame without its neighbours, and emit it."""
        frames = range(self.interval.first, self.interval.last)
        for done, index in enumerate(frames):
            if self._shown_at(index) == index:
                solved = self._all_levels(index, self._animations.__getitem__, done / len(frames))
                self._keep_passes(solved)
                painting = self.painting(index, self.ops.fetch(solved.offsets))
            self._emit(index, painting)

    def _emit(self, index: int, painting: Bytes) -> None:
        self.emit_frame(index, painting, self._frames[0])

    def _shown_at(self, index: int) -> int:
        """The frame whose painting is shown at frame `index`; keyframes keep their frames."""
        return index if index in self._painted else self.shown(index, self.interval.start)

    def painting(self, index: int, offsets: AnyArray) -> Bytes:
        """The painted frame; with `key_blend`, between two keyframes, with the blended colours of both."""
        painting, shown, keys = super().painting(index, offsets), self._shown_at(index), self._painted
        last = max((i for i in keys if i < shown), default=None)
        following = min((i for i in keys if i > shown), default=None)
        blends = self._coherent and self.params.at(shown).key_blend > 0
        if not blends or shown in keys or last is None or following is None:
            return painting
        with self.context.clock("blend"):
            share = weighted((shown - last) / (following - last), *self.interval.weights)
            opaque = self._blended(shown, np.ascontiguousarray(painting[..., :3]), offsets, share)
        return np.ascontiguousarray(np.concatenate([opaque, painting[..., 3:]], axis=-1))

    def _blended(self, index: int, opaque: Bytes, offsets: AnyArray, share: float) -> Bytes:
        """The painted frame `index` without opacity, with the blended colours of the keyframes beside it.

        Args:
            share: weight of the keyframe after it.
        """
        keys = self.interval.keys
        first = max((key for key in keys if key < index), default=self.interval.start)
        second = min((key for key in keys if key > index), default=self.interval.stop - 1)
        time = (index - first) / (second - first)
        ratios = (1 - share, 1 - time), (share, time)
        output = np.ascontiguousarray(self.pair.output[..., :3])
        before, after = (
            KeyPicture(sampled(output, ribbon), sampled(self.pair.guide, ribbon), ribbon[..., 0] > NOWHERE, *each)
            for ribbon, each in zip(self._ribbons[index], ratios, strict=True)
        )
        right, below = (sampled(output, offsets + np.array(step, np.float32)) for step in ((1, 0), (0, 1)))
        scene = np.ascontiguousarray(self._frames[0].guides[index][..., :3])
        frame = Synthesised(opaque, right, below, offsets, scene)
        return with_blended_colours(frame, before, after, self.params.at(index).key_blend)

    def _level(
        self, level: int, coarser: dict[int, SolvedFrame[Any]], output: OrderedOutput | None = None
    ) -> dict[int, SolvedFrame[Any]]:  # fmt: skip
        """Run all sweeps of a level; returns its frames. Each is added to `output` after its last sweep."""
        style, animation = self.style(level), self._animations.pop(level)
        with self.context.clock("ribbons"):
            painted = {index: downscaled_offsets(offsets, level) for index, offsets in self._painted.items()}
            interval = range(self.interval.start, self.interval.stop)
            animation.ribbon_offsets = ribbons_to_keys(self.ops, style, animation, interval, painted)
        self._ribbons = animation.ribbon_offsets
        solved: dict[int, SolvedFrame[Any]] = {}
        sweeps = self._sweeps(level, animation)
        for number, frames in enumerate(sweeps):
            previous, keep_first = self._previous_result(level, solved, coarser), frames[0] in solved
            schedule = self.schedule(level, level * 8 + number)
            sweep = Sweep(
                self.ops, style, animation, previous, schedule, frames.step > 0, keep_first,
                energy=partial(self.energy, level),
            )  # fmt: skip
            with self.context.clock("synthesis"):
                for each in sweep.run(frames):
                    solved[each.index] = SolvedFrame(each.index, _without_inputs(each.state), each.offsets)
                    # Each level takes four times as long as all coarser ones together, less a quarter.
                    self.context.progress(0.25**level * (0.25 + 0.75 * number / len(sweeps)))
                    if output is not None:
                        output.emit_finished()
            if output is not None:
                self._add_finished(output, solved, frames, sweeps[number + 1 :])
        return solved

    def _add_finished(
        self, output: OrderedOutput, solved: Mapping[int, SolvedFrame[Any]], frames: range, later: Sequence[range]
    ) -> None:  # fmt: skip
        """Add the frames of a sweep that are shown and that no later sweep changes."""
        shown = {self._shown_at(index) for index in range(self.interval.first, self.interval.last)}
        for index in sorted(shown.intersection(frames).difference(*later)):
            self._keep_passes(solved[index])
            output.add(index, self.ops.fetch(solved[index].offsets))

    def _sweeps(self, level: int, animation: KeyframeAnimation) -> list[range]:
        """Frame numbers of each sweep of a level, in order.

        Departure: at the two finest levels, where nearly all the work lies, sweeps lead from each key to the middle
        only. Every frame then starts from the nearer key, which the random merge prefers. An end that is painted in
        parts has no offsets to start from elsewhere: all sweeps then lead over all frames.
        """
        start, stop = self.interval.start, self.interval.stop
        ends = [index for index in (start, stop - 1) if index in self._painted]
        if level > _LAST_HALVED_LEVEL or not ends or not animation.full.issuperset(ends):
            return [order(start, stop, number % 2 == 0) for number in range(2 * self.params.sweeps)]
        if len(ends) < 2:
            return [order(start, stop, ends[0] == start)] * self.params.sweeps
        middle = self.interval.border
        return [order(start, middle + 1, True), order(middle, stop, False)] * self.params.sweeps

    def _previous_result(
        self, level: int, solved: Mapping[int, SolvedFrame[Any]], coarser: Mapping[int, SolvedFrame[Any]]
    ) -> PreviousOffsets:  # fmt: skip
        """The previous result of each frame: of the sweep before, or of the coarser level."""

        def previous(index: int, state: FrameState[Any]) -> Any:
            if index in solved:
                return solved[index].offsets
            return self._upsampled((level + 1, coarser[index]))(index, state) if index in coarser else None

        return previous


def _images(saved: AnyArray) -> dict[int, AtlasImage]:
    """Images of an atlas, as `paint` saves them."""
    return {
        int(name): AtlasImage(int(left), int(top), int(width), int(height), (int(across), int(down)))
        for name, left, top, width, height, across, down in saved
    }


def _without_inputs(state: FrameState[Any]) -> FrameState[Any]:
    """The part of a finished frame that its neighbours need; frees the rest."""
    return FrameState(state.size, state.field, state.field, state.bins)


def _given_style_pair(context: TaskContext[AnalogyParams], inputs: SynthesisInputs) -> StylePair:
    """The style pair given in addition to keyframes, its guide matched to the tones of the video."""
    pair = style_of(context, inputs)
    if not pair.derived or inputs.params.tone_match == "off":
        return pair
    statistics = LayerStatistics.of(context.load("scan", inputs.statistics_artefact))
    return replace(pair, guide=ToneMatch(style_tones(pair), statistics.tones, inputs.params.tone_limit)(pair.guide))
