"""Faces in the panorama of a patch, as weights of the fine strokes that are painted on them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.methods.base import TaskContext
from pipeline.methods.patches.appearance import PanoramaRect, soft_mask
from pipeline.methods.patches.clustering import LabelMaps
from pipeline.methods.patches.face_tracking import FaceWeights
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.patch_track import PatchTrack
from pipeline.methods.patches.scan import WorkingGrid
from pipeline.warp.panorama import Placement, full_map, gather

Weights = NDArray[np.uint8]
"""uint8 (h, w), 0..255: weights 0..1 of the pixels of a panorama."""

EVERY_FRAMES = 4
"""Every so many frames of a patch add their faces to the panorama: neighbouring frames show the same ones."""
FILL_SIGMA_PX = 1.0
"""Sigma of the Gaussian that closes the gaps between the pixels of a stretched frame, px."""


def panorama_weights(
    track: PatchTrack, placements: dict[int, Placement], maps: LabelMaps, rect: PanoramaRect,
    context: TaskContext[PatchesParams],
) -> Weights | None:  # fmt: skip
    """Weight of the fine strokes in the panorama of a patch; None = 0 everywhere.

    It is the mean over the frames in which a pixel of the patch belongs to a face.
    """
    read, grid = FaceWeights(context, track.begin), WorkingGrid.of(context.size)
    total = None
    for index in sorted(placements)[::EVERY_FRAMES]:
        weights = read(index)
        if weights is None:
            continue
        (left, top, right, bottom), x, y = full_map(placements[index], grid.ratio, context.size, rect.origin)
        inside = soft_mask(maps.require(index) == track.label, grid)[top:bottom, left:right]
        faces = weights[top:bottom, left:right]
        share = np.ascontiguousarray(inside * (faces > 0))
        if not share.any():
            continue
        total = rect.zeros() if total is None else total
        gather(total, np.repeat(np.rint(faces * np.float32(255)).astype(np.uint8)[..., None], 3, axis=2), share, x, y)
    if total is None:
        return None
    summed, count = (
        cv2.GaussianBlur(np.ascontiguousarray(total[..., channel]), (0, 0), FILL_SIGMA_PX) for channel in (0, 3)
    )
    return np.rint(np.clip(summed / np.maximum(count, np.float32(1e-3)), 0, 255)).astype(np.uint8)


def save_weights(context: TaskContext[PatchesParams], track: PatchTrack, weights: Weights | None) -> None:
    """Save the result of `panorama_weights` for other tasks of the patch."""
    context.save(_artefact(track), {} if weights is None else {"weights": weights})


def load_weights(context: TaskContext[PatchesParams], track: PatchTrack) -> Weights | None:
    """Load what `save_weights` saved."""
    return context.load("patch", _artefact(track)).get("weights")


def as_plane(weights: Weights | None) -> Plane | None:
    """The weights as the painter takes them, float32 (h, w), 0..1."""
    return None if weights is None else np.asarray(weights / np.float32(255), np.float32)


def _artefact(track: PatchTrack) -> str:
    return f"{track.key}-faces"
