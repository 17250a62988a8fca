"""The frames of a task's sweeps, at every level of the pyramid."""

from __future__ import annotations

from pipeline.methods.analogy.inputs import SynthesisInputs
from pipeline.methods.analogy.level_animation import LevelFrames
from pipeline.methods.base import Clock
from pipeline.synthesis.tone_matching import ToneMatch


class SweepFrames:
    """Decodes frames, and reduces them to the levels of the sweeps. Successive sweeps of the same frames share them.

    Attributes:
        finest: finest level that any sweep needs; frames are decoded to it.

    Args:
        match: maps a guide of the video to the tones of the style; None = its guides stay as they are.
    """

    def __init__(self, inputs: SynthesisInputs, clock: Clock, match: ToneMatch | None) -> None:
        self._inputs, self._clock, self._match = inputs, clock, match
        self._span = 0, 0
        self._levels: dict[int, LevelFrames] = {}
        self.finest = 0

    def at(self, level: int, start: int, stop: int) -> LevelFrames:
        """Frames [start, stop) at a level. They are decoded once for successive calls with the same frames."""
        if self._span != (start, stop):
            self._span, self._levels = (0, 0), {}  # frees the frames before others are decoded
            self._levels = {self.finest: self.decoded(self.finest, start, stop)}
            self._span = start, stop
        with self._clock("guides"):
            for coarser in range(max(self._levels) + 1, level + 1):
                self._levels[coarser] = self._levels[coarser - 1].halved()
        return self._levels[level]

    def decoded(self, level: int, start: int, stop: int) -> LevelFrames:
        """Frames [start, stop) at a level, decoded by this call."""
        return LevelFrames(self._inputs, self._clock, start, stop, level, self._match)
