"""Settings for a still image whose guides are registered with the style.

The defaults of the other parameters are intended for a painting without guides, whose strokes stay whole, and for
video. Guides determine the position in the style. The texture can therefore count more, larger regions can stay whole,
and each position can be used less often. The guides also limit the size of the regions: where those of the frame change
faster than those of the style, neighbouring pixels must come from positions that are farther apart, which eq. 5 of
benard2013stylizing penalises.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.methods.analogy.inputs import StylePair, SynthesisInputs
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.base import TaskContext
from pipeline.synthesis.images import Bytes, halved
from pipeline.synthesis.sweeps import FirstFrame, SearchSchedule

TEXTURE_FACTOR = 2.0
"""Factor of `texture_weight`: guide weights are then those of EbSynth, relative to the weight of the style."""
COHERENCE_FACTOR = 80 / 15
"""Factor of `coherence_weight` for guides that change as fast in the frame as in the style."""
LEAST_VARIETY = 200.0
"""Minimum of `variety_weight` for the same guides."""
FREE_USES_FACTOR = 1 / 2
"""Factor of `variety_limit`."""
STRETCH_POWER = 1.5
"""Power of the stretch by which coherence and variety are divided."""
MAX_STRETCH = 16.0
STRETCH_HUE_FACTOR = 1 / 4
"""Factor of `colour_weight` in the stretch. With the whole weight, the fidelity of EbSynth's examples is 8.78 instead
of 8.72 (stylit) and 9.18 instead of 8.88 (texbynum)."""
FURTHER_LEVELS, MOST_LEVELS = 2, 7
ITERATIONS_FACTOR = 1.5
"""Factor of `iterations`."""
FINEST_ITERATIONS_FACTOR = 1 / 2
"""Factor of those iterations at the finest level, where only details remain to be solved: more rounds take time and
divide strokes."""
FINEST_SEARCH_FACTOR = 1 / 32
"""Factor of `search_radius` at the finest level."""
FULL_ROUNDS = 1
"""Number of rounds, at all but the coarsest level, whose random search visits every pixel; later rounds skip settled
pixels."""
NEAR_LEVELS = 2
"""Number of finest levels at which offsets propagate from direct neighbours only: good offsets are already near there.
The coarsest level is never one of them."""
SMOOTH_SEARCH_FACTOR = 1 / 8
"""Factor of `search_radius` for guides that do not change faster in the frame than in the style: positions then follow
from the coarser level, and a wide search finds similar texture at wrong places."""
_HALVINGS = 2
"""The stretch is measured at a quarter of the size, where the noise of rendered guides does not count."""


def is_guided_still(context: TaskContext[AnalogyParams], inputs: SynthesisInputs, pair: StylePair) -> bool:
    """Whether the film is a single image, and the style has a picture or guides that are registered with it."""
    registered = inputs.has_style_pair() and (not pair.derived or pair.extra_guides is not None)
    return context.video.total == 1 and registered and inputs.params.guided_stills == "auto"


def guided_still_params(params: AnalogyParams, stretch: float) -> AnalogyParams:
    """Parameters of a guided still: the user's, scaled, so that each of them keeps its effect.

    Args:
        stretch: see `stretch_of_guides`.
    """
    reduction = max(1.0, stretch) ** -STRETCH_POWER
    return params.model_copy(
        update={
            "texture_weight": params.texture_weight * TEXTURE_FACTOR,
            "coherence_weight": params.coherence_weight * COHERENCE_FACTOR * reduction,
            "variety_weight": max(params.variety_weight, LEAST_VARIETY * reduction),
            "variety_limit": params.variety_limit * FREE_USES_FACTOR,
            "levels": min(params.levels + FURTHER_LEVELS, MOST_LEVELS),
            "iterations": round(params.iterations * ITERATIONS_FACTOR),
            "search_radius": params.search_radius * (SMOOTH_SEARCH_FACTOR if stretch <= 1 else 1.0),
        }
    )


def guided_still_schedule(
    schedule: SearchSchedule, params: AnalogyParams, level: int, coarsest: bool
) -> SearchSchedule:
    """Effort of the search of a guided still at a level.

    At all but the finest level, candidates are compared with the mean of overlapping patches. At the `NEAR_LEVELS`
    finest levels, offsets propagate from direct neighbours only.

    Args:
        schedule: effort by the parameters of the guided still.
        params: the parameters as the user set them.
        level: 0 = full size.
        coarsest: whether the level starts from random offsets.
    """
    if coarsest:
        return replace(schedule, votes=level > 0)
    rounds, search_px = schedule.iterations, schedule.search_px
    if level == 0:
        rounds = max(1, round(rounds * FINEST_ITERATIONS_FACTOR))
        search_px = min(search_px, max(1.0, params.search_radius * FINEST_SEARCH_FACTOR))
    first = FirstFrame(rounds, search_px, FULL_ROUNDS, near=level < NEAR_LEVELS)
    return replace(schedule, first=first, settles=True, votes=level > 0)


def stretch_of_guides(frame: Bytes, style: Bytes, weights: Sequence[float]) -> float:
    """Ratio of the squared gradients of the guides in the frame to those in the style, 1/16 to 16.

    For a style that is shown at half its size the ratio is 4. 1 if the style has no gradients.

    Args:
        frame: guides of the frame, uint8 (h, w, channels).
        style: guides of the style, uint8 (h, w, channels).
        weights: weight of each channel.
    """
    in_frame, in_style = (_squared_gradient(guides, weights) for guides in (frame, style))
    return float(np.clip(in_frame / in_style, 1 / MAX_STRETCH, MAX_STRETCH)) if in_style > 0 else 1.0


def _squared_gradient(guides: Bytes, weights: Sequence[float]) -> float:
    """Weighted mean of the squared gradient over all pixels, gray levels^2 per px^2."""
    for _ in range(_HALVINGS if min(guides.shape[:2]) >= 2 << _HALVINGS else 0):
        guides = np.asarray(halved(guides), np.uint8)
    levels = guides.astype(np.float64)
    along_x, along_y = ((np.diff(levels, axis=axis) ** 2).mean((0, 1)) for axis in (1, 0))
    return float(np.dot(along_x + along_y, np.asarray(weights, np.float64)))
