"""The parts of a synthesis that do not depend on its order: style and effort at each level, and finished frames."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from pipeline.arrays import AnyArray, Arrays
from pipeline.compute import device
from pipeline.frames import Frame
from pipeline.methods.analogy.boil import Boil
from pipeline.methods.analogy.frame_passes import FramePasses
from pipeline.methods.analogy.inputs import StylePair, SynthesisInputs
from pipeline.methods.analogy.level_animation import LevelAnimation, LevelFrames, levels_of
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.shot_layers import paint_artefact
from pipeline.methods.analogy.style_images import StylePyramid, energy_of
from pipeline.methods.base import TaskContext, TaskResult
from pipeline.methods.holds import painted_frame
from pipeline.methods.over_time import largest
from pipeline.synthesis.device_memory import operations
from pipeline.synthesis.energy import Energy
from pipeline.synthesis.exemplar import PaintingColours
from pipeline.synthesis.images import Bytes, Offsets, unpack_offsets
from pipeline.synthesis.operations import FrameState, LoadedStyle
from pipeline.synthesis.refine import colours
from pipeline.synthesis.sweeps import SearchSchedule, SolvedFrame, Sweep

COARSEST_FACTOR = 2
"""Factor of iterations at the coarsest level, which starts from random offsets and costs little."""
STEP = "synthesise"

PreviousOffsets = Callable[[int, FrameState[Any]], Any]
"""Offsets of a frame from the sweep before, or from the coarser level; None = there are none."""


class Synthesizer:
    """Has a style at every level in device memory, and paints and emits frames from their offsets into it.

    Args:
        pair: the style.
        params: parameters of the search, adapted to the style.
        scaled: whether the style is a scaled painting: strokes then move by fractions of a pixel, see `painting`.
    """

    keyframe_style = False
    """Whether the keyframes are the style."""

    def __init__(
        self, context: TaskContext[AnalogyParams], inputs: SynthesisInputs, pair: StylePair, params: AnalogyParams,
        scaled: bool = False,
    ) -> None:  # fmt: skip
        self.context, self.inputs, self.pair, self.params = context, inputs, pair, params
        with context.clock("style"):
            self._colours = PaintingColours(pair.output) if scaled else None
            self.pyramid = StylePyramid(pair, params, inputs.rotates)
        self.levels = levels_of(params, context.size, min(pair.output.shape[:2]))
        self.ops, self.message = operations(device(), context.size, pair.output, self._frames_on_device())
        self._loaded: dict[int, LoadedStyle[Any]] = {}
        self.passes = FramePasses(context, inputs)

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
                energy = self.energy(level, 0)
                self._loaded[level] = self.ops.load(self.pyramid.at(level, energy), energy)
        return self._loaded[level]

    def energy(self, level: int, index: int) -> Energy:
        """The energy function of a frame at a level. The form of the style does not depend on the frame."""
        return energy_of(
            self.params.at(index), self.inputs.guides, level, colours=self.pair.output.shape[2],
            keyframe_style=self.keyframe_style, subpixel=self._colours is not None,
        )  # fmt: skip

    def _style_side(self, level: int) -> int:
        """Longer side of the style at a level, px."""
        return max(self.style(level).size)

    def boil(self, level: int) -> Boil | None:
        """The deliberate flicker at a level; None = off."""
        return Boil(self.params, self.context.seed, level) if largest(self.params.boil) > 0 else None

    def shown(self, index: int, begin: int) -> int:
        """The frame whose painting is shown at frame `index`; paintings are counted from the frame `begin`."""
        return painted_frame(index, begin, self.params.frames_per_painting)

    def schedule(self, level: int, stream: int) -> SearchSchedule:
        """Effort of the search at a level; `stream` is the random stream of the sweep."""
        coarsest = level == self.levels - 1
        iterations = self._iterations(level) * (COARSEST_FACTOR if coarsest else 1)
        search_px = float(max(self.style(level).size)) if coarsest else self._search_px()
        every = self.params.random_search == "every"
        return SearchSchedule(iterations, search_px, self.context.seed & 0xFFFFFFFF, stream, every=every)

    def _iterations(self, level: int) -> int:
        """Rounds of PatchMatch per frame and sweep at a level."""
        return self.params.iterations

    def _search_px(self) -> float:
        """Radius of the random search at all but the coarsest level, px."""
        return self.params.search_radius

    def _upsampled(self, coarser: tuple[int, SolvedFrame[Any]] | None) -> PreviousOffsets:
        """Offsets upsampled from a frame of the next coarser level, (level, frame)."""

        def previous(_: int, state: FrameState[Any]) -> Any:
            if coarser is None:
                return None
            level, solved = coarser
            return self.ops.upsample(self.style(level), solved.state, solved.offsets, self.style(level - 1), state)

        return previous

    def _unpacked(self, saved: Arrays, index: int, level: int) -> Offsets:
        return unpack_offsets(saved[str(index)], self._style_side(level))

    def _all_levels(
        self, index: int, animation: Callable[[int], LevelAnimation], done: float = 0.0
    ) -> SolvedFrame[Any]:  # fmt: skip
        """One frame at full size, independent of the others.

        Args:
            animation: the animation at a level.
            done: fraction of the task's work that is done.
        """
        coarser: tuple[int, SolvedFrame[Any]] | None = None
        for level in reversed(range(self.levels)):
            previous, schedule = self._upsampled(coarser), self.schedule(level, 64 + level)
            sweep = Sweep(
                self.ops, self.style(level), animation(level), previous, schedule, True,
                energy=partial(self.energy, level),
            )  # fmt: skip
            with self.context.clock("synthesis"):
                coarser = level, next(sweep.run([index]))
                self.ops.finish()
            self.context.progress(done)
        assert coarser is not None
        return coarser[1]

    # -- finished frames

    def _rendered(self, solved: SolvedFrame[Any], level_frames: LevelFrames) -> AnyArray:
        """Data from which `painting` makes the picture of a solved frame: its offsets, or its colours, see there."""
        self._keep_passes(solved)
        if self._colours is None:
            return self.ops.fetch(solved.offsets)
        paintable = level_frames.paintable.get(solved.index)
        on_device = None if paintable is None else self.ops.upload(paintable)
        return self.ops.fetch(self.ops.antialiased(self.style(0), solved.state, solved.offsets, on_device))

    def _keep_passes(self, solved: SolvedFrame[Any]) -> None:
        """Keep what the passes of a solved frame need until it is emitted."""
        if self.passes.wanted:
            self.passes.keep(solved.index, self.ops.fetch(solved.offsets))

    def painting(self, index: int, rendered: AnyArray) -> Bytes:
        """The painted frame `index`, uint8 (h, w, 3), or (h, w, 4) if the style has opacity.

        Departure: a painting that is scaled has no pixels of its own that could be copied. Its strokes move by
        fractions of a pixel, see `antialias`, and every pixel then gets the nearest colour of the painting.
        """
        if self._colours is None:
            return colours(self.style(0).style, rendered)
        return self._colours.nearest(rendered)

    def emit_frame(self, index: int, painting: Bytes, level_frames: LevelFrames) -> None:
        """Emit a finished frame, or save it for the step `composite` if it is a layer."""
        if self.inputs.layer < 0:
            self.passes.emit(index, level_frames)
            self.context.emit(index, np.ascontiguousarray(painting[..., :3]))
            return
        paintable = level_frames.paintable.get(index)
        alpha = painting[..., 3] if painting.shape[2] == 4 else np.full(painting.shape[:2], 255, np.uint8)
        alpha = alpha if paintable is None else np.where(paintable > 0, alpha, 0)
        rgba = np.dstack([painting[..., :3], alpha.astype(np.uint8)])
        self.context.save(paint_artefact(self.inputs.layer, index), {"rgba": rgba})

    def preview(self, level: int, offsets: Offsets) -> None:
        """Show the picture of a coarse level as a preview."""
        picture: Frame = np.ascontiguousarray(colours(self.style(level).style, offsets)[..., :3])
        self.context.show(picture)
