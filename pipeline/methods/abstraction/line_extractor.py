"""The line layer: strokes along the ridges of a difference of Gaussians, coherent over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.colour.lab8 import LabPlanes
from pipeline.frames import Flow, Plane
from pipeline.kernels.selection import nth_smallest
from pipeline.lines.coloured_stripes import stripe_shares
from pipeline.lines.dog import GAUSSIAN_RATIO, dog_response
from pipeline.lines.inking import ink_curves
from pipeline.lines.linking import link_points
from pipeline.lines.memory import Marks, fading_strokes, follow_marks, leave_marks
from pipeline.lines.past import PastMotion, blend_response
from pipeline.lines.pen import Ink, Strokes, draw_strokes, join_strokes
from pipeline.lines.ridges import find_ridges
from pipeline.lines.selection import PastLines, choose_curves
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
    widest: float = 1.5
    """Largest half width of a line, in standard deviations of the narrower Gaussian of the frame."""
    weak: float = 0.255
    strong: float = 0.693
    """Hysteresis thresholds: responses above the line threshold at which the opacity is 0.25 and 0.6, times the
    sharpness."""
    face_line: float = 0.028
    least_face_line_px: float = 0.6
    face_line_gain: float = 0.8
    """Standard deviation of the narrower Gaussian in small faces, in widths of the face; its least value, px;
    factor on the response, which rises as the lines become narrower."""
    feature_line: float = 0.007
    """`face_line` of brows, eyes and mouths: wider lines would join an eye with its brow, which lies 5 px above it."""
    feature_response: float = 3.0
    feature_share: float = 0.05
    least_feature_gain: float = 0.75
    most_feature_gain: float = 4.0
    """The response around brows, eyes and mouth is multiplied so that this share of the pixels exceeds that
    response, gray levels; the factor is kept within the two limits. Faint features are thus drawn as strongly as
    dark ones."""


LINES = LineParams()


class PreviousFrame(NamedTuple):
    """Relation of a frame to the previous one.

    Attributes:
        flow: float32 (h, w, 2), previous to current frame, px.
        residual: uint8 (h, w), CIELAB difference of each pixel to its past, quarter units; see `motion.denoise`.
    """

    flow: Flow
    residual: NDArray[np.uint8]


class Lines(NamedTuple):
    """The line layer of a frame.

    Attributes:
        strokes: in px of the output.
        coverage: uint8 (h, w), their ink at the output size, 0..255, before `line_opacity`.
    """

    strokes: Strokes
    coverage: Ink


class LineResponse(NamedTuple):
    """The line response of a frame, and what the lines need of how it was made; planes at the size of the line planes.

    Attributes:
        plane: float32 (h, w), gray levels, averaged with that of the previous frame.
        sigma_px: standard deviation of the narrower Gaussian at each pixel.
        past, motion: relation to the previous frame, and how far lines follow it; None = they do not.
    """

    plane: Plane
    sigma_px: Plane
    past: PreviousFrame | None
    motion: PastMotion | None


class LineExtractor:
    """Draws lines for frame after frame. `params` are those of the next frame.

    Ridges of the line response are traced at a resolution where the narrow Gaussian is about a pixel wide, and become
    strokes of a pen, which are drawn at the size of the output. The response of the previous frame and its
    strokes are remembered.
    """

    def __init__(self, params: AbstractionParams, sizes: Sizes) -> None:
        self.params = params
        self.size, self.output_size = sizes.work, sizes.output
        sigma_px = max(FINEST_LINE_PX, params.line_width / 1000 * min(sizes.frame))
        shrink = max(math.ceil(sizes.frame[1] / sizes.work[1]), round(sigma_px))
        self.small = (max(1, sizes.frame[0] // shrink), max(1, sizes.frame[1] // shrink))
        self.sigma_px = sigma_px / shrink
        self.marks: Marks | None = None
        self.strokes: Strokes | None = None
        self.response: Plane | None = None

    @property
    def shortest_px(self) -> float:
        """Length of the shortest weak line, px of the line planes."""
        return self.params.line_length / 1000 * min(self.small)

    def step(
        self, planes: LabPlanes, importance: Plane, past: PreviousFrame | None, faces: Sequence[FaceCrop] = ()
    ) -> Lines:  # fmt: skip
        """The line layer of the next frame.

        Args:
            planes: uint8 (3, h, w), 8-bit CIELAB, denoised.
            importance: float32, any size.
            past: None = a shot begins.
            faces: small faces, at the size of the line planes (`small`).
        """
        response = self.respond(planes, past, faces, self.params.paint_memory, self.response)
        return self.draw(response, planes, importance)

    def respond(
        self, planes: LabPlanes, past: PreviousFrame | None, faces: Sequence[FaceCrop], memory: float,
        before: Plane | None,
    ) -> LineResponse:  # fmt: skip
        """First half of `step`. Uses no state: it may run for the next frame while `draw` works on this one.

        Args:
            memory: the parameter `paint_memory` of the frame.
            before: the response of the previous frame; None = there is none.
        """
        small = cv2.resize(planes[0], self.small, interpolation=cv2.INTER_AREA).astype(np.float32)
        past = self._shrunk(past)
        sigma_px = np.full(small.shape, self.sigma_px, np.float32)
        response = self._finer(dog_response(small, self.sigma_px, LINES.tau), small, sigma_px, faces)
        motion = _motion(past, memory)
        if motion is not None and before is not None:
            response = blend_response(response, before, motion)
        return LineResponse(response, sigma_px, past, motion)

    def draw(self, response: LineResponse, planes: LabPlanes, importance: Plane) -> Lines:
        """Second half of `step`, frame after frame."""
        weight = np.asarray(cv2.resize(importance, self.small, interpolation=cv2.INTER_LINEAR), np.float32)
        self.response, motion = response.plane, response.motion
        strokes = self._strokes(response.plane, weight, response.sigma_px, response.past, planes)
        if motion is not None and self.marks is not None and self.strokes is not None:
            strokes = follow_marks(strokes, self.marks, motion)
            fading = fading_strokes(self.strokes, leave_marks(strokes, weight.shape), motion)
            strokes = join_strokes(fading, strokes)
        self._remember(strokes)
        scale = np.divide(self.output_size, self.small).astype(np.float32)
        strokes = strokes._replace(
            places=strokes.places * scale, half_widths=strokes.half_widths * np.float32(scale.mean())
        )
        return Lines(strokes, draw_strokes(strokes, self.output_size))

    def _strokes(
        self, response: Plane, importance: Plane, sigma_px: Plane, past: PreviousFrame | None, planes: LabPlanes
    ) -> Strokes:  # fmt: skip
        """The strokes of a response, px of the line planes."""
        sharpness = self.params.line_sharpness
        points, index = find_ridges(response, importance, self.params.line_threshold, LINES.weak / sharpness)
        known = None if past is None or self.marks is None else PastLines(self.marks.opacity, past.flow)
        curves = choose_curves(
            points,
            link_points(points, index),
            known,
            sigma_px / np.float32(self.sigma_px),
            LINES.strong / sharpness,
            self.shortest_px,
        )
        removed = stripe_shares(points, curves, planes, self.size[0] / self.small[0], self.sigma_px)
        return ink_curves(points, curves, response, sigma_px, sharpness, LINES.widest * self.sigma_px, removed)

    def _shrunk(self, past: PreviousFrame | None) -> PreviousFrame | None:
        """The relation to the previous frame at the size of the line planes, px of these."""
        if past is None or self.small == self.size:
            return past
        flow, residual = (cv2.resize(plane, self.small, interpolation=cv2.INTER_NEAREST) for plane in past)
        across, down = np.divide(self.small, self.size)
        return PreviousFrame(scale_flow(np.asarray(flow, np.float32), across, down), np.asarray(residual, np.uint8))

    def _finer(self, response: Plane, gray: Plane, sigma_px: Plane, faces: Sequence[FaceCrop]) -> Plane:
        """Replace the response in small faces, and its sigma, in place, by those of narrower Gaussians, narrowest at
        their features."""
        for face in faces:
            own, own_sigma_px = response[face.box], sigma_px[face.box]
            own += face.weight * (
                np.float32(LINES.face_line_gain) * self._narrow_response(gray, face, LINES.face_line) - own
            )
            own_sigma_px += face.weight * (np.float32(self._narrow_sigma_px(face, LINES.face_line)) - own_sigma_px)
            weight, features = face.features(), self._narrow_response(gray, face, LINES.feature_line)
            own += weight * (_feature_gain(features, weight) * features - own)
            own_sigma_px += weight * (np.float32(self._narrow_sigma_px(face, LINES.feature_line)) - own_sigma_px)
        return response

    def _narrow_sigma_px(self, face: FaceCrop, line: float) -> float:
        return min(max(line * face.width_px, LINES.least_face_line_px), self.sigma_px)

    def _narrow_response(self, gray: Plane, face: FaceCrop, line: float) -> Plane:
        """The response in a face to Gaussians of that standard deviation, in widths of the face."""
        sigma_px = self._narrow_sigma_px(face, line)
        around = math.ceil(3 * GAUSSIAN_RATIO * sigma_px)
        (y0, y1), (x0, x1) = ((side.start, side.stop) for side in face.box)
        top, left = max(0, y0 - around), max(0, x0 - around)
        part = np.ascontiguousarray(gray[top : y1 + around, left : x1 + around])
        return dog_response(part, sigma_px, LINES.tau)[y0 - top : y1 - top, x0 - left : x1 - left]

    def _remember(self, strokes: Strokes) -> None:
        self.strokes, self.marks = strokes, leave_marks(strokes, (self.small[1], self.small[0]))

    def state(self) -> State:
        """Arrays by name: the response and the strokes of the previous frame."""
        if self.response is None or self.strokes is None:
            return {}
        return {"response": self.response, **self.strokes._asdict()}

    def restore(self, state: Arrays) -> None:
        self.response = state.get("response")
        if "places" in state:
            self._remember(Strokes(*(state[name] for name in Strokes._fields)))


def _motion(past: PreviousFrame | None, memory: float) -> PastMotion | None:
    """The motion since the previous frame. A line of the past has no weight where the frame differs from it."""
    if past is None or not memory:
        return None
    weights = past_weights(memory).astype(np.float32) / np.float32(256)
    return PastMotion(past.flow, past.residual, weights)


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
