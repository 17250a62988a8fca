"""Appearance of a patch over time: colour sums over short spans of frames, and periods of similar appearance (ages)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Mask, Plane
from pipeline.methods.base import TaskContext
from pipeline.methods.patches.clusters import LabelMaps
from pipeline.methods.patches.fit import fine_px
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.links import norm
from pipeline.methods.patches.lives import Life
from pipeline.methods.patches.masking import leniency
from pipeline.methods.patches.params import PatchesParams
from pipeline.warp.panorama import Lay, full_map, gather, mean

LARGEST = 16.0
"""Largest area of a panorama, in frame areas. Positions outside it sample the paint at its border."""
AGE = 8
"""Number of frames whose mean colour is compared with the current age."""
CHANGED = 0.015
"""Fraction of a patch's pixels that must change for a new period of appearance (age) to begin."""
OUTSIDE = 0.02
"""Weight of pixels in the margin outside the cluster; pixels inside have weight 1."""
FILL = 1e-3
"""Weight of all frames of the patch in the picture of an age; they fill the pixels that the age lacks."""
SAME = 0.25
"""Misfit up to which an age uses the mean of all frames; from twice this value on it uses its own mean."""
Total = NDArray[np.float32]
"""float32 (h, w, 4): sums of red, green, blue times weight, and of weights."""


@dataclass(frozen=True)
class Room:
    """The panorama's rectangle: (x, y) of its first pixel and its (width, height), px."""

    origin: tuple[int, int]
    size: tuple[int, int]

    @classmethod
    def around(cls, lays: dict[int, Lay], grid: Grid) -> Room:
        """Bounding rectangle of all frames of the patch, limited to `LARGEST` frame areas."""
        ends = []
        for lay in lays.values():
            places = lay.positions()[::4, ::4].reshape(-1, 2)
            ends.append((places.min(axis=0), places.max(axis=0)))
        low = np.min([a for a, _ in ends], axis=0) * grid.ratio - 4
        high = np.max([b for _, b in ends], axis=0) * grid.ratio + 4 + 4 * grid.scale
        most = np.array([grid.width, grid.height]) * np.sqrt(LARGEST)
        middle = np.array([grid.width, grid.height]) / 2
        low, high = np.maximum(low, middle - most / 2), np.minimum(high, middle + most / 2)
        x, y = (int(np.floor(value)) for value in low)
        return cls((x, y), (max(int(np.ceil(high[0])) - x, 16), max(int(np.ceil(high[1])) - y, 16)))

    @classmethod
    def load(cls, context: TaskContext[PatchesParams], life: Life) -> Room:
        x, y, width, height = (int(value) for value in context.load("patch", f"{life.key}-room")["at"])
        return cls((x, y), (width, height))

    def save(self, context: TaskContext[PatchesParams], life: Life) -> None:
        context.save(f"{life.key}-room", {"at": np.array([*self.origin, *self.size])})

    def empty(self) -> Total:
        return np.zeros((self.size[1], self.size[0], 4), np.float32)


