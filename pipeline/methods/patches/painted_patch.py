"""A painted patch of step "patch", as the frames of a run show it."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.methods.base import TaskContext, TaskResult
from pipeline.methods.patches.paint_error import Rendering
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.patch_construction import load_placements, period_artefact
from pipeline.methods.patches.patch_track import PatchTrack
from pipeline.warp.panorama import Placement

CUBIC_REACH = 2
"""Pixels on either side of a position that bicubic interpolation reads."""
PERIOD_FADE_FRAMES = 3.0
"""Half length of the cross-fade between two periods of a patch, frames."""


@dataclass(frozen=True)
class PaintedPatch:
    """A painted patch, loaded for the frames of one run.

    Attributes:
        track: frames and label of the patch.
        periods: frames [start, stop) of each period of similar appearance.
        renderings: panorama and painting of the loaded periods, by number.
        origin: (x, y) of the panorama's top left pixel, px; the same for all periods.
        placements: placement in the panorama, by frame.
        strokes: number of the stroke at each pixel of a painting, uint32 (h, w), by number of the period; empty: that
            pass is not wanted.
    """

    track: PatchTrack
    periods: list[list[int]]
    renderings: dict[int, Rendering]
    origin: tuple[int, int]
    placements: dict[int, Placement]
    strokes: dict[int, NDArray[np.uint32]] = field(default_factory=dict)

    @classmethod
    def load(
        cls, track: PatchTrack, result: TaskResult, start: int, stop: int, context: TaskContext[PatchesParams]
    ) -> PaintedPatch:
        """Load the parts of a patch that are needed for frames [start, stop).

        Args:
            result: result of the patch's task in the step "patch".
        """
        placements, renderings, strokes = load_placements(context, track, start, stop), {}, {}
        for number, (first, last) in enumerate(result["periods"]):
            if first - PERIOD_FADE_FRAMES < stop and last + PERIOD_FADE_FRAMES > start:
                arrays = context.load("patch", period_artefact(track, number))
                renderings[number] = arrays["panorama"], arrays["painting"]
                if "strokes" in arrays:
                    strokes[number] = np.asarray(arrays["strokes"], np.uint32)
        x, y = result["origin"]
        return cls(track, result["periods"], renderings, (x, y), placements, strokes)

    def sample(self, index: int, x: Plane, y: Plane) -> Rendering:
        """Sample panorama and painting for frame `index`: (h, w, 3) each. Successive periods are cross-faded.

        Args:
            x, y: float32 (h, w), positions in the panorama, px.
        """
        (picture, painting), (x, y) = self._shown(index, x, y)
        out = np.empty((*x.shape, 3), np.uint8), np.empty((*x.shape, 3), painting.dtype)
        cv2.remap(picture, x, y, cv2.INTER_LINEAR, dst=out[0], borderMode=cv2.BORDER_REPLICATE)
        cv2.remap(painting, x, y, cv2.INTER_CUBIC, dst=out[1], borderMode=cv2.BORDER_REPLICATE)
        return out

    def stroke_numbers(self, index: int, x: Plane, y: Plane) -> NDArray[np.uint32]:
        """Numbers of the strokes at positions in the panorama that frame `index` shows most, uint32 (h, w)."""
        if not self.strokes:
            return np.zeros(x.shape, np.uint32)
        number, _ = max(self._period_weights(index), key=lambda one: one[1])
        height, width = self.strokes[number].shape
        rows, columns = (np.rint(p).clip(0, n - 1).astype(np.intp) for p, n in ((y, height), (x, width)))
        return self.strokes[number][rows, columns]

    def _shown(self, index: int, x: Plane, y: Plane) -> tuple[Rendering, tuple[Plane, Plane]]:
        """Panorama and painting that frame `index` shows, and the positions in them.

        Of two periods, the part around the positions is blended: to sample it once takes less than to sample both.
        """
        (number, weight), *before_or_after = self._period_weights(index)
        if not before_or_after or not x.size:
            return self.renderings[number], (x, y)
        (other, rest), (height, width) = before_or_after[0], self.renderings[number][0].shape[:2]
        rows, columns = _around(y, height), _around(x, width)
        picture, painting = (
            cv2.addWeighted(own[rows, columns], weight, its[rows, columns], rest, 0)
            for own, its in zip(self.renderings[number], self.renderings[other], strict=True)
        )
        return (np.asarray(picture, np.uint8), painting), (x - np.float32(columns.start), y - np.float32(rows.start))

    def _period_weights(self, index: int) -> list[tuple[int, float]]:
        """Numbers of the periods shown at frame `index`, and their cross-fade weights."""
        number = next(n for n, (first, last) in enumerate(self.periods) if first <= index < last)
        first, last = self.periods[number]
        since, until = index - first + 0.5, last - index - 0.5
        if number > 0 and since < PERIOD_FADE_FRAMES and since <= until:
            weight = 0.5 + since / (2 * PERIOD_FADE_FRAMES)
            return [(number, weight), (number - 1, 1 - weight)]
        if number + 1 < len(self.periods) and until < PERIOD_FADE_FRAMES:
            weight = 0.5 + until / (2 * PERIOD_FADE_FRAMES)
            return [(number, weight), (number + 1, 1 - weight)]
        return [(number, 1.0)]


def _around(positions: Plane, length: int) -> slice:
    """Pixels on an axis of that length that are read to interpolate at the positions, px; at least one."""
    low, high = int(np.floor(positions.min())) - CUBIC_REACH, int(np.ceil(positions.max())) + CUBIC_REACH + 1
    start = min(max(low, 0), length - 1)
    return slice(start, max(min(high, length), start + 1))
