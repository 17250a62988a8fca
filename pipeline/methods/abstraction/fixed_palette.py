"""Fixed palettes: each region is painted in one of a few given colours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.colour.spaces import Colours, srgb_to_lab
from pipeline.regions.regions import carried
from pipeline.regions.segmenter import Segmentation

HOLD = 6.0
"""CIELAB units by which another colour of the palette must be nearer than the one that a region had."""


class FixedPalette:
    """Replaces the colours of regions by the nearest ones of a palette, in CIELAB; keeps those of the previous frame.

    A region whose colour lies between two of the palette would change from one to the other with every fluctuation of
    the light. A colour therefore counts as nearer by `HOLD` times the share of the region's pixels that had it in the
    previous frame, moved along the flow.

    Args:
        colours: "#rrggbb", at least one.
    """

    def __init__(self, colours: tuple[str, ...]) -> None:
        self.rgb = np.array([list(bytes.fromhex(colour[1:])) for colour in colours], np.uint8)
        self._lab = srgb_to_lab(self.rgb / 255)
        self.last: NDArray[np.uint8] | None = None
        """RGB of the regions of the previous frame, (n + 1, 3); None at the start of a shot."""

    def step(self, regions: Segmentation, lab: Colours, steadiness: float) -> NDArray[np.uint8]:
        """Colours of the regions of the next frame: uint8 (n + 1, 3), RGB.

        Args:
            lab: (n + 1, 3), the regions' own colours.
            steadiness: 0..1, weight of the past.
        """
        distance = np.linalg.norm(lab[:, None] - self._lab, axis=-1)
        if self.last is not None:
            had = (self.last[:, None] == self.rgb).all(axis=-1)
            past, known = carried(regions.labels, regions.propagated, had.astype(np.float64))
            distance -= HOLD * steadiness * past * known[:, None]
        self.last = self.rgb[distance.argmin(axis=1)]
        return self.last

    def state(self) -> State:
        return {} if self.last is None else {"fixed": self.last}

    def restore(self, state: Arrays) -> None:
        self.last = state.get("fixed")
