"""The style a task works with, at every level, and the goal function that goes with it."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.errors import BadInput
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.sources import Guide, Pair
from pipeline.synthesis.goal import Goal
from pipeline.synthesis.images import Bytes, Style, halved, packed
from pipeline.synthesis.orientation import orientation

MOST_CHANNELS = 16
_LOOSER = 2
"""Steadiness is a quarter at each coarser level. Departure: the paper has one weight. What goes where is decided there,
by likeness to every frame; that strokes stand still, at the finest."""


def goal_of(
    params: AnalogyParams, guides: tuple[Guide, ...], level: int, *, colours: int = 3, keyed: bool = False
) -> Goal:
    """The goal function of the parameters at a level: lengths in px shrink with it.

    Raises:
        BadInput: colours and guides have more than 16 channels.
    """
    weight = params.key_guide_weight if keyed else params.guide_weight
    hue = weight * (params.key_colour_weight if keyed else params.colour_weight) / 2
    extra = tuple(w for guide in guides for w in guide.weights)
    if colours + 3 + len(extra) > MOST_CHANNELS:
        names = ", ".join(f"{guide.name} {guide.channels}" for guide in guides)
        raise BadInput(
            "There are too many guides.", field="guides", value=f"channels: {names}",
            remedy=f"At most {MOST_CHANNELS - 3 - colours} channels: make some of them gray, or leave some out.",
        )  # fmt: skip
    half = 2.0**-level
    return Goal(
        colours=colours, radius=params.patch_radius, sigma_px=params.patch_sigma, w_out=params.texture_weight,
        guides=(weight, hue, hue, *extra),
        w_sc=params.coherence_weight, r_max_px2=params.coherence_limit,
        w_tc=0.0 if keyed or params.temporal == "off" else params.steadiness * half**_LOOSER,
        w_h=params.variety_weight, h_limit=params.variety_limit,
        w_dt=params.lines_weight / half**2, d_max_px=params.lines_reach * half,
        w_din=params.change_weight if keyed else 0.0, w_dout=params.change_out_weight if keyed else 0.0,
    )  # fmt: skip


class Styles:
    """A pair at every level, made when asked for."""

    def __init__(self, pair: Pair, params: AnalogyParams) -> None:
        self._pairs = [pair]
        self._params = params

    def at(self, level: int, goal: Goal) -> Style:
        """The style at a level, packed for a goal."""
        while len(self._pairs) <= level:
            self._pairs.append(_half(self._pairs[-1]))
        pair = self._pairs[level]
        turning = self._params.rotation == "on"
        bins = orientation(np.ascontiguousarray(pair.guide[..., 0]), self._params.rotation_sigma) if turning else None
        features = packed(goal, compared(pair.output, self._params.colours), pair.guides)
        return Style(pair.output, features, bins, pair.usable, pair.lines)


def compared(output: Bytes, space: str) -> Bytes:
    """The style's colours as patches compare them: RGB or CIELAB; multiplied by opacity where there is one, since the
    colour of what is transparent means nothing."""
    colours = np.ascontiguousarray(output[..., :3])
    if space == "lab":
        colours = np.asarray(cv2.cvtColor(colours, cv2.COLOR_RGB2Lab), np.uint8)
    if output.shape[2] == 3:
        return colours
    seen = output[..., 3:].astype(np.uint16)
    return np.concatenate([((colours * seen + 127) // 255).astype(np.uint8), output[..., 3:]], axis=-1)


def _half(pair: Pair) -> Pair:
    def bytes_of(image: Bytes) -> Bytes:
        return np.asarray(halved(image), np.uint8)

    return Pair(
        bytes_of(pair.output), bytes_of(pair.guide), pair.derived,
        None if pair.extra is None else bytes_of(pair.extra),
        None if pair.usable is None else np.asarray(halved(pair.usable, nearest=True), np.uint8),
        None if pair.lines is None else np.asarray(halved(pair.lines), np.float32) / np.float32(2),
    )  # fmt: skip
