"""What a patch looks like: the sums of its colours over a few frames each, and which of them look alike."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Mask, Plane
from pipeline.methods.base import Bench
from pipeline.methods.patches.clusters import LabelMaps
from pipeline.methods.patches.fit import fine_px
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.links import norm
from pipeline.methods.patches.lives import Life
from pipeline.methods.patches.masking import leniency
from pipeline.methods.patches.params import PatchesParams
from pipeline.warp.panorama import Lay, full_map, gather, mean

LARGEST = 16.0
"""Area of a panorama, in frames: what lies beyond keeps its border's paint."""
AGE = 8
"""Frames whose mean is compared with what the patch has looked like so far."""
CHANGED = 0.015
"""Part of a patch's pixels that has to look different for a new age to begin."""
OUTSIDE = 0.02
"""Weight of a frame's colours beyond the cluster, in the margin, beside 1 within."""
FILL = 1e-3
"""Weight of all other frames in an age's picture: what the age has not seen is theirs."""
SAME = 0.25
"""Misfits up to which an age looks the same as all; from twice as many it is painted as it is."""
Total = NDArray[np.float32]
"""float32 (h, w, 4): sums of red, green, blue times weight, and of weights."""


@dataclass(frozen=True)
class Room:
    """The panorama's rectangle: (x, y) of its first pixel and its (width, height), px."""

    origin: tuple[int, int]
    size: tuple[int, int]

    @classmethod
    def around(cls, lays: dict[int, Lay], grid: Grid) -> Room:
        """As large as all frames need, at most LARGEST times a frame's area."""
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
    def load(cls, bench: Bench, life: Life) -> Room:
        x, y, width, height = (int(value) for value in bench.load("patch", f"{life.key}-room")["at"])
        return cls((x, y), (width, height))

    def save(self, bench: Bench, life: Life) -> None:
        bench.save(f"{life.key}-room", {"at": np.array([*self.origin, *self.size])})

    def empty(self) -> Total:
        return np.zeros((self.size[1], self.size[0], 4), np.float32)


@dataclass(frozen=True)
class Sum:
    """Colours of a few frames, in the part of the panorama that they reach; 5 bytes a pixel, since many are kept.

    Attributes:
        at: (x, y) of its first pixel in the panorama, px.
        colour: uint8 (h, w, 3), the mean; the rounding of many sums evens out.
        weight: float16 (h, w), 0.05 % fine.
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
    def load(cls, bench: Bench, name: str) -> Sum:
        kept = bench.load("patch", name)
        return cls((int(kept["at"][0]), int(kept["at"][1])), kept["colour"], kept["weight"])

    def save(self, bench: Bench, name: str) -> None:
        bench.save(name, {"at": np.array(self.at), "colour": self.colour, "weight": self.weight})

    @property
    def box(self) -> tuple[slice, slice]:
        height, width = self.weight.shape
        return slice(self.at[1], self.at[1] + height), slice(self.at[0], self.at[0] + width)

    @property
    def total(self) -> Total:
        weight = self.weight.astype(np.float32)
        return np.dstack([self.colour * weight[..., None], weight]).astype(np.float32, copy=False)


def spans(life: Life) -> list[tuple[int, int]]:
    """Frames [start, stop) of each sum of a life."""
    count = math.ceil((life.stop - life.start) / AGE)
    return [(life.start + AGE * n, min(life.start + AGE * (n + 1), life.stop)) for n in range(count)]


def sum_up(span: tuple[int, int], life: Life, lays: dict[int, Lay], maps: LabelMaps, room: Room, bench: Bench) -> Sum:
    """The patch's colours, summed over the frames of a span that have it."""
    total, grid = room.empty(), Grid.of(bench.size)
    for index, frame in enumerate(bench.frames("video", *span), start=span[0]):
        if (lay := lays.get(index)) is not None:
            add(total, frame, lay, maps.sure(index) == life.label, room, grid)
    return Sum.of(total)


def add(
    total: NDArray[np.float32], frame: Frame, lay: Lay, inside: Mask, room: Room, grid: Grid
) -> None:  # fmt: skip
    """Add a frame's pixels of the patch to the sums, in place; `inside` is its cluster, bool, at the working size."""
    rect, x, y = full_map(lay, grid.ratio, (grid.width, grid.height), room.origin)
    weights = presence(inside, grid)[rect[1] : rect[3], rect[0] : rect[2]]
    weights = np.ascontiguousarray(np.maximum(weights, np.float32(OUTSIDE)))
    gather(total, np.ascontiguousarray(frame[rect[1] : rect[3], rect[0] : rect[2]]), weights, x, y)


@dataclass(frozen=True)
class Ages:
    """When a patch looks alike.

    Attributes:
        spans: frames [start, stop) of each age, one after the other.
        every: the sum over all frames.
    """

    spans: list[tuple[int, int]]
    every: Sum

    @classmethod
    def load(cls, bench: Bench, life: Life) -> Ages:
        kept = bench.load("patch", f"{life.key}-ages")
        return cls([(start, stop) for start, stop in kept["spans"].tolist()], Sum.load(bench, f"{life.key}-every"))

    def save(self, bench: Bench, life: Life) -> None:
        bench.save(f"{life.key}-ages", {"spans": np.array(self.spans)})
        self.every.save(bench, f"{life.key}-every")


def ages(sums: Iterable[Sum], life: Life, room: Room, grid: Grid, params: PatchesParams) -> Ages:
    """Join sums, which are those of `spans(life)`, as long as they look alike.

    Departure: the paper has one mean for the life of a patch; of a face that turns or speaks that is no face. Where the
    mean of the next AGE frames is another picture, a new age begins: painted by the same strokes at the same places, in
    its own colours. What does not change has one age. With one mean a patch, flicker is 4 to 8 % higher (foreman,
    coffee), since more of it misfits and is painted frame by frame.
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
    """Whether two sums of colour are of different pictures: by more than half the misfit on CHANGED of the pixels."""
    both = (before[..., 3] > 0.5) & (after[..., 3] > 0.5)
    if not both.any():
        return bool(after[..., 3].max(initial=0) > 0.5)
    means = [total[..., :3] / np.maximum(total[..., 3:], np.float32(1e-6)) for total in (before, after)]
    apart = cv2.GaussianBlur(np.where(both[..., None], means[1] - means[0], 0), (0, 0), fine_px(grid))
    return float((norm(apart) > params.misfit / 2)[both].mean()) > CHANGED


def picture(sums: Iterable[Sum], every: Sum, room: Room, grid: Grid, misfit: float) -> Frame:
    """The mean of an age, uint8 (h, w, 3); what it has not seen, or what looks the same at any age, is from all.

    So the strokes of what does not change are the same at every age.
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
    """How far each pixel of the frame is in a cluster, 0..1, smooth at its border: float32 (h, w), px.

    Over all labels, 0 included, it sums to 1.
    """
    soft = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), 0.7)
    return np.asarray(grid.enlarge(soft), np.float32)
