"""Label maps carried from a keyframe to the frames around it: along the motion, held to the picture's colours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.flow import estimate
from pipeline.flow.reliability import visible
from pipeline.flow.warp import positions
from pipeline.frames import Frame, Mask

Map = NDArray[np.uint8]
"""Number of the region that each pixel is in, `uint8` (height, width)."""

SHARPEN = 1.4
"""Each step is bilinear and blurs a border; this keeps it about two pixels wide, and its place between pixels."""
BAND_PX = 2
"""Pixels this near to a border are judged by their colour."""
AROUND = 0.045
"""Side of the window whose mean colour stands for a region there, as part of the frame's diagonal."""
MARGIN = 40.0
"""How much nearer another region's colour must be for a pixel to change over, 8-bit Lab units. On 12 frames of a swan
before foliage from one key, the overlap with a person's masks ends at 0.89; at 0.81 with 6, at 0.84 without."""


class Carrier:
    """One label map on its way, in either direction of time."""

    def __init__(self) -> None:
        self.frame: Frame | None = None
        self.names: NDArray[np.uint8] = np.zeros(0, np.uint8)
        self.planes: NDArray[np.uint8] = np.zeros((0, 1, 1), np.uint8)

    def step(self, frame: Frame, key: Map | None) -> Map | None:
        """The map of the next frame (or the one before, if frames come backwards); None until there was a key.

        Args:
            frame: uint8 (h, w, 3).
            key: the frame's own map, which overrides what was carried.
        """
        if key is not None:
            self.names = np.unique(key)
            self.planes = np.stack([np.where(key == name, 255, 0).astype(np.uint8) for name in self.names])
        elif len(self.names) > 1 and self.frame is not None:
            self._carry(self.frame, frame)
        self.frame = frame
        return self.labels if len(self.names) else None

    @property
    def labels(self) -> Map:
        return np.asarray(self.names[self.planes.argmax(axis=0)], np.uint8)

    def _carry(self, before: Frame, now: Frame) -> None:
        back = estimate(now, before, "dis-medium")
        seen = visible(back, estimate(before, now, "dis-medium"))
        x, y = positions(back)
        moved = np.stack([
            cv2.remap(plane, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for plane in self.planes
        ])  # fmt: skip
        sharp = (moved.astype(np.float32) - 127.5) * np.float32(SHARPEN) + 127.5
        self.planes = np.clip(np.rint(sharp), 0, 255).astype(np.uint8)
        self._correct(now, seen)

    def _correct(self, frame: Frame, seen: Mask) -> None:
        """Pixels at borders, and those that have just come into view, go to the region whose colour they have."""
        labels = self.planes.argmax(axis=0).astype(np.uint8)
        doubtful = _borders(labels) | ~seen
        lab = cv2.cvtColor(frame, cv2.COLOR_RGB2LAB).astype(np.float32)
        side = max(5, round(AROUND * float(np.hypot(*labels.shape)))) | 1
        apart = np.stack([_distance(lab, (labels == k) & ~doubtful, side) for k in range(len(self.names))])
        own = np.take_along_axis(apart, labels[None].astype(np.intp), axis=0)[0]
        best = apart.argmin(axis=0)
        change = doubtful & (apart.min(axis=0) + np.float32(MARGIN) < own)
        fixed = np.where(change, best, labels).astype(np.uint8)
        smooth = np.asarray(cv2.medianBlur(fixed, 5), np.uint8)
        moved = smooth != labels
        for k, plane in enumerate(self.planes):
            plane[moved] = np.where(smooth[moved] == k, 255, 0)

    def state(self) -> dict[str, NDArray[Any]]:
        if self.frame is None:
            return {}
        return {"frame": self.frame, "names": self.names, "planes": self.planes}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        if "frame" in state:
            self.frame, self.names, self.planes = state["frame"], state["names"], state["planes"].copy()


def _borders(labels: Map) -> Mask:
    """Within BAND_PX of another label."""
    kernel = np.ones((2 * BAND_PX + 1, 2 * BAND_PX + 1), np.uint8)
    return np.asarray(cv2.dilate(labels, kernel) != cv2.erode(labels, kernel), np.bool_)


def _distance(lab: NDArray[np.float32], inside: Mask, side: int) -> NDArray[np.float32]:
    """Distance of each pixel's colour to the mean of those inside and near it; infinite where none is near."""
    weight = cv2.boxFilter(inside.astype(np.float32), -1, (side, side), borderType=cv2.BORDER_CONSTANT)
    mean = cv2.boxFilter(lab * inside[..., None].astype(np.float32), -1, (side, side), borderType=cv2.BORDER_CONSTANT)
    apart = lab - mean / np.maximum(weight, np.float32(1e-6))[..., None]
    away = np.sqrt((apart * apart).sum(axis=-1))
    return np.asarray(np.where(weight > np.float32(0.01), away, np.float32(1e4)), np.float32)
