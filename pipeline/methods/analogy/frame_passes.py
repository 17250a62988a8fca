"""Passes of painted frames: motion, guides, directions, and the place in the painting that each pixel shows."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import State
from pipeline.frames import Flow, Frame
from pipeline.methods.analogy.inputs import SynthesisInputs
from pipeline.methods.analogy.level_animation import LevelFrames
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.base import MadePass, TaskContext
from pipeline.passes.made import FLOW, PNG_MIDDLE
from pipeline.perception.cuts import is_cut, thumbnail
from pipeline.perception.flow import estimate
from pipeline.perception.flow.gray import to_gray
from pipeline.synthesis.images import NOWHERE, Offsets
from pipeline.synthesis.motion import zero_still_velocity
from pipeline.synthesis.orientation import bin_tangents

MADE = (
    FLOW,
    MadePass(
        "guides", "The picture as it is compared with the painting: CIELAB in the painting's tones, 0..1.",
        ("L", "A", "B"),
    ),
    MadePass(
        "orientation", "Direction of the frame, to which patches of the painting turn with rotation: a unit vector, y "
        "down; it and its opposite are the same direction; 0 = none.",
        ("X", "Y"), png_zero=PNG_MIDDLE, png_scale=PNG_MIDDLE - 1,
    ),
    MadePass(
        "positions", "The place in the painting, or in the keyframes side by side, that a pixel shows; -1 = none.",
        ("X", "Y"), "px", png_scale=8.0,
    ),
)  # fmt: skip


class FramePasses:
    """Emits the wanted passes of the frames of a task, in order.

    Args:
        inputs: those of the whole picture; a layer's frames have no passes.
    """

    def __init__(self, context: TaskContext[AnalogyParams], inputs: SynthesisInputs) -> None:
        self._context, self._inputs = context, inputs
        self.wanted = [made.name for made in MADE if inputs.layer < 0 and context.wants_pass(made.name)]
        self._positions: dict[int, Offsets] = {}
        self._before: tuple[int, Frame] | None = None

    def keep(self, index: int, offsets: Offsets) -> None:
        """Keep the offsets of a frame, float32 (h, w, 2), until it and the frames that repeat it are emitted."""
        self._positions[index] = np.where(offsets > NOWHERE, offsets, np.float32(-1))

    def emit(self, index: int, frames: LevelFrames) -> None:
        """Emit the passes of the next frame; `frames`: with the frame, at full size."""
        if not self.wanted:
            return
        made: State = {}
        if "positions" in self.wanted:
            shown = max(number for number in self._positions if number <= index)
            self._positions = {number: own for number, own in self._positions.items() if number >= shown}
            made["positions"] = self._positions[shown]
        if "guides" in self.wanted:
            made["guides"] = frames.guides[index][..., :3] / np.float32(255)
        if "orientation" in self.wanted:
            made["orientation"] = bin_tangents(frames.directions_of(index))
        if "flow" in self.wanted:
            made["flow"] = self._flow(index, frames.frames[index])
        self._context.emit_passes(index, made)

    def _flow(self, index: int, frame: Frame) -> Flow:
        before, self._before = self._frame_before(index), (index, frame)
        params = self._inputs.params
        if before is None or is_cut(thumbnail(before), thumbnail(frame), params.cut_sensitivity):
            return np.zeros((*frame.shape[:2], 2), np.float32)
        if (given := self._inputs.velocities(index - 1)) is not None:
            return -given[1]
        now, then = to_gray(frame), to_gray(before)
        return -zero_still_velocity(-estimate(now, then, params.flow), now, then)

    def _frame_before(self, index: int) -> Frame | None:
        if self._before is not None and self._before[0] == index - 1:
            return self._before[1]
        return next(self._context.frames("video", index - 1, index), None) if index else None
