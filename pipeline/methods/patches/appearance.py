"""Appearance of a patch over time: colour sums of short spans of frames, and periods of similar appearance."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Mask, Plane
from pipeline.kernels.float16 import to_half, to_single
from pipeline.kernels.jit import kernel
from pipeline.methods.base import TaskContext
from pipeline.methods.patches.clustering import LabelMaps
from pipeline.methods.patches.paint_error import error_tolerance, fine_sigma_px
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.patch_track import PatchTrack
from pipeline.methods.patches.scan import WorkingGrid
from pipeline.methods.patches.window_flow import vector_norm
from pipeline.warp.panorama import Placement, full_map, gather, mean

MAX_PANORAMA = 16.0
"""Largest area of a panorama, in frame areas. Positions outside it sample the paint at its border."""
SPAN_FRAMES = 8
"""Number of frames whose mean colour is compared with the current period."""
CHANGED_FRACTION = 0.015
"""Fraction of a patch's pixels that must change for a new period to begin."""
MARGIN_WEIGHT = 0.02
"""Weight of pixels in the margin outside the cluster; pixels inside have weight 1."""
FILL_WEIGHT = 1e-3
"""Weight of all frames of the patch in the picture of a period; they fill the pixels that the period lacks."""
UNCHANGED_MISFIT = 0.25
"""Misfit up to which a period uses the mean of all frames; from twice this value on it uses its own mean."""
Total = NDArray[np.float32]
"""float32 (h, w, 4): sums of red, green, blue times weight, and of weights."""


@dataclass(frozen=True)
class PanoramaRect:
    """Rectangle of a panorama in the coordinates of the master frame.

    Attributes:
        origin: (x, y) of the top left pixel, px.
        size: (width, height), px.
    """

    origin: tuple[int, int]
    size: tuple[int, int]

    @classmethod
    def around(cls, placements: dict[int, Placement], grid: WorkingGrid) -> PanoramaRect:
        """Bounding rectangle of all frames of the patch, limited to `MAX_PANORAMA` frame areas."""
        ends = []
        for placement in placements.values():
            positions = placement.positions()[::4, ::4].reshape(-1, 2)
            ends.append((positions.min(axis=0), positions.max(axis=0)))
        low = np.min([a for a, _ in ends], axis=0) * grid.ratio - 4
        high = np.max([b for _, b in ends], axis=0) * grid.ratio + 4 + 4 * grid.scale
        most = np.array([grid.width, grid.height]) * np.sqrt(MAX_PANORAMA)
        middle = np.array([grid.width, grid.height]) / 2
        low, high = np.maximum(low, middle - most / 2), np.minimum(high, middle + most / 2)
        x, y = (int(np.floor(value)) for value in low)
        return cls((x, y), (max(int(np.ceil(high[0])) - x, 16), max(int(np.ceil(high[1])) - y, 16)))

    @classmethod
    def load(cls, context: TaskContext[PatchesParams], track: PatchTrack) -> PanoramaRect:
        x, y, width, height = (int(value) for value in context.load("patch", f"{track.key}-rect")["at"])
        return cls((x, y), (width, height))

    def save(self, context: TaskContext[PatchesParams], track: PatchTrack) -> None:
        context.save(f"{track.key}-rect", {"at": np.array([*self.origin, *self.size])})

    def zeros(self) -> Total:
        """An empty colour sum of the whole panorama."""
        return np.zeros((self.size[1], self.size[0], 4), np.float32)


