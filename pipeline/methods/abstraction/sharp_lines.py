"""The line layer of `edges=sharp`: contours of the difference-of-Gaussians response, anti-aliased at full size."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.frames import Plane
from pipeline.lines.coherent import Ink, keep_strokes
from pipeline.lines.coverage import PastMotion, blend_opacity, blend_response, draw_lines, line_field
from pipeline.lines.dog import soft_threshold
from pipeline.methods.abstraction.line_extractor import LineExtractor, Past
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.sizes import Sizes
from pipeline.segmentation.face_masks import FaceCrop
from pipeline.segmentation.motion import past_weights

NEIGHBOURHOOD, ENLARGED_NEIGHBOURHOOD = np.ones((3, 3), np.uint8), np.ones((5, 5), np.uint8)
"""A line's opacity is that of its strongest pixel within this neighbourhood, so that only its outline fades. In a frame
larger than the analysed one, interpolation would otherwise let the opacity fall within the outline; lines are drawn
wider there, for the same reason."""
LARGEST_MARGIN = 1.0
"""Gray levels: bounds how much thinner lines become when `line_sharpness` is low."""


class SharpLineExtractor(LineExtractor):
    """Extracts lines like `LineExtractor`, but enlarges the smooth response instead of the ink, and draws its contour.

    The contour lies where the ink of `LineExtractor` has half of its full opacity, so that lines have the same width;
    in a frame larger than the analysed one, where the ink begins.

    Remembers the previous frame's response and opacity in addition to its ink.
    """

    def __init__(self, params: AbstractionParams, sizes: Sizes) -> None:
        super().__init__(params, sizes)
        self.output_size = sizes.output
        enlarged = sizes.frame != sizes.output
        self.neighbourhood = ENLARGED_NEIGHBOURHOOD if enlarged else NEIGHBOURHOOD
        self.margin = 0.0 if enlarged else min(LARGEST_MARGIN, math.atanh(0.5) / params.line_sharpness)
        self.opacity: Ink | None = None
        self.response: Plane | None = None

    def step(
        self, gray: NDArray[np.uint8], importance: Plane, past: Past | None, faces: Sequence[FaceCrop] = ()
    ) -> Ink:  # fmt: skip
        """The line layer of the next frame at the output size, uint8 (h, w), 0..255, before `line_opacity`.

        See `LineExtractor.step`.
        """
        params = self.params
        small = cv2.resize(gray, self.small, interpolation=cv2.INTER_AREA).astype(np.float32)
        weight = np.asarray(cv2.resize(importance, self.small, interpolation=cv2.INTER_LINEAR), np.float32)
        past = self._shrunk(past)
        response = self._finer(self._respond(small, weight, past), small, faces)
        motion = self._motion(past)
        if motion is not None and self.response is not None:
            response = blend_response(response, self.response, motion)
        self.response = response
        ink = soft_threshold(response, weight, params.line_threshold, params.line_sharpness)
        keep = keep_strokes(ink, self._previous_ink(past), self._for_strokes(weight, faces), self.limits)
        self.last = np.asarray(cv2.bitwise_and(ink, keep), np.uint8)
        self.opacity = self._opacity(self.last, motion)
        field = line_field(response, weight, params.line_threshold, self.margin, max(1, round(2 * self.sigma_px)))
        return draw_lines(field, self.opacity, self.output_size)

    def _motion(self, past: Past | None) -> PastMotion | None:
        """The motion since the previous frame. A line of the past has no weight where the frame differs from it."""
        if past is None or not self.params.paint_memory:
            return None
        weights = past_weights(self.params.paint_memory).astype(np.float32) / np.float32(256)
        return PastMotion(past.flow, past.residual, weights)

    def _opacity(self, ink: Ink, motion: PastMotion | None) -> Ink:
        """Opacity of the strokes, which appear and vanish gradually."""
        opacity = np.asarray(cv2.dilate(ink, self.neighbourhood), np.uint8)
        if motion is None or self.opacity is None:
            return opacity
        return blend_opacity(opacity, self.opacity, motion)

    def state(self) -> State:
        """Arrays by name: those of `LineExtractor`, and the previous frame's opacity and response."""
        if self.opacity is None or self.response is None:
            return super().state()
        return super().state() | {"opacity": self.opacity, "response": self.response}

    def restore(self, state: Arrays) -> None:
        super().restore(state)
        self.opacity, self.response = state.get("opacity"), state.get("response")
