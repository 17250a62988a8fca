"""Fine strokes on small faces, and on eyes and brows of large ones, painted over all other layers.

Departure: kagaya2011video paints faces like everything else. The other layers are made from a picture at half of the
frame's size, and their finest strokes cover the eyes of a face 30 px wide. These strokes take their colours from the
frame at its full size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Arrays, State
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.kernels.float16 import to_half
from pipeline.methods.multistyle.analysis import StrokeLayer
from pipeline.methods.multistyle.stroke_layers import coloured_strokes
from pipeline.methods.multistyle.styles import STYLE_LIMITS, LayerStyle, profile_columns, profile_fields
from pipeline.perception.face_masks import face_crops, largeness, small_faces
from pipeline.perception.faces import Faces
from pipeline.strokes.random import Purpose, draws
from pipeline.strokes.seeds import StyleField, place, sample, sample_all
from pipeline.strokes.tracks import LifecycleParams, StrokeTracks, advect, start_tracks, update


@dataclass(frozen=True)
class FaceStrokes:
    """Constants of the fine strokes on faces."""

    layer: int = 15
    """Number of the layer in the ids of its strokes; the other layers have lower ones."""
    width_share: float = 1 / 36
    """Width of strokes as a fraction of the width of the face."""
    eye_width_share: float = 1 / 110
    """`width_share` at eyes and brows of large faces; elsewhere, large faces have no strokes of this layer."""
    length: float = 1.0
    """Length of strokes in their widths; longer ones would cross an eye."""
    overlap: float = 2.0
    """Mean number of strokes on a pixel."""
    whole_head_px: float = 32.0
    features_only_px: float = 56.0
    """Widths of a face, px: up to the first, the whole head has such strokes; from the second on, brows, eyes, nose and
    mouth alone, since they would turn the outline and the hair of a larger head into a photograph."""
    least_weight: float = 0.4
    kept_weight: float = 0.2
    """Weights of a face up to which no stroke is added, and up to which strokes are removed (hysteresis)."""
    cell_px: int = 4
    """Side, px, of the cells of the maps of weight and stroke width, which are smooth."""
    widest: float = 16.0
    """Stroke width outside faces, in multiples of the smallest."""
    jitter: float = 0.1
    """Colour jitter relative to that of the style. These strokes have neither relief nor bristles: light and dark
    at their sides would be as large as an eye."""
    unlimited: float = 442.0
    """Colour tolerance: these strokes are too short to cross a silhouette."""


FACE_STROKES = FaceStrokes()


class FaceLayer:
    """Tracks the fine strokes on the faces of consecutive frames.

    Args:
        size: (width, height) of the frames, px.
        lifecycle: of strokes.
    """

    def __init__(self, size: tuple[int, int], lifecycle: LifecycleParams, seed: int) -> None:
        self.size, self.lifecycle, self.seed = size, lifecycle, seed
        self.tracks: StrokeTracks | None = None

    def step(
        self, frame: Frame, faces: Faces, style: LayerStyle, forward: Flow | None, revealed: Mask | None,
        birth: int,
    ) -> StrokeLayer | None:  # fmt: skip
        """Strokes on the faces of the next frame; None = there are none.

        Args:
            frame: uint8 (h, w, 3), with the contrast of faces raised, see `face_contrast`.
            faces: all faces of the frame; a lower strength makes strokes fainter.
            forward: float32 (h', w', 2), flow from the previous frame, px of the frame; None = a shot begins.
            revealed: bool, a grid over the frame: newly visible pixels.
            birth: number of the frame that new strokes are made for.
        """
        if forward is None:
            self.tracks = None
        if not len(faces) and self.tracks is None:
            return None
        shape = frame.shape
        weight, width_px = _maps(faces, self.size)
        if self.tracks is None and weight.max() <= FACE_STROKES.least_weight:
            return None
        spacing = width_px * np.float32(((FACE_STROKES.length + 1) / FACE_STROKES.overlap) ** 0.5)
        candidates = place(shape, spacing, seed=self.seed, layer=FACE_STROKES.layer, birth=birth)
        candidates = candidates[sample(weight, candidates.xy, shape) > FACE_STROKES.least_weight]
        if self.tracks is None or forward is None:
            self.tracks = start_tracks(candidates, frame, spacing, self.lifecycle, shape)
        else:
            tracks = advect(self.tracks, forward, shape=shape)
            keep = sample(weight, tracks.seeds.xy, shape) > FACE_STROKES.kept_weight
            self.tracks = update(
                tracks, candidates, frame, spacing, params=self.lifecycle, wanted=keep, revealed=revealed, shape=shape
            )
        if not len(self.tracks):
            self.tracks = None
            return None
        return self._layer(self.tracks, style, weight, width_px)

    def _layer(self, tracks: StrokeTracks, style: LayerStyle, weight: Plane, width_px: Plane) -> StrokeLayer:
        """The strokes with their paint; `weight` and `width_px`: see `_maps`."""
        seeds, technique, brush = tracks.seeds, style.technique, style.brush
        given: dict[str, StyleField] = {
            name: getattr(brush, name) for name in ("opacity", "hue_deg", "saturation", "value")
        }
        given |= {
            "jitter": np.multiply(brush.jitter, np.float32(FACE_STROKES.jitter)),
            "weight": weight,
            "width": width_px,
        }
        given |= {name: technique[name] for name in ("vivid", "contrast", "order_mix")}
        given |= profile_fields(technique)
        own = dict(zip(given, sample_all(list(given.values()), seeds.xy, self.size[::-1]), strict=True))
        strokes = coloured_strokes(tracks, own, self.seed)
        strokes["radius_px"] = to_half(own["width"] / np.float32(2))
        strokes["length_px"] = to_half(own["width"] * np.float32(FACE_STROKES.length))
        strokes["opacity"] = to_half(own["opacity"] * own["weight"])
        variation = draws(seeds.ids, self.seed, Purpose.ORDER)[:, 1] - np.float32(0.5)
        strokes["rank"] = to_half(own["order_mix"] * variation)  # dark strokes on top would widen eyes
        strokes["tolerance"] = np.float16(FACE_STROKES.unlimited)
        return StrokeLayer(seeds.xy, seeds.ids, strokes, 0.0, profile_columns(technique, own))

    def state(self) -> State:
        return {} if self.tracks is None else self.tracks.state()

    def restore(self, state: Arrays) -> None:
        self.tracks = StrokeTracks.from_state(state) if state else None


def _maps(faces: Faces, size: tuple[int, int]) -> tuple[Plane, Plane]:
    """Weight of faces, 0..1, and width of strokes, px of the frame: two grids over the frame, float32.

    Outside faces the width is the largest that `place` distinguishes from the smallest one, so that few seeds are made.
    """
    grid = -(-size[0] // FACE_STROKES.cell_px), -(-size[1] // FACE_STROKES.cell_px)
    weight, width_px = (
        np.full(grid[::-1], value, np.float32) for value in (0, FACE_STROKES.widest * STYLE_LIMITS.smallest_px)
    )
    per_cell = size[0] / grid[0]
    for face in face_crops(faces, size, grid, largeness(faces, size)):
        fine = np.float32(max(face.width_px * per_cell * FACE_STROKES.eye_width_share, STYLE_LIMITS.smallest_px))
        own = face.eyes()
        width_px[face.box] = np.minimum(width_px[face.box], np.where(own > 0, fine, np.inf))
        weight[face.box] = np.maximum(weight[face.box], own)
    for face in small_faces(faces, size, grid):
        fine = np.float32(max(face.width_px * per_cell * FACE_STROKES.width_share, STYLE_LIMITS.smallest_px))
        large = (face.width_px * per_cell - FACE_STROKES.whole_head_px) / (
            FACE_STROKES.features_only_px - FACE_STROKES.whole_head_px
        )
        own = face.weight + np.float32(min(max(large, 0), 1)) * (face.features() - face.weight)
        width_px[face.box] = np.minimum(width_px[face.box], np.where(own > 0, fine, np.inf))
        weight[face.box] = np.maximum(weight[face.box], own)
    return weight, width_px
