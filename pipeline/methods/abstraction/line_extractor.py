"""The line layer: difference-of-Gaussians ink that is coherent over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.frames import Flow, Plane
from pipeline.kernels.selection import nth_smallest
from pipeline.lines.coherent import Ink, PreviousInk, StrokeLimits, keep_strokes
from pipeline.lines.coverage import PastMotion, blend_opacity, blend_response, draw_lines, line_field
from pipeline.lines.dog import GAUSSIAN_RATIO, dog_response, soft_threshold
from pipeline.methods.abstraction.flow_lines import FlowLines
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.sizes import FINEST_LINE_PX, Sizes
from pipeline.perception.face_masks import FaceCrop
from pipeline.perception.flow.warp import scale_flow
from pipeline.perception.motion import past_weights


@dataclass(frozen=True)
class LineParams:
    """Constants of the line layer."""

    tau: float = 0.99
    """Weight of the wider Gaussian. The response of a flat area is -1 % of its gray level, below any threshold."""
    weak: int = 64
    strong: int = 153
    """Hysteresis thresholds on ink, see `StrokeLimits`."""
    face_line: float = 0.028
    least_face_line_px: float = 0.6
    face_line_gain: float = 0.8
    """Standard deviation of the narrower Gaussian in small faces, in widths of the face; its least value, px;
    factor on the response, which rises as the lines become narrower."""
    feature_line: float = 0.007
    """`face_line` of brows, eyes and mouths: wider lines would join an eye with its brow, which lies 5 px above it."""
    feature_response: float = 1.3
    feature_share: float = 0.05
    least_feature_gain: float = 0.75
    most_feature_gain: float = 2.2
    """The response around brows, eyes and mouth is multiplied so that this share of the pixels exceeds that
    response, gray levels; the factor is kept within the two limits. Faint features are thus drawn as strongly as
    dark ones."""
    face_length: float = 0.2
    """Importance that is added in small faces when strokes are selected by their length: an eye is 4 px long."""
    largest_margin: float = 1.0
    """Gray levels: bounds how much thinner outlined lines become when `line_sharpness` is low."""


LINES = LineParams()


NEIGHBOURHOOD, ENLARGED_NEIGHBOURHOOD = np.ones((3, 3), np.uint8), np.ones((5, 5), np.uint8)
"""The opacity of an outlined line is that of its strongest pixel within this neighbourhood, so that only its outline
fades. In a frame larger than the analysed one, interpolation would otherwise let the opacity fall within the outline;
lines are drawn wider there, for the same reason. Of a line of ink, the smaller neighbourhood keeps the soft rim."""


class PreviousFrame(NamedTuple):
    """Relation of a frame to the previous one.

    Attributes:
        flow: float32 (h, w, 2), previous to current frame, px.
        residual: uint8 (h, w), CIELAB difference of each pixel to its past, quarter units; see `motion.denoise`.
    """

    flow: Flow
    residual: NDArray[np.uint8]


class LineExtractor:
    """Draws lines for frame after frame, at a resolution where the narrow Gaussian is about a pixel wide.

    The ink is enlarged to the output. With `sizes.curves`, the smooth response is enlarged instead, and its contour is
    drawn, anti-aliased at full size. The contour lies where the ink has half of its full opacity, so that lines have
    the same width; in a frame larger than the analysed one, where the ink begins. The response and the opacity of the
    previous frame are then remembered, too.
    """

    def __init__(self, params: AbstractionParams, sizes: Sizes) -> None:
        self.params = params
        self.size, self.output_size, self.curves = sizes.work, sizes.output, sizes.curves
        sigma_px = max(FINEST_LINE_PX, params.line_width / 1000 * min(sizes.frame))
        shrink = max(math.ceil(sizes.frame[1] / sizes.work[1]), round(sigma_px))
        self.small = (max(1, sizes.frame[0] // shrink), max(1, sizes.frame[1] // shrink))
        self.sigma_px = sigma_px / shrink
        self.limits = StrokeLimits(LINES.weak, LINES.strong, params.line_length / 1000 * min(self.small))
        enlarged = sizes.frame != sizes.output
        self.neighbourhood = ENLARGED_NEIGHBOURHOOD if enlarged else NEIGHBOURHOOD
        self.margin = 0.0 if enlarged else min(LINES.largest_margin, math.atanh(0.5) / params.line_sharpness)
        self.last: Ink | None = None
        self.opacity: Ink | None = None
        self.response: Plane | None = None
        flows = params.lines == "flow"
        self.flow_lines = FlowLines(self.sigma_px, LINES.tau, params.steadiness) if flows else None

    def step(
        self, gray: NDArray[np.uint8], importance: Plane, past: PreviousFrame | None, faces: Sequence[FaceCrop] = ()
    ) -> Ink:  # fmt: skip
        """The line layer of the next frame at the output size, uint8 (h, w), 0..255, before `line_opacity`.

        Args:
            gray: uint8 (h, w), denoised.
            importance: float32, any size.
            past: None = a shot begins.
            faces: small faces, at the size of the line planes (`small`).
        """
        small = cv2.resize(gray, self.small, interpolation=cv2.INTER_AREA).astype(np.float32)
        weight = np.asarray(cv2.resize(importance, self.small, interpolation=cv2.INTER_LINEAR), np.float32)
        past = self._shrunk(past)
        response = self._finer(self._respond(small, weight, past), small, faces)
        motion = self._motion(past) if self.curves else None
        if motion is not None and self.response is not None:
            response = blend_response(response, self.response, motion)
        ink = soft_threshold(response, weight, self.params.line_threshold, self.params.line_sharpness)
        keep = keep_strokes(ink, self._previous_ink(past), self._for_strokes(weight, faces), self.limits)
        if self.curves:
            self.last, self.response = np.asarray(cv2.bitwise_and(ink, keep), np.uint8), response
            return self._outlined(self.last, response, weight, motion)
        self.last = np.asarray(cv2.bitwise_and(ink, cv2.dilate(keep, NEIGHBOURHOOD)), np.uint8)
        if self.small == self.size:
            return self.last
        return np.asarray(cv2.resize(self.last, self.size, interpolation=cv2.INTER_LINEAR), np.uint8)

    def _outlined(self, ink: Ink, response: Plane, importance: Plane, motion: PastMotion | None) -> Ink:
        """The lines as contours of the response, with an opacity that rises and falls gradually."""
        opacity = np.asarray(cv2.dilate(ink, self.neighbourhood), np.uint8)
        if motion is not None and self.opacity is not None:
            opacity = blend_opacity(opacity, self.opacity, motion)
        self.opacity = opacity
        blur = max(1, round(2 * self.sigma_px))
        field = line_field(response, importance, self.params.line_threshold, self.margin, blur)
        return draw_lines(field, opacity, self.output_size)

    def _motion(self, past: PreviousFrame | None) -> PastMotion | None:
        """The motion since the previous frame. A line of the past has no weight where the frame differs from it."""
        if past is None or not self.params.paint_memory:
            return None
        weights = past_weights(self.params.paint_memory).astype(np.float32) / np.float32(256)
        return PastMotion(past.flow, past.residual, weights)

    def _shrunk(self, past: PreviousFrame | None) -> PreviousFrame | None:
        """The relation to the previous frame at the size of the line planes, px of these."""
        if past is None or self.small == self.size:
            return past
        flow, residual = (cv2.resize(plane, self.small, interpolation=cv2.INTER_NEAREST) for plane in past)
        across, down = np.divide(self.small, self.size)
        return PreviousFrame(scale_flow(np.asarray(flow, np.float32), across, down), np.asarray(residual, np.uint8))

    def _previous_ink(self, past: PreviousFrame | None) -> PreviousInk | None:
        return None if past is None or self.last is None else PreviousInk(self.last, past.flow)

    def _respond(self, gray: Plane, importance: Plane, past: PreviousFrame | None) -> Plane:
        if self.flow_lines:
            return self.flow_lines.step(gray, importance, None if past is None else past.flow)
        return dog_response(gray, self.sigma_px, LINES.tau)

    def _finer(self, response: Plane, gray: Plane, faces: Sequence[FaceCrop]) -> Plane:
        """Replace the response in small faces, in place, by that of narrower Gaussians, narrowest at their features."""
        for face in faces:
            own = response[face.box]
            own += face.weight * (
                np.float32(LINES.face_line_gain) * self._narrow_response(gray, face, LINES.face_line) - own
            )
            weight, features = face.features(), self._narrow_response(gray, face, LINES.feature_line)
            own += weight * (_feature_gain(features, weight) * features - own)
        return response

    def _narrow_response(self, gray: Plane, face: FaceCrop, line: float) -> Plane:
        """The response in a face to Gaussians of that standard deviation, in widths of the face."""
        sigma_px = min(max(line * face.width_px, LINES.least_face_line_px), self.sigma_px)
        around = math.ceil(3 * GAUSSIAN_RATIO * sigma_px)
        (y0, y1), (x0, x1) = ((side.start, side.stop) for side in face.box)
        top, left = max(0, y0 - around), max(0, x0 - around)
        part = np.ascontiguousarray(gray[top : y1 + around, left : x1 + around])
        return dog_response(part, sigma_px, LINES.tau)[y0 - top : y1 - top, x0 - left : x1 - left]

    @staticmethod
    def _for_strokes(importance: Plane, faces: Sequence[FaceCrop]) -> Plane:
        """The importance by which strokes are selected: small faces keep short strokes."""
        if not faces:
            return importance
        out = importance.copy()
        for face in faces:
            out[face.box] += np.float32(LINES.face_length) * face.weight
        return out

    def state(self) -> State:
        """Arrays by name: the previous frame's ink, and with `curves` its opacity and response."""
        own = {"ink": self.last, "opacity": self.opacity, "response": self.response}
        known = {name: array for name, array in own.items() if array is not None}
        return known | (self.flow_lines.state() if self.flow_lines else {})

    def restore(self, state: Arrays) -> None:
        self.last = state.get("ink")
        if self.curves:
            self.opacity, self.response = state.get("opacity"), state.get("response")
        if self.flow_lines:
            self.flow_lines.restore(state)


def _feature_gain(response: Plane, weight: Plane) -> np.float32:
    """Factor on the response at the features of a face, see `LINES.feature_response`."""
    inside = response[weight > weight.max() / 2]
    if not inside.size:
        return np.float32(1)
    place = int((1 - LINES.feature_share) * (inside.size - 1))
    strong = max(nth_smallest(inside, place), np.float32(1e-3))
    return np.float32(
        np.clip(np.float32(LINES.feature_response) / strong, LINES.least_feature_gain, LINES.most_feature_gain)
    )