@dataclass(frozen=True)
class Sum:
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
    def of(cls, total: Total) -> Sum:
        rows, columns = (np.flatnonzero((total[..., 3] > 0).any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            return cls((0, 0), np.zeros((0, 0, 3), np.uint8), np.zeros((0, 0), np.float16))
        top, left = int(rows[0]), int(columns[0])
        part = total[top : rows[-1] + 1, left : columns[-1] + 1]
        colours = part[..., :3] / np.maximum(part[..., 3:], np.float32(1e-6))
        weight = np.minimum(part[..., 3], np.float32(6e4)).astype(np.float16)
        return cls((left, top), np.rint(np.minimum(colours, 255)).astype(np.uint8), weight)

    @classmethod
    def load(cls, context: TaskContext[PatchesParams], name: str) -> Sum:
        kept = context.load("patch", name)
        return cls((int(kept["at"][0]), int(kept["at"][1])), kept["colour"], kept["weight"])

    def save(self, context: TaskContext[PatchesParams], name: str) -> None:
        context.save(name, {"at": np.array(self.at), "colour": self.colour, "weight": self.weight})

    @property
    def box(self) -> tuple[slice, slice]:
        height, width = self.weight.shape
        return slice(self.at[1], self.at[1] + height), slice(self.at[0], self.at[0] + width)

    @property
    def total(self) -> Total:
        weight = self.weight.astype(np.float32)
        return np.dstack([self.colour * weight[..., None], weight]).astype(np.float32, copy=False)


def spans(life: Life) -> list[tuple[int, int]]:
    """Frames [start, stop) of each colour sum of a patch, `AGE` frames each."""
    count = math.ceil((life.stop - life.start) / AGE)
    return [(life.start + AGE * n, min(life.start + AGE * (n + 1), life.stop)) for n in range(count)]


def sum_up(
    span: tuple[int, int],
    life: Life,
    lays: dict[int, Lay],
    maps: LabelMaps,
    room: Room,
    context: TaskContext[PatchesParams],
) -> Sum:
    """Sum the patch's colours over the frames of a span that contain it."""
    total, grid = room.empty(), Grid.of(context.size)
    for index, frame in enumerate(context.frames("video", *span), start=span[0]):
        if (lay := lays.get(index)) is not None:
            add(total, frame, lay, maps.sure(index) == life.label, room, grid)
    return Sum.of(total)


def add(
    total: NDArray[np.float32], frame: Frame, lay: Lay, inside: Mask, room: Room, grid: Grid
) -> None:  # fmt: skip
    """Add the patch's pixels of a frame to `total`, in place.

    Args:
        inside: bool (h', w'), the patch's cluster in the frame, at the working size.
    """
    rect, x, y = full_map(lay, grid.ratio, (grid.width, grid.height), room.origin)
    weights = presence(inside, grid)[rect[1] : rect[3], rect[0] : rect[2]]
    weights = np.ascontiguousarray(np.maximum(weights, np.float32(OUTSIDE)))
    gather(total, np.ascontiguousarray(frame[rect[1] : rect[3], rect[0] : rect[2]]), weights, x, y)


@dataclass(frozen=True)
class Ages:
    """Periods of similar appearance of a patch.

    Attributes:
        spans: frames [start, stop) of each age, one after the other.
        every: colour sum over all frames.
    """

    spans: list[tuple[int, int]]
    every: Sum

    @classmethod
    def load(cls, context: TaskContext[PatchesParams], life: Life) -> Ages:
        kept = context.load("patch", f"{life.key}-ages")
        return cls([(start, stop) for start, stop in kept["spans"].tolist()], Sum.load(context, f"{life.key}-every"))

    def save(self, context: TaskContext[PatchesParams], life: Life) -> None:
        context.save(f"{life.key}-ages", {"spans": np.array(self.spans)})
        self.every.save(context, f"{life.key}-every")


def ages(sums: Iterable[Sum], life: Life, room: Room, grid: Grid, params: PatchesParams) -> Ages:
    """Divide a patch's life into ages: consecutive spans are joined while the appearance stays similar.

    Args:
        sums: colour sums of `spans(life)`, in order.

    Departure: zhang2011patches uses one mean for the life of a patch, which blurs a turning or speaking face. Here a
    new age begins where the mean of the next `AGE` frames differs. Its strokes have the same positions and their own
    colours. A patch that does not change has one age. With a single mean per patch, flicker is 4 to 8 % higher
    (foreman, coffee), since more pixels misfit and are painted frame by frame.
    """
    found: list[tuple[int, int]] = []
    now, every = room.empty(), room.empty()
    for (start, stop), part in zip(spans(life), sums, strict=True):
        total = part.total
        if found and not differs(now[part.box], total, grid, params):
            found[-1] = found[-1][0], stop
        else:
            found.append((start, stop))
            now[:] = 0
        now[part.box] += total
        every[part.box] += total
    return Ages(found, Sum.of(every))


def differs(before: NDArray[np.float32], after: NDArray[np.float32], grid: Grid, params: PatchesParams) -> bool:
    """Whether two colour sums differ by more than half of `params.misfit` on a fraction `CHANGED` of common pixels."""
    both = (before[..., 3] > 0.5) & (after[..., 3] > 0.5)
    if not both.any():
        return bool(after[..., 3].max(initial=0) > 0.5)
    means = [total[..., :3] / np.maximum(total[..., 3:], np.float32(1e-6)) for total in (before, after)]
    apart = cv2.GaussianBlur(np.where(both[..., None], means[1] - means[0], 0), (0, 0), fine_px(grid))
    return float((norm(apart) > params.misfit / 2)[both].mean()) > CHANGED


def picture(sums: Iterable[Sum], every: Sum, room: Room, grid: Grid, misfit: float) -> Frame:
    """Picture of an age to be painted: uint8 (h, w, 3).

    Pixels that the age lacks, or that look the same in all ages, use the mean of all frames. Unchanged areas therefore
    get the same strokes in every age.
    """
    own, total = room.empty(), room.empty()
    total[every.box] = every.total
    for part in sums:
        own[part.box] += part.total
    means = [plane[..., :3] / np.maximum(plane[..., 3:], np.float32(1e-6)) for plane in (own, total)]
    apart = norm(cv2.GaussianBlur(np.where(own[..., 3:] > FILL, means[0] - means[1], 0), (0, 0), fine_px(grid)))
    limit = np.float32(misfit) * leniency(means[0].astype(np.uint8), grid.unit)
    new = np.clip(apart / (limit * np.float32(SAME)) - 1, 0, 1)[..., None]
    return mean(own * new + total * np.maximum(1 - new, np.float32(FILL)))[0]


def presence(inside: Mask, grid: Grid) -> Plane:
    """Soft mask of a cluster at the frame's size: float32 (h, w), 0..1.

    The masks of all labels, including 0, sum to 1.
    """
    soft = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), 0.7)
    return np.asarray(grid.enlarge(soft), np.float32)
