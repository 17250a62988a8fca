"""Colours of the regions (zhang2011online, section 5), blended over time by eq. 4."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.colour import scheme
from pipeline.colour.spaces import hsv_to_srgb, lab_to_srgb, srgb_to_hsv, srgb_to_lab, to_8bit
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.segmentation.segmenter import Segmentation

Lab = NDArray[np.float64]


class Palette:
    """Computes the output colour of each region; keeps the colours of the previous frame."""

    def __init__(self, params: AbstractionParams, reference: scheme.ColourStats | None) -> None:
        self.params = params
        self.reference = reference
        self.last: Lab | None = None
        self._table = None
        if reference is not None:
            self._table = scheme.hue_table(reference, params.mean_shift_steps, params.hue_neighbourhood)

    def step(self, regions: Segmentation, tone: scheme.Tone | None, light_steadiness: float = 1.0) -> NDArray[np.uint8]:
        """Colours of the regions of the next frame: uint8 (n + 1, 3), RGB.

        Args:
            tone: tone of the frame; required if there is a reference.
            light_steadiness: 0..1, see `cuts.light_steadiness`; in a fade, colours change at once.
        """
        target = self._target(regions, tone)
        self.last = target if self.last is None else self._blend(regions, target, self.last, light_steadiness)
        return to_8bit(lab_to_srgb(self.last))

    def _target(self, regions: Segmentation, tone: scheme.Tone | None) -> Lab:
        lab = regions.means.astype(np.float64) * (100 / 255, 1, 1) - (0, 128, 128)
        if self.reference is not None and tone is not None:
            hsv = srgb_to_hsv(lab_to_srgb(lab))
            moved = scheme.apply(self.reference, tone, hsv, self.params.keep_brightness, table=self._table)
            lab = srgb_to_lab(hsv_to_srgb(moved))
        return np.asarray(lab * (1, self.params.vividness, self.params.vividness))

    def _blend(self, regions: Segmentation, target: Lab, last: Lab, light_steadiness: float) -> Lab:
        """Eq. 4: o_i = (1 - alpha) o_{i-1} + alpha c_i; a new region has its target colour.

        Departure: alpha is near 1 for a well tracked region, which would then follow every fluctuation of the exposure.
        It is scaled to a half-life in frames; `colour_half_life` = 0 is the paper's equation.
        """
        half_life = self.params.colour_half_life
        gain = 1 - light_steadiness * 0.5 ** (1 / half_life) if half_life > 0 else 1.0
        weight = np.where(regions.previous > 0, regions.alpha * gain, 1.0)[:, None]
        before = last[np.minimum(regions.previous, len(last) - 1)]
        return np.asarray(before + weight * (target - before))

    def state(self) -> State:
        return {} if self.last is None else {"colours": self.last}

    def restore(self, state: Arrays) -> None:
        self.last = state.get("colours")
