"""Faces in the panorama of a patch, as weights of the strokes that are painted on them, and widths of the faces."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.methods.base import TaskContext
from pipeline.methods.patches.appearance import PanoramaRect, soft_mask
from pipeline.methods.patches.clustering import LabelMaps
from pipeline.methods.patches.face_strokes import FacePlanes
from pipeline.methods.patches.face_tracking import ShotFaces
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.patch_track import PatchTrack
from pipeline.methods.patches.scan import WorkingGrid
from pipeline.warp.panorama import Placement, full_map, gather

Weights = NDArray[np.uint8]
"""uint8 (h, w, 2), 0..255: weights 0..1 of the pixels of a panorama, and widths of the faces in `WIDTH_STEPS`."""

EVERY_FRAMES = 4
"""Interval of the frames of a patch whose faces are added to the panorama; neighbouring frames show the same faces."""
WIDTH_STEPS = 16.0
"""Steps of an octave in which widths of faces are stored: width = 2^(value / steps), px."""
_WIDTHS_PX = np.array([2.0 ** (k / WIDTH_STEPS) for k in range(256)], np.float32)
GAIN = 1.5
"""Factor on the mean weight: a face that is tracked in two thirds of the frames has full weight."""
FILL_SIGMA_PX = 1.0
"""Sigma of the Gaussian that closes the gaps between the pixels of a stretched frame, px."""


def panorama_weights(
    track: PatchTrack, placements: dict[int, Placement], maps: LabelMaps, rect: PanoramaRect,
    context: TaskContext[PatchesParams],
) -> Weights | None:  # fmt: skip
    """Faces in the panorama of a patch; None = no faces.

    Widths are means over the frames in which a pixel of the patch belongs to a face, weights are `GAIN` times the mean.
    """
    read, grid = ShotFaces(context, track.begin), WorkingGrid.of(context.size)
    total = None
    for index in sorted(placements)[::EVERY_FRAMES]:
        planes = read(index)
        if planes is None:
            continue
        (left, top, right, bottom), x, y = full_map(placements[index], grid.ratio, context.size, rect.origin)
        inside = soft_mask(maps.require(index) == track.label, grid)[top:bottom, left:right]
        faces = planes.within((slice(top, bottom), slice(left, right)))
        share = np.ascontiguousarray(inside * (faces.weight > 0) * (faces.width_px > 0))
        if not share.any():
            continue
        total = rect.zeros() if total is None else total
        gather(total, _coded(faces), share, x, y)
    if total is None:
        return None
    smooth = cv2.GaussianBlur(total, (0, 0), FILL_SIGMA_PX)
    mean = smooth[..., :2] / np.maximum(smooth[..., 3:], np.float32(1e-3)) * np.array([GAIN, 1], np.float32)
    most = np.array([context.params.face_detail * 255, 255], np.float32)
    return np.rint(np.clip(mean, 0, most)).astype(np.uint8)


def _coded(faces: FacePlanes) -> Frame:
    """Weights and widths as a picture, uint8 (h, w, 3); the third channel is 0."""
    width = np.minimum(np.searchsorted(_WIDTHS_PX, faces.width_px), len(_WIDTHS_PX) - 1)
    return np.dstack([np.rint(faces.weight * np.float32(255)), width, np.zeros_like(width)]).astype(np.uint8)


def save_weights(context: TaskContext[PatchesParams], track: PatchTrack, weights: Weights | None) -> None:
    """Save the result of `panorama_weights` for other tasks of the patch."""
    context.save(_artefact(track), {} if weights is None else {"weights": weights})


def load_weights(context: TaskContext[PatchesParams], track: PatchTrack) -> Weights | None:
    """Load what `save_weights` saved."""
    return context.load("patch", _artefact(track)).get("weights")


def as_planes(weights: Weights | None) -> FacePlanes | None:
    """The faces in the painter's form."""
    if weights is None:
        return None
    return FacePlanes(np.asarray(weights[..., 0] / np.float32(255), np.float32), _WIDTHS_PX[weights[..., 1]])


def _artefact(track: PatchTrack) -> str:
    return f"{track.key}-faces"
