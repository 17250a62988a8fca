"""Motion of shapes between two frames as affine maps, so that an editor can move a shape instead of drawing it anew.

Source: zhang2011online, section 7: correspondence between frames as transformations of coherent regions.
"""

from __future__ import annotations

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Labels
from pipeline.vector.outlines import Outlines

Transforms: TypeAlias = NDArray[np.float64]
"""float64 (n, 2, 3): each maps (x, y, 1) in px of the previous frame to this frame; NaN: there is none."""
RIGID_PX = 3.0
"""Root mean square distance from its middle, px, of a shape that turns and stretches half as much as its pixels say;
smaller and thinner ones less, larger ones more: errors of the flow would shear small shapes."""


def region_transforms(labels: Labels, before: Labels, previous: NDArray[np.int32], flow: Flow) -> Transforms:
    """The map of each region by label, (regions + 1), in px of the label map; NaN for a region that is new.

    Args:
        labels, before: int32 (h, w), regions of this frame and of the previous one.
        previous: int32 (regions + 1,), label of each region in the previous frame; 0: it is new.
        flow: float32 (h, w, 2), at a pixel of this frame, its motion since the previous one, px.
    """
    height, width = labels.shape
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    x0, y0 = x - flow[..., 0], y - flow[..., 1]
    column, row = np.rint(x0).astype(np.intp), np.rint(y0).astype(np.intp)
    inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
    origin = before[row.clip(0, height - 1), column.clip(0, width - 1)]
    kept = inside & (origin == previous[labels]) & (origin > 0)
    ends = np.column_stack([x[kept], y[kept]]) + 0.5
    return _fitted(np.column_stack([x0[kept], y0[kept]]) + 0.5, ends, labels[kept], len(previous))


def outline_transforms(outlines: Outlines, flow: Flow, scale: tuple[float, float]) -> Transforms:
    """The map of each arc, in px of the outlines.

    Args:
        flow: as for `region_transforms`.
        scale: px of the outlines for one px of the flow, across and down.
    """
    if not len(outlines.points):
        return np.empty((0, 2, 3))
    x, y = (outlines.points / scale - 0.5).astype(np.float32).T
    moved = np.column_stack([
        np.asarray(cv2.remap(np.ascontiguousarray(flow[..., k]), x, y, cv2.INTER_LINEAR,
                             borderMode=cv2.BORDER_REPLICATE)).ravel()
        for k in (0, 1)
    ])  # fmt: skip
    owner = np.repeat(np.arange(len(outlines.starts) - 1), np.diff(outlines.starts))
    return _fitted(outlines.points - moved * scale, outlines.points, owner, len(outlines.starts) - 1)


def scaled(transforms: Transforms, scale: tuple[float, float]) -> Transforms:
    """The maps in px of a picture that is `scale` times as large, across and down."""
    by = np.array(scale)
    return np.concatenate([transforms[..., :2] * by[:, None] / by, transforms[..., 2:] * by[:, None]], axis=2)


def _fitted(
    starts: NDArray[np.float64], ends: NDArray[np.float64], owner: NDArray[np.integer], count: int
) -> Transforms:  # fmt: skip
    """The affine map of each owner's points with the least squared distances, see `RIGID_PX`."""

    def sums(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.bincount(owner, values, count).astype(np.float64)

    number = np.bincount(owner, minlength=count).astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle0, middle1 = (
            np.column_stack([sums(points[:, k]) for k in (0, 1)]) / number[:, None] for points in (starts, ends)
        )
    from0, from1 = starts - middle0[owner], ends - middle1[owner]
    rigid = number[:, None, None] * RIGID_PX**2 * np.eye(2)
    across = np.stack([[sums(from1[:, i] * from0[:, j]) for j in (0, 1)] for i in (0, 1)]).transpose(2, 0, 1) + rigid
    spread = np.stack([[sums(from0[:, i] * from0[:, j]) for j in (0, 1)] for i in (0, 1)]).transpose(2, 0, 1) + rigid
    out = np.full((count, 2, 3), np.nan)
    there = number > 0
    out[there, :, :2] = across[there] @ np.linalg.inv(spread[there])
    out[there, :, 2] = middle1[there] - np.einsum("nij,nj->ni", out[there, :, :2], middle0[there])
    return out
