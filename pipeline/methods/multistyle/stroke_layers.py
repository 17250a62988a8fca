"""Stroke tracks of all layers of a frame, and their paint."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray, Arrays, State, flatten, part
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.kernels.executors import INLINE, FrameExecutor
from pipeline.kernels.float16 import to_half
from pipeline.kernels.jit import kernel
from pipeline.methods.multistyle.analysis import STROKE, StrokeLayer
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.styles import (
    STYLE_LIMITS,
    LayerStyle,
    face_weight,
    pigment,
    profile_columns,
    profile_fields,
)
from pipeline.perception.flow.reliability import inside
from pipeline.perception.flow.warp import warp_back
from pipeline.strokes.brush import Brush, shifted
from pipeline.strokes.layers import LayerScheme, area_error, layer_brush, spacing_px, threshold_of
from pipeline.strokes.random import Purpose, draws
from pipeline.strokes.seeds import Seeds, StyleField, place, sample_all
from pipeline.strokes.tracks import LifecycleParams, StrokeTracks, advect, start_tracks, update


@dataclass(frozen=True)
class LayerParams:
    """Constants of the layers of strokes."""

    edge_fall: float = 0.85
    edge_detail_fall: float = 0.5
    edge_face_fall: float = 0.5
    """Factor on the colour tolerance for each finer layer; relative decrease of the tolerance at full detail, and a
    further one in the middle of a face."""
    gap: float = 0.6
    """Smallest distance of a new stroke from any other, in spacings."""
    least_break_off: float = 45.0
    """Lower bound, RGB distance, of the colour change above which a stroke is removed."""
    least_blur_px: float = 0.3
    """Sigma below which a blur is skipped, px."""
    error_memory: float = 0.8
    """Weight of the past, along the motion, in the error that calls for finer strokes; 0 on newly visible surfaces."""
    median_rows: int = 60
    """Approximate number of rows from which the median of a plane is computed."""
    keep: float = 0.6
    """Factor on the error threshold for existing strokes (hysteresis)."""


LAYERS = LayerParams()


_BRUSH_FIELDS = tuple(field.name for field in fields(Brush))


@dataclass(frozen=True)
class FrameMotion:
    """Motion of a frame relative to the previous one.

    Attributes:
        forward: float32 (h', w', 2), from the previous frame to this one, px of the frame.
        back: float32 (h', w', 2), from this frame to the previous one, px of the working size.
        changed: bool (h', w'), pixels that show another surface than before; None = unknown.
    """

    forward: Flow
    back: Flow
    changed: Mask | None


@dataclass(frozen=True)
class _LayerJob:
    """Inputs of the update of one layer."""

    index: int
    brush: Brush
    reference: Frame
    error: Plane | None


class StrokeLayers:
    """Updates the stroke tracks of all layers from frame to frame.

    Args:
        size: (width, height) of the frames; work: of the denoised picture, px.
    """

    def __init__(self, params: MultistyleParams, size: tuple[int, int], work: tuple[int, int], seed: int) -> None:
        self.params, self.size, self.work, self.seed = params, size, work, seed
        self.lifecycle = LifecycleParams(gap=LAYERS.gap, fade=params.stroke_fade, follow=params.colour_follow)
        self.tracks: list[StrokeTracks] = []
        self.errors: list[Plane] = []

    def step(
        self, picture: Frame, style: LayerStyle, motion: FrameMotion | None, detail: Plane | None, number: int,
        background: FrameExecutor = INLINE,
    ) -> tuple[StrokeLayer, ...]:  # fmt: skip
        """Strokes of the next frame, coarse to fine.

        Args:
            picture: uint8 (h', w', 3), the denoised picture.
            motion: None = a shot begins.
            detail: float32 in 0..1, a grid over the frame; None = 0.
            number: of the frame; a part of the ids of new strokes.
            background: may take layers, which do not depend on each other.
        """
        if motion is None:
            self.tracks, self.errors = [], []
        scheme = scheme_of(style)
        scale = self.work[1] / self.size[1]
        revealed = None if motion is None else self.revealed(motion)
        count = layer_count(style)
        brushes = [layer_brush(style.brush, style.technique["layer_ratio"], index) for index in range(count)]
        widths = [median(brush.size_px) * scale for brush in brushes]

        def layer(index: int) -> tuple[StrokeTracks, Plane | None, StrokeLayer]:
            error = self._error(index, picture, widths[index - 1], motion) if index else None
            sigma = scheme.blur * widths[index] / 2
            reference = np.asarray(blurred(picture, sigma), np.uint8) if sigma > LAYERS.least_blur_px else picture
            job = _LayerJob(index, brushes[index], reference, error)
            updated = self._update(job, style, scheme, motion, revealed, number)
            strokes = self._layer(updated, job, style, sigma if sigma > LAYERS.least_blur_px else 0.0, detail)
            return updated, error, strokes

        coarse = [background.submit_parallel(partial(layer, index)) for index in range(count - 1)]
        finest = layer(count - 1)
        tracks, errors, layers = zip(*(each.result() for each in coarse), finest, strict=True)
        self.tracks = list(tracks)
        self.errors = [*(error for error in errors if error is not None), *self.errors[count - 1 :]]
        return layers

    def _update(
        self, job: _LayerJob, style: LayerStyle, scheme: LayerScheme, motion: FrameMotion | None,
        revealed: Mask | None, number: int,
    ) -> StrokeTracks:  # fmt: skip
        """Tracks of one layer in this frame."""
        shape, spacing = self.size[::-1], spacing_px(job.brush, scheme)
        birth = 0 if self.params.temporal == "off" else number
        candidates = place(shape, spacing, jitter=scheme.scatter, seed=self.seed, layer=job.index, birth=birth)
        if job.error is not None:
            candidates = candidates[self._exceeds(candidates, job, style, 1)]
        if motion is None or len(self.tracks) <= job.index:
            return start_tracks(candidates, job.reference, spacing, self.lifecycle, shape)
        tracks = advect(self.tracks[job.index], motion.forward, shape=shape)
        keep = None if job.error is None else self._exceeds(tracks.seeds, job, style, LAYERS.keep)
        break_off = max(median(style.technique["edge"]) * LAYERS.edge_fall**job.index, LAYERS.least_break_off)
        params = replace(self.lifecycle, break_off=break_off)
        return update(
            tracks, candidates, job.reference, spacing, params=params, wanted=keep, revealed=revealed, shape=shape
        )

    def revealed(self, motion: FrameMotion) -> Mask:
        """Newly visible pixels, bool (h', w'); strokes appear at once there."""
        outside = ~inside(motion.back)
        return outside if motion.changed is None else outside | motion.changed

    def _exceeds(self, seeds: Seeds, job: _LayerJob, style: LayerStyle, factor: float) -> NDArray[np.bool_]:
        """Flags of the seeds whose area error exceeds the layer's threshold times `factor`."""
        assert job.error is not None
        given = (style.layers, style.threshold, job.brush.size_px)
        layers, threshold, size_px = sample_all(given, seeds.xy, self.size[::-1])
        threshold = threshold_of(layers, threshold, job.index)
        scale = np.float32(self.work[1] / self.size[1])
        found = area_error(job.error, seeds.xy * scale, size_px * scale)
        return np.asarray(found > threshold * np.float32(factor), np.bool_)

    def _error(self, index: int, picture: Frame, width_px: float, motion: FrameMotion | None) -> Plane:
        """Error that the layer below leaves, RGB distance, float32 (h', w'), smoothed over time.

        Args:
            width_px: median width of the strokes of the layer below, px of the picture.

        Departure: hertzmann1998painterly compares the picture with the canvas. Here it is compared with its own blur by
        the stroke size of the layer below. The blur does not depend on single strokes, so the error does not flicker
        with them, and a frame can be analysed without painting it.
        """
        now = np.empty(picture.shape[:2], np.float32)
        below = np.asarray(blurred(picture, max(width_px / 2, 0.5)), np.uint8)
        if motion is not None and len(self.errors) >= index:
            changed = np.zeros(now.shape, np.bool_) if motion.changed is None else motion.changed
            _distance(
                picture,
                below,
                warp_back(self.errors[index - 1], motion.back),
                np.float32(LAYERS.error_memory),
                changed,
                now,
            )
        else:
            _distance(picture, below, now, np.float32(0), np.ones(now.shape, np.bool_), now)
        return now

    def _layer(
        self, tracks: StrokeTracks, job: _LayerJob, style: LayerStyle, sigma_px: float, detail: Plane | None
    ) -> StrokeLayer:
        """The layer's strokes with their paint."""
        seeds, technique = tracks.seeds, style.technique
        given: dict[str, StyleField] = {name: getattr(job.brush, name) for name in _BRUSH_FIELDS}
        given |= {name: technique[name] for name in ("vivid", "contrast", "order_mix")}
        given["tolerance"] = np.multiply(technique["edge"], LAYERS.edge_fall**job.index)
        given |= {} if detail is None else {"detail": detail}
        given |= profile_fields(technique)
        own = dict(zip(given, sample_all(list(given.values()), seeds.xy, self.size[::-1]), strict=True))
        strokes = coloured_strokes(tracks, own, self.seed)
        strokes["radius_px"] = to_half(own["size_px"] / np.float32(2))
        for name in ("opacity", "relief_px", "grain", "length_px"):
            strokes[name] = to_half(own[name])
        variation = draws(seeds.ids, self.seed, Purpose.ORDER)[:, 1] - np.float32(0.5)
        strokes["rank"] = to_half(np.sqrt((tracks.initial * tracks.initial).sum(axis=1)) + own["order_mix"] * variation)
        strict = 0.0 if detail is None else own["detail"] * np.float32(LAYERS.edge_detail_fall)
        strokes["tolerance"] = to_half(own["tolerance"] * (1 - strict))
        if detail is not None and (face := face_weight(own["detail"])) is not None:
            strokes["tolerance"] *= 1 - face * np.float32(LAYERS.edge_face_fall)
        return StrokeLayer(seeds.xy, seeds.ids, strokes, sigma_px, profile_columns(technique, own))

    def state(self) -> State:
        """State as arrays by name."""
        tracks = {f"tracks{k}": own.state() for k, own in enumerate(self.tracks)}
        return flatten(tracks | {"errors": {str(k): error for k, error in enumerate(self.errors)}})

    def restore(self, state: Arrays) -> None:
        errors = part(state, "errors")
        self.errors = [errors[str(k)] for k in range(len(errors))]
        count = sum(name.startswith("tracks") and name.endswith(".xy") for name in state)
        self.tracks = [StrokeTracks.from_state(part(state, f"tracks{k}")) for k in range(count)]


