"""Colours of the regions (zhang2011online, section 5), blended over time by eq. 4."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.colour import scheme
from pipeline.colour.spaces import hsv_to_srgb, lab_to_srgb, srgb_to_hsv, srgb_to_lab, to_8bit
from pipeline.methods.abstraction.fixed_palette import FixedPalette
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.regions.regions import carried
from pipeline.regions.segmenter import Segmentation

Lab = NDArray[np.float64]
LARGEST_LAG = 6.0
"""Largest difference, CIELAB units, between a region's mean colour and the mean colour from which its output colour was
computed."""

PRINTED_LIMITS = {"achromatic": 0.0, "max_gain": math.inf}
"""Arguments of `scheme.apply` that compute equations 2 and 3 as printed."""


class Palette:
    """Computes the output colour of each region; keeps the colours of the previous frame."""

    def __init__(self, params: AbstractionParams, reference: scheme.ColourStats | None) -> None:
        self.params = params
        self.reference = reference
        self.last: Lab | None = None
        self.followed: Lab | None = None
        """Mean colours of the regions, blended over time like the output colours."""
        self.fixed = FixedPalette(params.palette) if params.palette else None
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
            past, weight = self._past(regions, np.hstack((self.last, self.followed)), means, light_steadiness)
            self.last = target + weight * (past[:, :3] - target)
            self.followed = means + weight * (past[:, 3:] - means)
        if self.fixed is not None:
            return self.fixed.step(regions, self.last, light_steadiness)
        return to_8bit(lab_to_srgb(self.last))

    def reset(self) -> None:
        """Begin a shot."""
        self.last = self.followed = None
        if self.fixed is not None:
            self.fixed.last = None

    def _target(self, means: Lab, tone: scheme.Tone | None) -> Lab:
        """Colours of regions with these mean colours, before the blending over time."""
        lab = means
        if self.reference is not None and tone is not None:
            hsv = srgb_to_hsv(lab_to_srgb(lab))
            limits = PRINTED_LIMITS if self.params.algorithm == "printed" else {}
            moved = scheme.apply(self.reference, tone, hsv, self.params.keep_brightness, table=self._table, **limits)
            lab = srgb_to_lab(hsv_to_srgb(moved))
        return np.asarray(lab * (1, self.params.vividness, self.params.vividness))

    def _past(
        self, regions: Segmentation, before: Lab, means: Lab, light_steadiness: float
    ) -> tuple[Lab, Lab]:  # fmt: skip
        """Past colours of the regions, (n + 1, 6), and their weight, (n + 1, 1).

        Eq. 4: o_i = (1 - alpha) o_{i-1} + alpha c_i, with the colour o_{i-1} that the region had; 1 for a new region.

        Departure: alpha is near 1 for a well tracked region, which would then follow every fluctuation of the exposure,
        and a new region would appear at once. The past is therefore the mean of what was painted where the region lies
        now, with a half-life in frames; `colour_half_life` = 0 is the paper's equation. The colour lags behind by
        `LARGEST_LAG` at most: a region that has lost an arm to another one would otherwise keep the arm's colour.

        Args:
            before: (regions before + 1, 6), output colours, and the mean colours from which they were computed.
            means: mean colours of the regions.
        """
        half_life = self.params.colour_half_life
        if half_life == 0:
            known = np.minimum(regions.previous, len(before) - 1)
            weight = np.where(regions.previous > 0, 1 - regions.alpha.astype(np.float64), 0.0)
            return before[known], np.asarray(weight[:, None])
        past, share = carried(regions.labels, regions.propagated, before)
        lag = np.linalg.norm(means - past[:, 3:], axis=1)
        weight = np.minimum(
            light_steadiness * 0.5 ** (1 / half_life) * share, LARGEST_LAG / np.maximum(lag, LARGEST_LAG)
        )
        return past, np.asarray(weight[:, None])

    def state(self) -> State:
        """Arrays by name: colours of the previous frame, the mean colours from which they were computed, both CIELAB,
        and what was painted of a fixed palette."""
        if self.last is None or self.followed is None:
            return {}
        return {"colours": self.last, "followed": self.followed, **(self.fixed.state() if self.fixed else {})}

    def restore(self, state: Arrays) -> None:
        self.last, self.followed = state.get("colours"), state.get("followed")
        if self.fixed is not None:
            self.fixed.restore(state)


def _lab(regions: Segmentation) -> Lab:
    """Mean colours of the regions, CIELAB units."""
    return np.asarray(regions.means.astype(np.float64) * (100 / 255, 1, 1) - (0, 128, 128))
