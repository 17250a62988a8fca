"""Frame analysis: motion, denoising, detail, orientation field, style, strokes. It keeps all long-term state.

The painter keeps at most the few previous paintings of temporal accumulation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State, flatten, part
from pipeline.frames import Flow, Frame, Mask, Plane, same_size
from pipeline.kernels.executors import INLINE, FrameExecutor
from pipeline.kernels.float16 import to_half
from pipeline.methods.multistyle.analysis import Half, StrokeAnalysis, StrokeLayer
from pipeline.methods.multistyle.backward_flow import backward_flow, downscaled, gray_of, working_size
from pipeline.methods.multistyle.denoise import TemporalDenoiser, denoise_directions
from pipeline.methods.multistyle.design import Design
from pipeline.methods.multistyle.design_fields import DesignFields, RegionPlacement
from pipeline.methods.multistyle.face_layer import FaceLayer
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.stroke_layers import FrameMotion, StrokeLayers, blurred
from pipeline.methods.multistyle.styles import (
    PIXEL_FIELDS,
    STYLES,
    LayerStyle,
    Style,
    Values,
    chosen_style,
    layer_style,
    uniform,
)
from pipeline.methods.tasks import Clock
from pipeline.perception.cuts import is_cut, thumbnail
from pipeline.perception.face_contrast import raise_contrast
from pipeline.perception.faces import Faces
from pipeline.perception.flow.invert import invert_flow
from pipeline.perception.importance import ImportanceParams, ImportanceTracker, warp_forward
from pipeline.strokes.paper import EdgeDarkening
from pipeline.tensors.edges import FAINT, edge_field, gradient_tensor, smooth_over_time
from pipeline.tensors.field import OrientationField, field_of, strength_of

USUAL_ROWS = 160
"""Directions on the shorter side for which `FAINT` is the gradient of a cell; finer cells have a smaller one."""


@dataclass(frozen=True)
class AnalyzerParams:
    """Constants of the analysis of frames."""

    detail_dead_band: float = 0.06
    detail_gain: float = 0.25
    """Dead band and per-frame gain with which the detail map, moved along the flow, follows its target."""
    detail_cell: int = 4
    """Side, px, of the cells for which style parameters are computed from the detail map, which is smooth. With a
    design, whose regions have sharp borders, they are computed for every pixel."""
    direction_tolerance: float = 0.2
    """Change of (cos 2a, sin 2a) up to which a direction stays the same; 0.2 is 6 degrees."""
    large_faces: float = 0.8
    """Detail of faces from two fifths of the frame's shorter side on, relative to that of small ones: with the finest
    strokes, a large face would be a photograph."""
    least_sigma: float = 0.8
    """Least sigma of the blur of the edge field, cells of the field."""
    back_cells: int = 160
    """Approximate number of cells of the stored backward flow on the shorter side."""
    broad_sigma: float = 6.0
    broad_weight: float = 0.15
    """Without clear edges, the orientation blurred with this multiple of the edge sigma is used, with this weight
    relative to a clear edge."""
    default_weight: float = 0.012
    """Weight of the default direction relative to a clear edge; also the strength of a design's field below which the
    direction is that without the design."""


ANALYZER = AnalyzerParams()


@dataclass(frozen=True)
class SensedFrame:
    """Motion, detail and faces of a frame; see `Observation`.

    Attributes:
        forward, back: flow from the previous frame to this one and back; None = a shot begins.
        attention: see `StrokeAnalyzer._attention`.
        placed, number: arguments of `StrokeAnalyzer.sense`.
    """

    frame: Frame
    forward: Flow | None
    back: Flow | None
    detail: Plane | None
    attention: Plane | None
    features: Plane | None
    faces: Faces
    placed: RegionPlacement | None
    number: int


@dataclass(frozen=True)
class DenoisedFrame:
    """A frame with its denoised picture; see `Observation`."""

    sensed: SensedFrame
    picture: Frame
    changed: Mask | None


@dataclass(frozen=True)
class Observation:
    """Analysis of a frame without its strokes.

    Attributes:
        frame: uint8 (h, w, 3).
        picture: uint8 (h', w', 3), the denoised picture at the working size.
        field: float32 (2, h", w"), the orientation field.
        motion: from the previous frame to this one and back; None = a shot begins.
        changed: bool (h', w'), see `FrameMotion`.
        detail: float32, a grid over the frame, 0..1; None = 0.
        features: float32, a grid over the frame, 0..1: eyes and mouths; None = none.
        faces: the faces of the frame.
        values, style: parameters of the style, and those of the layers.
    """

    frame: Frame
    picture: Frame
    field: OrientationField
    motion: FrameMotion | None
    changed: Mask | None
    detail: Plane | None
    features: Plane | None
    faces: Faces
    values: Values
    style: LayerStyle


class StrokeAnalyzer:
    """Analyses consecutive frames of one size. Not thread-safe.

    Args:
        size: (width, height), px.
        seed: random seed.
        clock: timer of stages, called with a stage's name.
        design: None = one style for the whole picture.

    Attributes:
        background: may take layers of strokes of a frame.
    """

    def __init__(
        self, params: MultistyleParams, size: tuple[int, int], seed: int, clock: Clock, design: Design | None = None
    ) -> None:  # fmt: skip
        params = params.effective
        self.params, self.size, self.clock = params, size, clock
        named = STYLES[params.style]
        self.work = working_size(size)
        halved = size[0] // self.work[0]
        rows = max(params.direction_rows, math.ceil(1000 * ANALYZER.least_sigma / params.edge_smoothing))
        factor, usual = (max(halved, round(min(size) / wanted)) for wanted in (rows, USUAL_ROWS))
        self.small = (max(1, size[0] // factor), max(1, size[1] // factor))
        self.faint = FAINT * min(factor / usual, 1.0)
        self.technique = named.technique
        style = chosen_style(params.at(0))
        self.design = None if design is None else DesignFields(design, style, self.technique, size, self.small)
        self.denoiser = TemporalDenoiser(params.noise_floor * named.denoise_factor)
        self.importance = ImportanceTracker(_importance(params), size)
        self.strokes = StrokeLayers(params, size, self.work, seed)
        self.background: FrameExecutor = INLINE
        self.face_layer = FaceLayer(size, self.strokes.lifecycle, seed)
        self.rims = EdgeDarkening()
        self.number = 0
        self.gray: NDArray[np.uint8] | None = None
        self.thumbnail: Plane | None = None
        self.tensors: NDArray[np.float32] | None = None
        self.field: OrientationField | None = None
        self.detail: Plane | None = None

    def step(self, frame: Frame, placed: RegionPlacement | None = None) -> StrokeAnalysis:
        """Analyse the next frame.

        Args:
            frame: uint8 (h, w, 3).
            placed: regions of the design in this frame; None = no design.
        """
        return self.place_strokes(self.observe(frame, placed))

    def observe(
        self, frame: Frame, placed: RegionPlacement | None = None, given: Flow | None = None, number: int = 0
    ) -> Observation:  # fmt: skip
        """The first half of `step`: `sense`, `denoise` and `orient`. None of these three and `place_strokes` uses state
        of another one, so that each may work on another frame, in a thread of its own, at the same time."""
        return self.orient(self.denoise(self.sense(frame, placed, given, number)))

    def sense(
        self, frame: Frame, placed: RegionPlacement | None = None, given: Flow | None = None, number: int = 0
    ) -> SensedFrame:  # fmt: skip
        """Motion, detail and faces of the next frame.

        Args:
            placed: see `step`.
            given: flow to the previous frame at the working size; None = estimated here.
            number: of the frame in the film, for parameters that vary over it.
        """
        frame = same_size(frame, self.size)
        fresh = self._begins_shot(frame)
        gray = gray_of(frame)
        forward, back = self._flow(gray, fresh, given)
        self.gray = gray
        detail = self._detail(frame, gray, forward, fresh)
        attention, features = self._attention(detail is not None)
        faces = self.importance.faces.copy()
        return SensedFrame(frame, forward, back, detail, attention, features, faces, placed, number)

    def denoise(self, sensed: SensedFrame) -> DenoisedFrame:
        """The picture of the next frame, denoised over time."""
        with self.clock("denoise"):
            small = downscaled(sensed.frame, self.work).astype(np.float32)
            picture = self.denoiser.step(small, sensed.back, sensed.attention)
            raise_contrast(picture, sensed.faces, self.size)
        return DenoisedFrame(sensed, picture, self.denoiser.changed)

    def orient(self, denoised: DenoisedFrame) -> Observation:
        """The orientation field and the style of the next frame."""
        sensed, picture, changed = denoised.sensed, denoised.picture, denoised.changed
        forward, back, placed, detail = sensed.forward, sensed.back, sensed.placed, sensed.detail
        params = self.params.at(sensed.number)
        field = self._directions(picture, back, placed, params.default_angle)
        with self.clock("style"):
            values = self._values(placed, chosen_style(params))
            style = layer_style(values, detail, min(self.size))
        motion = None if forward is None or back is None else FrameMotion(forward, back, changed)
        return Observation(
            sensed.frame, picture, field, motion, changed, detail, sensed.features, sensed.faces, values, style
        )

    def place_strokes(self, seen: Observation) -> StrokeAnalysis:
        """The second half of `step`. Observations come in the order of their frames."""
        back = None if seen.motion is None else seen.motion.back
        with self.clock("strokes"):
            on_faces = self.background.submit_parallel(partial(self._on_faces, seen))
            layers = self.strokes.step(seen.picture, seen.style, seen.motion, seen.detail, self.number, self.background)
            layers += on_faces.result()
        self.number += 1
        field16 = to_half(seen.field.transpose(1, 2, 0))
        technique = {name: self._stored(seen.values, name) for name in PIXEL_FIELDS}
        rims = self.rims.step(seen.picture, back, seen.changed) if np.max(seen.values["paper"]) > 0 else None
        flow16 = None if back is None else _coarse(back)
        features16 = None if seen.features is None else to_half(seen.features)
        return StrokeAnalysis(self.number, seen.picture, field16, layers, flow16, technique, rims, features16)

    def _on_faces(self, seen: Observation) -> tuple[StrokeLayer, ...]:
        """The layer of fine strokes on faces, if there are any."""
        frame, faces, motion = seen.frame, seen.faces, seen.motion
        if len(faces):
            frame, faces = frame.copy(), faces.copy()
            raise_contrast(frame, faces, self.size)
            faces["strength"] *= self.params.face_detail
        forward, revealed = (None, None) if motion is None else (motion.forward, self.strokes.revealed(motion))
        birth = 0 if self.params.temporal == "off" else self.number
        layer = self.face_layer.step(frame, faces, seen.style, forward, revealed, birth)
        return () if layer is None else (layer,)

    def _values(self, placed: RegionPlacement | None, style: Style) -> Values:
        if placed is None or self.design is None:
            return uniform(style, self.technique)
        self.design.base = style
        return self.design.values(placed)

    def _stored(self, values: Values, name: str) -> float | Half:
        """A technique parameter at the working size, for the painter."""
        value = values[name]
        if isinstance(value, float):
            return value
        return np.asarray(
            cv2.resize(np.asarray(value, np.float32), self.work, interpolation=cv2.INTER_AREA), np.float16
        )

    def _begins_shot(self, frame: Frame) -> bool:
        before, self.thumbnail = self.thumbnail, thumbnail(frame)
        if before is None or self.params.temporal == "off":
            return True
        return is_cut(before, self.thumbnail, self.params.cut_sensitivity)

    def _flow(
        self, gray: NDArray[np.uint8], fresh: bool, given: Flow | None
    ) -> tuple[Flow | None, Flow | None]:  # fmt: skip
        """Flow from the previous frame to this one in px of the frame, and back in px of the working size; both at the
        working size."""
        if fresh or self.gray is None:
            return None, None
        with self.clock("flow"):
            before, now = (downscaled(plane, self.work) for plane in (self.gray, gray))
            back = backward_flow(before, now, self.params) if given is None else given
            forward, _ = invert_flow(back, now, before)
            return forward * np.divide(self.size, self.work).astype(np.float32), back

    def _detail(self, frame: Frame, gray: NDArray[np.uint8], flow: Flow | None, fresh: bool) -> Plane | None:
        """Detail map, float32 in 0..1, of the frame's size with a design, otherwise coarser; None = 0 everywhere."""
        params = self.params
        if max(params.face_detail, params.saliency_detail, params.motion_detail) <= 0:
            return None
        with self.clock("detail"):
            coarse = self.importance.step_coarse(gray, flow, fresh)
            self.importance.continue_search()
            if not fresh and self.detail is not None:
                before = self.detail if flow is None else warp_forward(self.detail, flow, self.size)
                far = np.abs(coarse - before) > ANALYZER.detail_dead_band
                coarse = before + np.where(far, np.float32(ANALYZER.detail_gain), 0) * (coarse - before)
            self.detail = np.asarray(coarse, np.float32)
            grid = (
                self.size if self.design is not None else tuple(-(-side // ANALYZER.detail_cell) for side in self.size)
            )
            return np.asarray(cv2.resize(self.detail, grid, interpolation=cv2.INTER_LINEAR), np.float32)

    def _attention(self, wanted: bool) -> tuple[Plane | None, Plane | None]:
        """Weights of places where strokes, and where the mean of paintings, follow changes fast; None = no such place.

        Small heads are in the first one alone: a mean of paintings that follows them as fast flickers.

        Returns: two grids over the frame, float32, 0..1.
        """
        heads, features = self.importance.small_heads(), self.importance.eyes_and_mouths()
        if not wanted or heads is None or features is None:
            return None, None
        return np.maximum(heads, features), features

    def _directions(
        self, picture: Frame, back: Flow | None, placed: RegionPlacement | None, default_deg: float
    ) -> OrientationField:
        """Orientation field, float32 (2, h', w'), of unit length, smoothed over space and time."""
        with self.clock("directions"):
            small = downscaled(picture, self.small)
            sigma = max(self.params.edge_smoothing * min(self.small) / 1000, ANALYZER.least_sigma)
            now = gradient_tensor(small.astype(np.float32), sigma)
            flow = None if back is None else _downscaled_flow(back, self.small)
            if flow is not None and self.tensors is not None:
                now = smooth_over_time(now, self.tensors, flow, self.params.edge_memory, self.faint)
            self.tensors = now
            near = edge_field(now, self.faint)
            wide = np.stack([blurred(plane, sigma * ANALYZER.broad_sigma) for plane in near])
            edges = np.asarray(near + np.float32(ANALYZER.broad_weight) * wide, np.float32)
            default = field_of(math.radians(default_deg), ANALYZER.default_weight)[:, None, None]
            field = _unit(edges + default)
            if flow is not None and self.field is not None:
                field = denoise_directions(field, self.field, flow, ANALYZER.direction_tolerance)
            self.field = field
            if placed is None or self.design is None:
                return field
            designed = self.design.directions(field * np.minimum(strength_of(edges), 1), placed)
            missing = np.maximum(np.float32(ANALYZER.default_weight) - strength_of(designed), 0)
            return _unit(designed + missing * field)

    def state(self) -> State:
        """State as arrays by name; an analyzer restored from it continues with the same bytes."""
        planes = {
            "gray": self.gray, "thumbnail": self.thumbnail, "tensors": self.tensors, "field": self.field,
            "detail": self.detail,
        }  # fmt: skip
        own: State = {"number": np.array(self.number)}
        own |= {name: array for name, array in planes.items() if array is not None}
        return own | flatten({name: getattr(self, name).state() for name in _PARTS})

    def restore(self, state: Arrays) -> None:
        self.number = int(state["number"])
        self.gray, self.thumbnail, self.tensors = (state.get(name) for name in ("gray", "thumbnail", "tensors"))
        self.detail, self.field = state.get("detail"), state.get("field")
        for name in _PARTS:
            getattr(self, name).restore(part(state, name))


_PARTS = ("importance", "denoiser", "strokes", "face_layer", "rims")


def _unit(field: OrientationField) -> OrientationField:
    return np.asarray(field / (np.sqrt(field[0] * field[0] + field[1] * field[1]) + np.float32(1e-3)), np.float32)


def _downscaled_flow(flow: Flow, size: tuple[int, int]) -> Flow:
    """The flow on a coarser grid, in px of that grid."""
    scale = np.float32(size[1] / flow.shape[0])
    return np.asarray(cv2.resize(flow, size, interpolation=cv2.INTER_AREA) * scale, np.float32)


def _coarse(back: Flow) -> Half:
    """Backward flow on a coarser grid; it is smooth, and is stored for every frame."""
    by = max(1, min(back.shape[:2]) // ANALYZER.back_cells)
    size = (max(1, back.shape[1] // by), max(1, back.shape[0] // by))
    return to_half(cv2.resize(back, size, interpolation=cv2.INTER_AREA))


def _importance(params: MultistyleParams) -> ImportanceParams:
    return ImportanceParams(
        face=params.face_detail, saliency=params.saliency_detail, motion=params.motion_detail,
        large_faces=ANALYZER.large_faces,
    )  # fmt: skip
