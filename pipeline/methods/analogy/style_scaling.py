"""Scaling of a painting that is the only style input, so that its strokes suit the size of the frame.

The step `scan` saves the scaled painting, and the tasks of the step `synthesise` load it.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import cv2
import numpy as np

from pipeline.methods.analogy.inputs import WHOLE, StylePair, SynthesisInputs
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.base import TaskContext
from pipeline.synthesis.exemplar import PaintingColours, natural_sigma, natural_size, resized
from pipeline.synthesis.images import Bytes
from pipeline.synthesis.tone_matching import derived_guide

MAX_SCALE = 4.0
"""Maximum scale: a pixel of the painting becomes at most 4 px wide."""
SMOOTHING_SIZE = (480, 270)
"""Frame size whose pixels are the unit of `style_smoothing`, so that S has the same detail at every frame size."""
SAME_SIZE = 0.05
"""Relative difference of size up to which a painting is not scaled."""


def scaled_pair(pair: StylePair, params: AnalogyParams, size: tuple[int, int]) -> StylePair:
    """Scale a painting to the size of the frame and remove the sharpening of its scan.

    With `stroke_scale` 1, painting and frame have equally many pixels, so that a stroke takes the same share of both at
    any frame size. Every colour remains a colour of the painting. If the painting is enlarged, a second thread makes
    its guide at the same time.

    Args:
        pair: a painting without lines and directions; of guides, those that are computed from the painting.
        size: (width, height) of the frame, px.
    """
    painting = pair.output
    scale = natural_size((painting.shape[1], painting.shape[0]), size) * params.stroke_scale
    scale = 1.0 if abs(scale - 1) <= SAME_SIZE else min(scale, MAX_SCALE)
    smoothing_px = params.style_smoothing * _unit_px(size)
    with ThreadPoolExecutor(1, "impasto-style") as thread:
        smooth = thread.submit(_smoothed, painting, smoothing_px / scale) if scale > 1 else None
        output = _scaled(painting, scale)
        usable = None if pair.usable is None else _at_size(pair.usable, output, cv2.INTER_NEAREST)
        extra = None if pair.extra_guides is None else _at_size(pair.extra_guides, output, cv2.INTER_LINEAR)
        guide = (
            _smoothed(output, smoothing_px) if smooth is None else _at_size(smooth.result(), output, cv2.INTER_LINEAR)
        )
        return StylePair(output, guide, True, None if extra is None else np.atleast_3d(extra), usable)


def _at_size(image: Bytes, other: Bytes, interpolation: int) -> Bytes:
    """The image at the size of another one."""
    return np.asarray(cv2.resize(image, other.shape[1::-1], interpolation=interpolation), np.uint8)


def _scaled(painting: Bytes, scale: float) -> Bytes:
    """The painting at another size and with the sharpness of a video, in its own colours."""
    output = resized(painting, scale) if scale != 1 else painting
    sigma = natural_sigma(output)
    if sigma > 0:
        output = np.asarray(cv2.GaussianBlur(output, (0, 0), sigma), np.uint8)
    return output if output is painting else PaintingColours(painting).nearest(output)


def _smoothed(picture: Bytes, smoothing_px: float) -> Bytes:
    """The derived guide of a picture."""
    return derived_guide(np.ascontiguousarray(picture[..., :3]), smoothing_px)


def _unit_px(size: tuple[int, int]) -> float:
    """Length of a pixel of `SMOOTHING_SIZE` at this frame size, px."""
    return natural_size(SMOOTHING_SIZE, size)


def is_scaled(inputs: SynthesisInputs) -> bool:
    """Whether the style is a painting that is scaled."""
    return inputs.painting_alone and inputs.params.stroke_scale > 0


@contextmanager
def scaled_style_saved(context: TaskContext[AnalogyParams], inputs: SynthesisInputs) -> Iterator[None]:
    """Scale the painting of a layer on a thread during the block, then save it as an artefact of the step `scan`.

    Does nothing if the painting is not scaled.
    """
    if not is_scaled(inputs):
        yield
        return
    pair = inputs.style_pair()

    def scaled() -> StylePair:
        with context.clock("style"):
            return scaled_pair(pair, inputs.params, context.size)

    with ThreadPoolExecutor(1, "impasto-style") as thread:
        found = thread.submit(scaled)
        yield
        made = found.result()
        given = {"output": made.output, "guide": made.guide, "extra": made.extra_guides, "usable": made.usable}
        context.save(_artefact(inputs.layer), {name: array for name, array in given.items() if array is not None})


def style_of(context: TaskContext[AnalogyParams], inputs: SynthesisInputs) -> StylePair:
    """The style pair of a layer, scaled if it is a painting alone."""
    if not is_scaled(inputs):
        return inputs.style_pair()
    saved = context.load("scan", _artefact(inputs.layer))
    output, guide = (np.asarray(saved[name], np.uint8) for name in ("output", "guide"))
    return StylePair(output, guide, True, saved.get("extra"), saved.get("usable"))


def _artefact(layer: int) -> str:
    return "scaled-style" if layer == WHOLE else f"scaled-style-{layer}"
