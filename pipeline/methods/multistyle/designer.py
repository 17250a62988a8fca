"""A design, frame by frame: the style of every pixel, and which way strokes run there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.methods.multistyle.carrier import Map
from pipeline.methods.multistyle.design import Design, DirectionKey, ElementAt, around
from pipeline.methods.multistyle.shares import Shares, mixed, softened, spread, widened
from pipeline.methods.multistyle.styles import FIELDS, Style, vector
from pipeline.solvers import Solution
from pipeline.strokes.seeds import Field
from pipeline.tensors.elements import Element, design_field, follow
from pipeline.tensors.ellipses import Ellipse
from pipeline.tensors.field import Field as Tensors
from pipeline.tensors.field import fill_free

SOFT = 0.02
"""Width over which a soft border changes, in heights: sigma of its Gaussian."""


@dataclass(frozen=True)
class Placed:
    """A frame's regions.

    Attributes:
        number: of the frame.
        map: uint8 (h, w), numbers in `Design.names`.
        now: region -> its ellipse in this frame.
        keyed: (region, keyframe) -> its ellipse there.
    """

    number: int
    map: Map
    now: Mapping[str, Ellipse]
    keyed: Mapping[tuple[str, int], Ellipse]


class Designer:
    """Applies a design to frames of one size.

    Args:
        design: checked.
        base: the job's own style: of what no key reaches, and of keys that name no style.
        size: (width, height) of the frames; small: of the orientation field, px.

    Attributes:
        residual: the largest that was left of Laplace's equations so far, as part of the first; `cycles`: the most
            V-cycles that any took.
    """

    def __init__(self, design: Design, base: Style, size: tuple[int, int], small: tuple[int, int]) -> None:
        self.design, self.base, self.size, self.small = design, base, size, small
        self.residual, self.cycles = 0.0, 0

    # -- style

    def values(self, placed: Placed) -> dict[str, Field]:
        """Every style parameter: a number where it is the same everywhere, else float32 (h, w).

        Source: kagaya2011video, section 3.1: interpolation between a region's keys, then eq. 1 for regions without.
        """
        table, known = self.table(placed.number)
        there = np.unique(placed.map)
        out: dict[str, Field] = {}
        varying = []
        for column, name in enumerate(FIELDS):
            found = np.unique(table[[k for k in there if known[k]], column])
            if len(found) <= 1:
                out[name] = float(found[0]) if len(found) else float(getattr(self.base, name))
            else:
                varying.append(column)
        if varying:
            keys = [int(k) for k in there if known[k]]
            shares = self._shares(placed.map, keys)
            for column in varying:
                base = getattr(self.base, FIELDS[column])
                out[FIELDS[column]] = mixed(shares, np.array([*table[keys, column], base], np.float32))
        return out

    def table(self, frame: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Each region's style at a frame, float32 (regions, fields), and which regions have a key."""
        names = self.design.names
        table = np.tile(vector(self.base), (len(names), 1))
        known = np.zeros(len(names), np.bool_)
        for index, name in enumerate(names):
            found = around(self.design.keys, name, frame)
            if found is not None:
                before, after, t = found
                one, other = (vector(self.design.style(key, self.base)) for key in (before, after))
                table[index], known[index] = one + np.float32(t) * (other - one), True
        return table, known

    def _shares(self, found: Map, keys: list[int]) -> Shares:
        coarse = np.asarray(cv2.resize(found, self.small, interpolation=cv2.INTER_NEAREST), np.uint8)
        shares, solution = spread(coarse, keys, self._walls(coarse))
        if solution is not None:
            self._noted(solution)
        shares = widened(shares, found, keys)
        soft = self._with_border("soft")
        return softened(shares, np.isin(found, soft), SOFT * self.size[1], self.small) if soft else shares

    def _noted(self, solution: Solution) -> NDArray[np.float32]:
        """What was solved; how far, and in how many cycles, is told with the task."""
        self.residual = max(self.residual, solution.residual)
        self.cycles = max(self.cycles, solution.cycles)
        return solution.x

    def _walls(self, coarse: Map) -> dict[str, NDArray[np.float32]]:
        """Weights of the edges between pixels: 0 over a sharp border."""
        walled = np.isin(coarse, self._with_border("sharp"))
        across = (coarse[:, :-1] != coarse[:, 1:]) & (walled[:, :-1] | walled[:, 1:])
        down = (coarse[:-1] != coarse[1:]) & (walled[:-1] | walled[1:])
        return {"right": (~across).astype(np.float32), "down": (~down).astype(np.float32)}

    def _with_border(self, kind: str) -> list[int]:
        regions = self.design.regions
        return [k for k, name in enumerate(self.design.names) if name in regions and regions[name].border == kind]

    # -- direction

    def directions(self, edges: Tensors, placed: Placed) -> Tensors:
        """The orientation field, float32 (2, h', w'), from the picture's own.

        Source: kagaya2011video, section 3.2: P = w E + (1 - w) sum of M in regions that have a key, the edge field in
        those that have none, Laplace's equation in those set free.
        """
        if not self.design.directions:
            return edges
        coarse = np.asarray(cv2.resize(placed.map, self.small, interpolation=cv2.INTER_NEAREST), np.uint8)
        out, free = edges.copy(), np.zeros(coarse.shape, np.bool_)
        for index, name in enumerate(self.design.names):
            found = around(self.design.directions, name, placed.number)
            inside = coarse == index
            if found is None or not inside.any():
                continue
            before, after, t = found
            if before.free:
                free |= inside
                continue
            field = self._of_key(edges, before, placed)
            if t > 0 and not after.free:
                field = field + np.float32(t) * (self._of_key(edges, after, placed) - field)
            out[:, inside] = field[:, inside]
        if free.any() and not free.all():
            solved = self._noted(fill_free(out, ~free, **self._walls(coarse)))
            alone = free & (np.abs(solved).sum(axis=0) == 0)
            out = np.where(alone, edges, solved)
        return np.asarray(out, np.float32)

    def _of_key(self, edges: Tensors, key: DirectionKey, placed: Placed) -> Tensors:
        if not key.elements:
            return edges
        own, now = placed.keyed.get((key.region, key.frame)), placed.now.get(key.region)
        moved = [self._element(element, own, now if key.follow else None) for element in key.elements]
        return design_field(edges, moved, key.edge_weight)

    def _element(self, given: ElementAt, own: Ellipse | None, now: Ellipse | None) -> Element:
        """The element in px of the orientation field, where its region has taken it."""
        width, height = self.size
        decay = 0.0 if given.reach == 0 else 1 / (given.reach * height)
        element = Element(
            given.pattern, given.at[0] * width - 0.5, given.at[1] * height - 0.5, math.radians(given.angle), decay,
            given.strength,
        )  # fmt: skip
        if own is not None and now is not None:
            element = follow(element, own, now)
        sx, sy = self.small[0] / width, self.small[1] / height
        return Element(
            element.pattern, (element.x + 0.5) * sx - 0.5, (element.y + 0.5) * sy - 0.5, element.angle_rad,
            element.decay_per_px / sy, element.strength,
        )  # fmt: skip
