"""Colours of the regions (zhang2011online, section 5), blended over time by eq. 4."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.colour import scheme
from pipeline.colour.spaces import hsv_to_srgb, lab_to_srgb, srgb_to_hsv, srgb_to_lab, to_8bit
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.regions.segmenter import Segmentation

Lab = NDArray[np.float64]
LARGEST_LAG = 6.0
"""Largest difference, CIELAB units, between a region's mean colour and the mean colour from which its output colour was
computed."""


class Palette:
    """Computes the output colour of each region; keeps the colours of the previous frame."""

    def __init__(self, params: AbstractionParams, reference: scheme.ColourStats | None) -> None:
        self.params = params
        self.reference = reference
        self.last: Lab | None = None
        self.followed: Lab | None = None
        """Mean colours of the regions, blended over time like the output colours."""
        self._table = None
        if reference is not None:
            self._table = scheme.hue_table(reference, params.mean_shift_steps, params.hue_neighbourhood)

    def step(self, regions: Segmentation, tone: scheme.Tone | None, light_steadiness: float = 1.0) -> NDArray[np.uint8]:
        """Colours of the regions of the next frame: uint8 (n + 1, 3), RGB.

        Args:
            tone: tone of the frame; required if there is a reference.
            light_steadiness: 0..1, see `cuts.light_steadiness`; in a fade, colours change at once.
        """
        means = _lab(regions)
        target = self._target(means, tone)
        if self.last is None or self.followed is None:
            self.last, self.followed = target, means
        else:
            before = np.minimum(regions.previous, len(self.last) - 1)
            weight = self._weight(regions, means - self.followed[before], light_steadiness)
            self.last = self.last[before] + weight * (target - self.last[before])
            self.followed = self.followed[before] + weight * (means - self.followed[before])
        return to_8bit(lab_to_srgb(self.last))

    def _target(self, means: Lab, tone: scheme.Tone | None) -> Lab:
        """Colours of regions with these mean colours, before the blending over time."""
        lab = means
        if self.reference is not None and tone is not None:
            hsv = srgb_to_hsv(lab_to_srgb(lab))
            moved = scheme.apply(self.reference, tone, hsv, self.params.keep_brightness, table=self._table)
            lab = srgb_to_lab(hsv_to_srgb(moved))
        return np.asarray(lab * (1, self.params.vividness, self.params.vividness))

    def _weight(self, regions: Segmentation, change: Lab, light_steadiness: float) -> Lab:
        """Weight of the target colours, (n + 1, 1). Eq. 4: o_i = (1 - alpha) o_{i-1} + alpha c_i; 1 for a new region.

        Departure: alpha is near 1 for a well tracked region, which would then follow every fluctuation of the exposure.
        It is scaled to a half-life in frames; `colour_half_life` = 0 is the paper's equation. The colour lags behind by
        `LARGEST_LAG` at most: a region that has lost an arm to another one would otherwise keep the arm's colour.

        Args:
            change: difference between the regions' mean colours and those from which their output colours were
                computed.
        """
        half_life = self.params.colour_half_life
        gain = 1 - light_steadiness * 0.5 ** (1 / half_life) if half_life > 0 else 1.0
        weight = np.where(regions.previous > 0, regions.alpha * gain, 1.0)
        if half_life > 0:
            weight = np.maximum(weight, 1 - LARGEST_LAG / np.maximum(np.linalg.norm(change, axis=1), LARGEST_LAG))
        return np.asarray(weight[:, None])

    def state(self) -> State:
        """Arrays by name: colours of the previous frame, and the mean colours from which they were computed, CIELAB."""
        return {} if self.last is None or self.followed is None else {"colours": self.last, "followed": self.followed}

    def restore(self, state: Arrays) -> None:
        self.last, self.followed = state.get("colours"), state.get("followed")


def _lab(regions: Segmentation) -> Lab:
    """Mean colours of the regions, CIELAB units."""
    return np.asarray(regions.means.astype(np.float64) * (100 / 255, 1, 1) - (0, 128, 128))
