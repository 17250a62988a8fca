"""Label propagation: region maps of keyframes, advected to the frames around them and corrected by colour."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.frames import Frame, Mask
from pipeline.methods.given_motion import NO_MOTION, GivenMotion
from pipeline.perception.flow import estimate
from pipeline.perception.flow.reliability import visible
from pipeline.perception.flow.warp import positions

RegionMap = NDArray[np.uint8]
"""Region number of each pixel, `uint8` (height, width)."""


@dataclass(frozen=True)
class LabelParams:
    """Constants of the propagation of labels."""

    sharpen: float = 1.4
    """Contrast factor after each bilinear step, which keeps borders about two pixels wide at subpixel positions."""
    band_px: int = 2
    """Distance to a border, px, within which pixels are reassigned by colour."""
    around: float = 0.045
    """Side of the window for a region's local mean colour, as a fraction of the frame's diagonal."""
    margin: float = 40.0
    """Least difference of colour distances, 8-bit Lab units, for a pixel to change its region. Over 12 frames of a
    swan in front of foliage from one key, the overlap with masks drawn by a person ends at 0.89 (0.81 with a margin
    of 6, 0.84 without reassignment)."""


LABELS = LabelParams()


class LabelPropagator:
    """Propagates one label map, forwards or backwards in time, along given motion or an estimated one."""

    def __init__(self, motion: GivenMotion = NO_MOTION) -> None:
        self.motion = motion
        self.frame: Frame | None = None
        self.names: NDArray[np.uint8] = np.zeros(0, np.uint8)
        self.planes: NDArray[np.uint8] = np.zeros((0, 1, 1), np.uint8)

    def step(
        self, frame: Frame, key: RegionMap | None, number: int, before: int, over: bool = False
    ) -> RegionMap | None:
        """Return the map of the next frame in order; None before the first key.

        Args:
            number, before: numbers of this frame and of the one that `step` had before.
            frame: uint8 (h, w, 3).
            key: the frame's own map, which replaces the propagated one.
            over: where `key` is 0, the propagated map stays.
        """
        if key is not None and over and len(self.names) > 1 and self.frame is not None:
            self._advect(self.frame, frame, number, before)
            key = np.where(key == 0, self.labels, key).astype(np.uint8)
        if key is not None:
            self.names = np.unique(key)
            self.planes = np.stack([np.where(key == name, 255, 0).astype(np.uint8) for name in self.names])
        elif len(self.names) > 1 and self.frame is not None:
            self._advect(self.frame, frame, number, before)
        self.frame = frame
        return self.labels if len(self.names) else None

    @property
    def labels(self) -> RegionMap:
        return np.asarray(self.names[self.planes.argmax(axis=0)], np.uint8)

    def _advect(self, before: Frame, now: Frame, number: int, earlier: int) -> None:
        size = now.shape[1], now.shape[0]
        back, forth = self.motion.flow(number, earlier, size), self.motion.flow(earlier, number, size)
        if back is None or forth is None:
            back, forth = estimate(now, before, "dis-medium"), estimate(before, now, "dis-medium")
        visible_before = visible(back, forth)
        x, y = positions(back)
        moved = np.stack([
            cv2.remap(plane, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for plane in self.planes
        ])  # fmt: skip
        sharp = (moved.astype(np.float32) - 127.5) * np.float32(LABELS.sharpen) + 127.5
        self.planes = np.clip(np.rint(sharp), 0, 255).astype(np.uint8)
        self._correct(now, visible_before)

    def _correct(self, frame: Frame, visible_before: Mask) -> None:
        """Reassign pixels at borders, and newly visible pixels, to the region of the most similar local colour."""
        labels = self.planes.argmax(axis=0).astype(np.uint8)
        doubtful = _borders(labels) | ~visible_before
        lab = cv2.cvtColor(frame, cv2.COLOR_RGB2LAB).astype(np.float32)
        side = max(5, round(LABELS.around * float(np.hypot(*labels.shape)))) | 1
        apart = np.stack([_distance(lab, (labels == k) & ~doubtful, side) for k in range(len(self.names))])
        own = np.take_along_axis(apart, labels[None].astype(np.intp), axis=0)[0]
        best = apart.argmin(axis=0)
        change = doubtful & (apart.min(axis=0) + np.float32(LABELS.margin) < own)
        fixed = np.where(change, best, labels).astype(np.uint8)
        smooth = np.asarray(cv2.medianBlur(fixed, 5), np.uint8)
        moved = smooth != labels
        for k, plane in enumerate(self.planes):
            plane[moved] = np.where(smooth[moved] == k, 255, 0)

    def state(self) -> State:
        if self.frame is None:
            return {}
        return {"frame": self.frame, "names": self.names, "planes": self.planes}

    def restore(self, state: Arrays) -> None:
        if "frame" in state:
            self.frame, self.names, self.planes = state["frame"], state["names"], state["planes"].copy()


def _borders(labels: RegionMap) -> Mask:
    """Flags of pixels within LABELS.band_px of another label."""
    kernel = np.ones((2 * LABELS.band_px + 1, 2 * LABELS.band_px + 1), np.uint8)
    return np.asarray(cv2.dilate(labels, kernel) != cv2.erode(labels, kernel), np.bool_)


def _distance(lab: NDArray[np.float32], inside: Mask, side: int) -> NDArray[np.float32]:
    """Lab distance of each pixel to the local mean colour of `inside`; 1e4 where the window has no such pixel."""
    weight = cv2.boxFilter(inside.astype(np.float32), -1, (side, side), borderType=cv2.BORDER_CONSTANT)
    mean = cv2.boxFilter(lab * inside[..., None].astype(np.float32), -1, (side, side), borderType=cv2.BORDER_CONSTANT)
    apart = lab - mean / np.maximum(weight, np.float32(1e-6))[..., None]
    away = np.sqrt((apart * apart).sum(axis=-1))
    return np.asarray(np.where(weight > np.float32(0.01), away, np.float32(1e4)), np.float32)