@kernel
def _distance(picture: Frame, below: Frame, past: Plane, memory: np.float32, changed: Mask, out: Plane) -> None:
    """Fill `out` with the RGB distance of two pictures; where nothing has changed, averaged with `past` by `memory`."""
    height, width = out.shape
    for y in range(height):
        for x in range(width):
            r = np.int32(picture[y, x, 0]) - np.int32(below[y, x, 0])
            g = np.int32(picture[y, x, 1]) - np.int32(below[y, x, 1])
            b = np.int32(picture[y, x, 2]) - np.int32(below[y, x, 2])
            now = np.sqrt(np.float32(r * r + g * g + b * b))
            out[y, x] = now if changed[y, x] else now + memory * (past[y, x] - now)


def coloured_strokes(tracks: StrokeTracks, own: Mapping[str, NDArray[np.float32]], seed: int) -> AnyArray:
    """STROKE (n,) with the paint, target colour and presence of tracks; the other fields are 0.

    Args:
        own: values at the seeds, float32 (n,): vivid, contrast, hue_deg, saturation, value, jitter.
    """
    strokes = np.zeros(len(tracks), STROKE)
    paint = pigment(tracks.targets, own["vivid"], own["contrast"])
    shifts = [own[name] for name in ("hue_deg", "saturation", "value", "jitter")]
    strokes["colour"] = to_half(np.clip(shifted(paint, tracks.seeds.ids, shifts, seed), 0, 255))
    strokes["target"] = to_half(tracks.targets)
    strokes["presence"] = to_half(tracks.presence)
    return strokes


def median(field: StyleField) -> float:
    """Approximate median of a style parameter, from about `LAYERS.median_rows` rows and from columns as far apart."""
    plane = np.asarray(field, np.float32)
    step = max(1, plane.shape[0] // LAYERS.median_rows) if plane.ndim else 1
    return float(np.median(plane[::step, ::step])) if plane.ndim else float(plane)


def scheme_of(style: LayerStyle) -> LayerScheme:
    """Layer scheme of a style; overlap may vary, the rest is uniform."""
    technique = style.technique
    ratio, scatter = median(technique["layer_ratio"]), median(technique["scatter"])
    return LayerScheme(most=4, ratio=ratio, overlap=technique["overlap"], scatter=scatter)


def layer_count(style: LayerStyle) -> int:
    """Number of layers that any pixel requests and whose strokes are wide enough to be visible."""
    most = round(float(np.max(style.layers)) + 1e-6)
    ratio = float(np.max(style.technique["layer_ratio"]))
    fit = int(math.log(max(style.widest_px / STYLE_LIMITS.smallest_px, 1)) / -math.log(ratio))
    return max(1, min(most, 4, 1 + fit))


def blurred(image: AnyArray, sigma_px: float) -> AnyArray:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px))
