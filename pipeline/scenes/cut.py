"""A sequence of scenes with hard cuts between them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pipeline.frames import Frame
from pipeline.scenes.base import SceneFrame
from pipeline.scenes.stage import Stage


class Cut:
    """A `Scene` of shots of the same size and frame rate. All pixels are occluded across a cut."""

    def __init__(self, name: str, shots: Sequence[Stage]) -> None:
        self.name, self._shots = name, tuple(shots)
        self.size, self.fps = shots[0].size, shots[0].fps
        self.frames = sum(shot.frames for shot in shots)
        self.cuts = tuple(np.cumsum([shot.frames for shot in shots])[:-1].tolist())
        """First frame of each shot except the first."""
        self._first_id = np.cumsum([0, *(len(shot.things) for shot in shots)]).tolist()

    @property
    def things(self) -> Mapping[int, str]:
        """Id -> name of the object; the ids of one shot follow those of the one before."""
        shots = zip(self._first_id, self._shots, strict=False)
        return {first + number: thing for first, shot in shots for number, thing in shot.things.items()}

    def __iter__(self) -> Iterator[SceneFrame]:
        return map(self.frame, range(self.frames))

    def image(self, index: int) -> Frame:
        """Frame `index` alone."""
        shot, local = self._find(index)
        return self._shots[shot].image(local)

    def frame(self, index: int) -> SceneFrame:
        """Frame `index` with every pass."""
        shot, local = self._find(index)
        made = self._shots[shot].frame(local)
        return replace(made, ids=made.ids + np.int32(self._first_id[shot]))

    def _find(self, index: int) -> tuple[int, int]:
        shot = int(np.searchsorted(self.cuts, index, side="right"))
        return shot, index - (self.cuts[shot - 1] if shot else 0)
