"""Passes of a frame: what the method computes on the way to the painting, for compositing and for figures of the paper.

`residual` and `propagated` are the maps of figures 3 and 8 of zhang2011online.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from pipeline.arrays import AnyArray, Arrays
from pipeline.methods.abstraction.compositor import CompositedFrame
from pipeline.methods.base import MadePass
from pipeline.passes.made import FLOW
from pipeline.perception.motion import RESIDUAL_STEPS
from pipeline.regions.propagation import smooth_labels
from pipeline.regions.segmenter import Segmentation

MADE = (
    FLOW,
    MadePass("labels", "The region of each pixel: a region keeps its number from frame to frame.", ("ID",), ids=True),
    MadePass("regions", "The regions in their colours, sRGB, 0..1, without lines.", ("R", "G", "B")),
    MadePass("residual", "1 where no label arrived from the previous frame: the residual map of the paper.", ("Y",)),
    MadePass(
        "propagated", "Labels that arrived from the previous frame, after the morphological filter; 0 = none.", ("ID",),
        ids=True,
    ),
    MadePass(
        "difference", "Difference of each pixel from its past, CIELAB units; 0 in the first frame of a shot.", ("Y",),
        "CIELAB units", png_scale=1024.0,
    ),
    MadePass("importance", "Where detail is kept, 0..1.", ("Y",)),
    MadePass("lines", "Ink of the lines, 0..1, before their opacity.", ("Y",)),
)  # fmt: skip


class PassMaker:
    """Makes the wanted passes of consecutive frames.

    Args:
        last: regions of the frame before the first one; None: there is none.
    """

    def __init__(self, wanted: frozenset[str], size: tuple[int, int], last: Segmentation | None) -> None:
        self._wanted, self._size = wanted, size
        self._ids = None if last is None else last.ids

    def __call__(self, painting: CompositedFrame) -> Arrays:
        """The passes of the next frame, by name."""
        found = {name: make(painting) for name, make in self._makers.items() if name in self._wanted}
        self._ids = painting.regions.ids
        return found

    @property
    def _makers(self) -> Mapping[str, Callable[[CompositedFrame], AnyArray]]:
        return {
            "flow": self._flow, "labels": lambda painting: painting.regions.ids[painting.labels],
            "regions": lambda painting: painting.colours[painting.labels] / np.float32(255),
            "residual": lambda painting: self._residual(painting.regions).astype(np.float32),
            "propagated": self._propagated, "difference": self._difference, "importance": self._importance,
            "lines": self._lines,
        }  # fmt: skip

    def _flow(self, painting: CompositedFrame) -> AnyArray:
        flow = painting.analysis.flow
        if flow is None:
            return np.zeros((*painting.labels.shape, 2), np.float32)
        return np.asarray(flow * -np.divide(self._size, flow.shape[1::-1]), np.float32)

    def _residual(self, regions: Segmentation) -> AnyArray:
        if regions.propagated.shape != regions.labels.shape:  # a shot begins
            return np.ones(regions.labels.shape, np.bool_)
        return np.asarray(regions.propagated == 0)

    def _propagated(self, painting: CompositedFrame) -> AnyArray:
        moved = painting.regions.propagated
        if moved.shape != painting.regions.labels.shape or self._ids is None:
            return np.zeros(painting.regions.labels.shape, np.int64)
        return np.asarray(self._ids[smooth_labels(moved)])

    def _difference(self, painting: CompositedFrame) -> AnyArray:
        found = painting.analysis.residual
        if found is None:
            return np.zeros(painting.regions.labels.shape, np.float32)
        return found / np.float32(RESIDUAL_STEPS)

    def _importance(self, painting: CompositedFrame) -> AnyArray:
        return painting.analysis.importance.result()

    def _lines(self, painting: CompositedFrame) -> AnyArray:
        if painting.lines is None:
            return np.zeros(painting.frame.shape[:2], np.float32)
        return painting.lines.coverage / np.float32(255)
