"""Painted patches, loaded for the frames of one run."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.frames import Frame, Plane
from pipeline.methods.base import TaskContext, TaskResult
from pipeline.methods.patches.fit import Rendering
from pipeline.methods.patches.join import load_lays
from pipeline.methods.patches.lives import Life
from pipeline.methods.patches.params import PatchesParams
from pipeline.warp.panorama import Lay

TURN = 3.0
"""Half length of the cross-fade between two ages, frames."""


@dataclass(frozen=True)
class Painted:
    """A painted patch.

    Attributes:
        life: frames and label of the patch.
        ages: frames [start, stop) of each age.
        renderings: panorama and painting, uint8 (h, w, 3), of the loaded ages, by number.
        origin: (x, y) of the panorama's top left pixel, px; the same for all ages.
        lays: placement in the panorama, by frame.
    """

    life: Life
    ages: list[list[int]]
    renderings: dict[int, tuple[Frame, Frame]]
    origin: tuple[int, int]
    lays: dict[int, Lay]

    @classmethod
    def load(
        cls, life: Life, result: TaskResult, start: int, stop: int, context: TaskContext[PatchesParams]
    ) -> Painted:
        """Load the parts of a patch that are needed for frames start..stop, both included.

        Args:
            result: result of the patch's task in the step "patch".
        """
        lays, renderings = load_lays(context, life, start, stop), {}
        for number, (first, last) in enumerate(result["ages"]):
            if first - TURN <= stop and last + TURN > start:
                kept = context.load("patch", f"{life.key}-age{number}")
                renderings[number] = kept["panorama"], kept["painting"]
        x, y = result["origin"]
        return cls(life, result["ages"], renderings, (x, y), lays)

    def at(self, index: int, x: Plane, y: Plane) -> Rendering:
        """Sample panorama and painting for frame `index`: float32 (2, h, w, 3). Successive ages are cross-faded.

        Args:
            x, y: float32 (h, w), positions in the panorama, px.
        """
        rendering = np.zeros((2, *x.shape, 3), np.float32)
        for number, share in self._shares(index):
            for which, (plane, how) in enumerate(
                zip(self.renderings[number], (cv2.INTER_LINEAR, cv2.INTER_CUBIC), strict=True)
            ):
                rendering[which] += np.float32(share) * cv2.remap(plane, x, y, how, borderMode=cv2.BORDER_REPLICATE)
        return rendering

    def _shares(self, index: int) -> list[tuple[int, float]]:
        number = next(n for n, (first, last) in enumerate(self.ages) if first <= index < last)
        first, last = self.ages[number]
        since, until = index - first + 0.5, last - index - 0.5
        if number > 0 and since < TURN and since <= until:
            share = 0.5 + since / (2 * TURN)
            return [(number, share), (number - 1, 1 - share)]
        if number + 1 < len(self.ages) and until < TURN:
            share = 0.5 + until / (2 * TURN)
            return [(number, share), (number + 1, 1 - share)]
        return [(number, 1.0)]