@dataclass(frozen=True)
class ColourSum:
    """Colour sum of a few frames, cropped to the covered part of the panorama. It takes 5 bytes per pixel.

    Attributes:
        at: (x, y) of its top left pixel in the panorama, px.
        colour: uint8 (h, w, 3), mean colour; rounding errors cancel over many sums.
        weight: float16 (h, w), sum of weights, relative precision 0.05 %.
    """

    at: tuple[int, int]
    colour: Frame
    weight: NDArray[np.float16]

    @classmethod
    def of(cls, total: Total) -> ColourSum:
        """Crop and quantise a colour sum of the whole panorama."""
        rows, columns = (np.flatnonzero((total[..., 3] > 0).any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            return cls((0, 0), np.zeros((0, 0, 3), np.uint8), np.zeros((0, 0), np.float16))
        top, left = int(rows[0]), int(columns[0])
        part = total[top : rows[-1] + 1, left : columns[-1] + 1]
        weight = to_half(np.minimum(part[..., 3], np.float32(6e4)))
        return cls((left, top), np.rint(np.minimum(_colours(part), 255)).astype(np.uint8), weight)

    @classmethod
    def load(cls, context: TaskContext[PatchesParams], name: str) -> ColourSum:
        arrays = context.load("patch", name)
        return cls((int(arrays["at"][0]), int(arrays["at"][1])), arrays["colour"], arrays["weight"])

    def save(self, context: TaskContext[PatchesParams], name: str) -> None:
        context.save(name, {"at": np.array(self.at), "colour": self.colour, "weight": self.weight})

    @property
    def box(self) -> tuple[slice, slice]:
        """Rows and columns of the panorama that the sum covers."""
        height, width = self.weight.shape
        return slice(self.at[1], self.at[1] + height), slice(self.at[0], self.at[0] + width)

    @property
    def total(self) -> Total:
        """The sum as float32 (h, w, 4), cropped to `box`."""
        out = np.zeros((*self.weight.shape, 4), np.float32)
        _add_sum(self.colour, to_single(self.weight), (0, 0), out)
        return out

    def add_to(self, total: Total) -> None:
        """Add the sum to one of the whole panorama, in place."""
        _add_sum(self.colour, to_single(self.weight), (self.at[1], self.at[0]), total)


@kernel
def _add_sum(colour: Frame, weight: Plane, corner: tuple[int, int], total: Total) -> None:
    top, left = corner
    for y in range(weight.shape[0]):
        for x in range(weight.shape[1]):
            own = weight[y, x]
            for c in range(3):
                total[top + y, left + x, c] += np.float32(colour[y, x, c]) * own
            total[top + y, left + x, 3] += own


def colour_spans(track: PatchTrack) -> list[tuple[int, int]]:
    """Frames [start, stop) of each colour sum of a patch, `SPAN_FRAMES` frames each."""
    count = math.ceil((track.stop - track.start) / SPAN_FRAMES)
    starts = [track.start + SPAN_FRAMES * n for n in range(count)]
    return [(start, min(start + SPAN_FRAMES, track.stop)) for start in starts]


def colour_sum(
    span: tuple[int, int],
    track: PatchTrack,
    placements: dict[int, Placement],
    maps: LabelMaps,
    rect: PanoramaRect,
    context: TaskContext[PatchesParams],
) -> ColourSum:
    """Sum the patch's colours over the frames [start, stop) of a span that contain it. Only these are decoded."""
    total, grid = rect.zeros(), WorkingGrid.of(context.size)
    inside = [index for index in range(*span) if index in placements]
    if not inside:
        return ColourSum.of(total)
    for index, frame in enumerate(context.frames("video", inside[0], inside[-1] + 1), start=inside[0]):
        if (placement := placements.get(index)) is not None:
            _add_frame(total, frame, placement, maps.require(index) == track.label, rect, grid)
    return ColourSum.of(total)


def _add_frame(
    total: Total, frame: Frame, placement: Placement, inside: Mask, rect: PanoramaRect, grid: WorkingGrid
) -> None:
    """Add the patch's pixels of a frame to `total`, in place.

    Args:
        inside: bool (h', w'), the patch's cluster in the frame, at the working size.
    """
    (left, top, right, bottom), x, y = full_map(placement, grid.ratio, (grid.width, grid.height), rect.origin)
    weights = np.ascontiguousarray(
        np.maximum(soft_mask(inside, grid)[top:bottom, left:right], np.float32(MARGIN_WEIGHT))
    )
    gather(total, np.ascontiguousarray(frame[top:bottom, left:right]), weights, x, y)


@dataclass(frozen=True)
class AppearancePeriods:
    """Periods of similar appearance of a patch.

    Attributes:
        spans: frames [start, stop) of each period, one after the other.
        overall: colour sum over all frames.
    """

    spans: list[tuple[int, int]]
    overall: ColourSum

    @classmethod
    def load(cls, context: TaskContext[PatchesParams], track: PatchTrack) -> AppearancePeriods:
        spans = context.load("patch", f"{track.key}-periods")["spans"].tolist()
        return cls([(start, stop) for start, stop in spans], ColourSum.load(context, f"{track.key}-overall"))

    def save(self, context: TaskContext[PatchesParams], track: PatchTrack) -> None:
        context.save(f"{track.key}-periods", {"spans": np.array(self.spans)})
        self.overall.save(context, f"{track.key}-overall")


def appearance_periods(
    sums: Iterable[ColourSum], track: PatchTrack, rect: PanoramaRect, grid: WorkingGrid, params: PatchesParams
) -> AppearancePeriods:
    """Divide a patch track into periods: consecutive spans are joined while the appearance stays similar.

    Args:
        sums: colour sums of `colour_spans(track)`, in order.

    Departure: zhang2011patches uses one mean per patch, which blurs a turning or speaking face. Here a new period
    begins where the mean of the next `SPAN_FRAMES` frames differs. Its strokes have the same positions and their own
    colours. A patch that does not change has one period. With a single mean per patch, more pixels misfit and are
    painted frame by frame, which flickers.
    """
    found: list[tuple[int, int]] = []
    current, overall = rect.zeros(), rect.zeros()
    for (start, stop), part in zip(colour_spans(track), sums, strict=True):
        total = part.total
        if found and not appearance_changed(current[part.box], total, grid, params.at(start)):
            found[-1] = found[-1][0], stop
        else:
            found.append((start, stop))
            current[:] = 0
        part.add_to(current)
        part.add_to(overall)
    return AppearancePeriods(found, ColourSum.of(overall))


def appearance_changed(before: Total, after: Total, grid: WorkingGrid, params: PatchesParams) -> bool:
    """Whether two colour sums differ by more than half of `params.misfit` on `CHANGED_FRACTION` of common pixels."""
    change = np.empty((*before.shape[:2], 3), np.float32)
    both = _change(np.ascontiguousarray(before), after, np.float32(0.5), np.float32(0.5), change)
    if not both:
        return bool(after[..., 3].max(initial=0) > 0.5)
    distance = vector_norm(cv2.GaussianBlur(change, (0, 0), fine_sigma_px(grid)))
    changed = (distance > params.misfit / 2) & (before[..., 3] > 0.5) & (after[..., 3] > 0.5)
    return int(np.count_nonzero(changed)) / both > CHANGED_FRACTION


@kernel
def _change(before: Total, after: Total, least_before: np.float32, least: np.float32, out: NDArray[np.float32]) -> int:
    """Fill `out` with the change of the mean colour, 0 where a weight is at most its least; the number of other
    pixels."""
    count = 0
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            if before[y, x, 3] > least_before and after[y, x, 3] > least:
                count += 1
                old, new = max(before[y, x, 3], np.float32(1e-6)), max(after[y, x, 3], np.float32(1e-6))
                for c in range(3):
                    out[y, x, c] = after[y, x, c] / new - before[y, x, c] / old
            else:
                for c in range(3):
                    out[y, x, c] = 0
    return count


def period_picture(
    sums: Iterable[ColourSum], overall: ColourSum, rect: PanoramaRect, grid: WorkingGrid, misfit: float
) -> Frame:
    """Picture of a period to be painted: uint8 (h, w, 3).

    Pixels that the period lacks, or that look the same in all periods, use the mean of all frames. Unchanged areas
    therefore get the same strokes in every period.

    Args:
        sums: colour sums of the period.
        overall: colour sum of all frames of the patch.
        misfit: tolerated RGB distance.
    """
    own, total = rect.zeros(), rect.zeros()
    overall.add_to(total)
    for part in sums:
        part.add_to(own)
    change, picture = np.empty((*own.shape[:2], 3), np.float32), np.empty((*own.shape[:2], 3), np.uint8)
    _change(total, own, np.float32(-1), np.float32(FILL_WEIGHT), change)
    _colour_bytes(own, picture)
    distance = vector_norm(cv2.GaussianBlur(change, (0, 0), fine_sigma_px(grid)))
    limit = np.float32(misfit) * error_tolerance(picture, grid.unit)
    _mix(own, distance, limit, total)
    return mean(total)[0]


@kernel
def _colour_bytes(total: Total, out: Frame) -> None:
    """Mean colours, rounded down."""
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            weight = max(total[y, x, 3], np.float32(1e-6))
            for c in range(3):
                out[y, x, c] = np.uint8(total[y, x, c] / weight)


@kernel
def _mix(own: Total, distance: Plane, limit: Plane, total: Total) -> None:
    """Replace `total`, in place, by `own` where they differ by more than the limit, with a transition."""
    zero, one = np.float32(0), np.float32(1)
    unchanged, least = np.float32(UNCHANGED_MISFIT), np.float32(FILL_WEIGHT)
    for y in range(distance.shape[0]):
        for x in range(distance.shape[1]):
            new = min(max(distance[y, x] / (limit[y, x] * unchanged) - one, zero), one)
            rest = max(one - new, least)
            for c in range(4):
                total[y, x, c] = own[y, x, c] * new + total[y, x, c] * rest


def _colours(total: Total) -> NDArray[np.float32]:
    """Mean colours of a colour sum, float32 (h, w, 3), RGB 0..255."""
    return np.asarray(total[..., :3] / np.maximum(total[..., 3:], np.float32(1e-6)), np.float32)


def soft_mask(inside: Mask, grid: WorkingGrid) -> Plane:
    """Soft mask of a cluster at the frame's size: float32 (h, w), 0..1.

    The masks of all labels, including 0, sum to 1.
    """
    soft = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), 0.7)
    return np.asarray(grid.upscale(soft), np.float32)
