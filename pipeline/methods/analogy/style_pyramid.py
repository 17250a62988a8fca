"""The style at every level of the pyramid, and the energy function of a level."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.errors import BadInput
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.sources import Guide, StylePair
from pipeline.synthesis.energy import Energy
from pipeline.synthesis.images import Bytes, Style, halved, packed
from pipeline.synthesis.orientation import orientation

MOST_CHANNELS = 16
_LOOSER = 2
"""Exponent of the temporal weight: it is a quarter at each coarser level. Departure: the paper has one weight. Coarse
levels decide which part of the style goes where; the finest level decides whether strokes stand still."""


def energy_of(
    params: AnalogyParams, guides: tuple[Guide, ...], level: int, *, colours: int = 3, keyed: bool = False
) -> Energy:
    """The energy function of a parameter set at a level; lengths in px shrink with the level.

    Raises:
        BadInput: colours and guides together have more than 16 channels.
    """
    weight = params.key_guide_weight if keyed else params.guide_weight
    hue = weight * (params.key_colour_weight if keyed else params.colour_weight) / 2
    extra = tuple(w for guide in guides for w in guide.weights)
    if colours + 3 + len(extra) > MOST_CHANNELS:
        names = ", ".join(f"{guide.name} {guide.channels}" for guide in guides)
        raise BadInput(
            "There are too many guides.", field="guides", value=f"channels: {names}",
            remedy=f"Use at most {MOST_CHANNELS - 3 - colours} channels: make some guides gray, or remove some.",
        )  # fmt: skip
    half = 2.0**-level
    return Energy(
        colours=colours, radius=params.patch_radius, sigma_px=params.patch_sigma, w_out=params.texture_weight,
        guides=(weight, hue, hue, *extra),
        w_sc=params.coherence_weight, r_max_px2=params.coherence_limit,
        w_tc=0.0 if keyed or params.temporal == "off" else params.steadiness * half**_LOOSER,
        w_h=params.variety_weight, h_limit=params.variety_limit,
        w_dt=params.lines_weight / half**2, d_max_px=params.lines_reach * half,
        w_din=params.change_weight if keyed else 0.0, w_dout=params.change_out_weight if keyed else 0.0,
    )  # fmt: skip


class StylePyramid:
    """A style pair at every level; levels are computed on first use."""

    def __init__(self, pair: StylePair, params: AnalogyParams) -> None:
        self._pairs = [pair]
        self._params = params

    def at(self, level: int, energy: Energy) -> Style:
        """The style at a level, packed for an energy function."""
        while len(self._pairs) <= level:
            self._pairs.append(_half(self._pairs[-1]))
        pair = self._pairs[level]
        turning = self._params.rotation == "on"
        bins = orientation(np.ascontiguousarray(pair.guide[..., 0]), self._params.rotation_sigma) if turning else None
        features = packed(energy, compared(pair.output, self._params.colours), pair.guides)
        return Style(pair.output, features, bins, pair.usable, pair.lines)


def compared(output: Bytes, space: str) -> Bytes:
    """The colours that patches compare: RGB or CIELAB, premultiplied by opacity, since transparent pixels have no
    meaningful colour. uint8 (h, w, 3 or 4)."""
    colours = np.ascontiguousarray(output[..., :3])
    if space == "lab":
        colours = np.asarray(cv2.cvtColor(colours, cv2.COLOR_RGB2Lab), np.uint8)
    if output.shape[2] == 3:
        return colours
    seen = output[..., 3:].astype(np.uint16)
    return np.concatenate([((colours * seen + 127) // 255).astype(np.uint8), output[..., 3:]], axis=-1)


def _half(pair: StylePair) -> StylePair:
    def bytes_of(image: Bytes) -> Bytes:
        return np.asarray(halved(image), np.uint8)

    return StylePair(
        bytes_of(pair.output), bytes_of(pair.guide), pair.derived,
        None if pair.extra is None else bytes_of(pair.extra),
        None if pair.usable is None else np.asarray(halved(pair.usable, nearest=True), np.uint8),
        None if pair.lines is None else np.asarray(halved(pair.lines), np.float32) / np.float32(2),
    )  # fmt: skip
