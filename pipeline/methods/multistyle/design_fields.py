"""Style and orientation fields of a design, frame by frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.methods.multistyle.design import Design, DirectionKey, ElementAt, StyleKey, keys_around
from pipeline.methods.multistyle.harmonic_weights import Weights, mix, soften, solve_weights, upscale
from pipeline.methods.multistyle.label_propagation import RegionMap
from pipeline.methods.multistyle.styles import FIELDS, TECHNIQUE_FIELDS, Style, Technique, vector
from pipeline.solvers import Solution
from pipeline.strokes.seeds import StyleField
from pipeline.tensors.elements import Element, design_field, follow
from pipeline.tensors.ellipses import Ellipse
from pipeline.tensors.field import OrientationField, fill_free

SOFT = 0.02
"""Sigma of the Gaussian over which soft borders change, as a fraction of the shorter side."""


@dataclass(frozen=True)
class RegionPlacement:
    """Regions of one frame.

    Attributes:
        number: of the frame.
        map: uint8 (h, w), region numbers, see `Design.names`.
        now: region -> its ellipse in this frame.
        keyed: (region, keyframe) -> its ellipse in the keyframe.
    """

    number: int
    map: RegionMap
    now: Mapping[str, Ellipse]
    keyed: Mapping[tuple[str, int], Ellipse]


def moved(given: ElementAt, own: Ellipse | None, now: Ellipse | None, size: tuple[int, int]) -> Element:
    """The element in px of frames of `size` (width, height), moved from its region's ellipse in the keyframe, `own`, to
    the one in this frame; None = it stays."""
    width, height = size
    decay = 0.0 if given.reach in (0, "everywhere") else 1 / (float(given.reach) * height)
    element = Element(
        given.pattern, given.at[0] * width - 0.5, given.at[1] * height - 0.5, math.radians(given.angle), decay,
        given.strength,
    )  # fmt: skip
    return element if own is None or now is None else follow(element, own, now)


class DesignFields:
    """Evaluates a design for frames of one size.

    Args:
        design: checked.
        base: the job's style: for pixels that no key reaches, and for keys without a style name.
        technique: the job's technique.
        size: (width, height) of the frames; small: of the orientation field, px.

    Attributes:
        residual: largest relative residual of Laplace's equations so far; `cycles`: most V-cycles of a solution.
    """

    def __init__(
        self, design: Design, base: Style, technique: Technique, size: tuple[int, int], small: tuple[int, int]
    ) -> None:
        self.design, self.base, self.technique, self.size, self.small = design, base, technique, size, small
        self.residual, self.cycles = 0.0, 0

    # -- style

    def values(self, placed: RegionPlacement) -> dict[str, StyleField]:
        """All parameters of `Style` and `Technique`: a number where uniform, otherwise float32 (h, w).

        Source: kagaya2011video, section 3.1: interpolation between a region's keys, eq. 1 for regions without keys.
        """
        table, known = self.table(placed.number)
        technique = self._interpolated(placed.number, self._technique_vector)
        there = np.unique(placed.map)
        keys = [int(k) for k in there if known[k]]
        columns = [(name, table[:, index], getattr(self.base, name)) for index, name in enumerate(FIELDS)]
        columns += [
            (name, technique[:, index], getattr(self.technique, name)) for index, name in enumerate(TECHNIQUE_FIELDS)
        ]
        out: dict[str, StyleField] = {}
        weights: Weights | None = None
        walled = bool(self._with_border("sharp"))  # then there may be pixels that no key reaches
        for name, column, base in columns:
            found = np.unique([*column[keys], base] if walled and keys else column[keys])
            if len(found) <= 1:
                out[name] = float(found[0]) if len(found) else float(base)
            else:
                weights = self._weights(placed.map, keys) if weights is None else weights
                own = np.array([*column[keys], base], np.float32)
                out[name] = mix(weights, _unwrapped(own) if name == "hue" else own)
        return out

    def table(self, frame: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Style of each region at a frame, float32 (regions, fields), and flags of the regions that have a key."""
        keyed = {key.region for key in self.design.keys}
        known = np.array([name in keyed for name in self.design.names], np.bool_)
        return self._interpolated(frame, lambda key: vector(self.base if key is None else self._style(key))), known

    def _style(self, key: StyleKey) -> Style:
        return self.design.style(key, self.base)

    def _technique_vector(self, key: StyleKey | None) -> NDArray[np.float64]:
        own = self.technique if key is None else self.design.technique(key, self.technique)
        return np.array([getattr(own, name) for name in TECHNIQUE_FIELDS])

    def _interpolated(self, frame: int, vector_of: Callable[[StyleKey | None], AnyArray]) -> AnyArray:
        """One row per region: the vector of its keys, interpolated at the frame; without keys, the vector of None."""
        base = vector_of(None)
        table = np.tile(base, (len(self.design.names), 1))
        for index, name in enumerate(self.design.names):
            found = keys_around(self.design.keys, name, frame)
            if found is not None:
                before, after, t = found
                one, other = vector_of(before), vector_of(after)
                table[index] = one + base.dtype.type(t) * _difference(one, other)
        return table

    def _weights(self, regions: RegionMap, keys: list[int]) -> Weights:
        coarse = np.asarray(cv2.resize(regions, self.small, interpolation=cv2.INTER_NEAREST), np.uint8)
        weights, solution = solve_weights(coarse, keys, self._walls(coarse))
        if solution is not None:
            self._record(solution)
        weights = upscale(weights, regions, keys)
        soft = self._with_border("soft")
        return soften(weights, np.isin(regions, soft), SOFT * min(self.size), self.small) if soft else weights

    def _record(self, solution: Solution) -> NDArray[np.float32]:
        """Keep the residual and cycles of a solution; return its values."""
        self.residual = max(self.residual, solution.residual)
        self.cycles = max(self.cycles, solution.cycles)
        return solution.x

    def _walls(self, coarse: RegionMap) -> dict[str, NDArray[np.float32]]:
        """Weights of the edges between pixels: 0 across sharp borders."""
        walled = np.isin(coarse, self._with_border("sharp"))
        across = (coarse[:, :-1] != coarse[:, 1:]) & (walled[:, :-1] | walled[:, 1:])
        down = (coarse[:-1] != coarse[1:]) & (walled[:-1] | walled[1:])
        return {"right": (~across).astype(np.float32), "down": (~down).astype(np.float32)}

    def _with_border(self, kind: str) -> list[int]:
        regions = self.design.regions
        return [k for k, name in enumerate(self.design.names) if name in regions and regions[name].border == kind]

    # -- direction

    def directions(self, edges: OrientationField, placed: RegionPlacement) -> OrientationField:
        """Orientation field, float32 (2, h', w'), from the edge field and the design.

        The edge field's length is 1 at clear edges and 0 where the picture has none; there, elements alone count.

        Source: kagaya2011video, section 3.2: P = w E + (1 - w) sum of M in regions with a key, the edge field in
        regions without, Laplace's equation in free regions.
        """
        if not self.design.directions:
            return edges
        coarse = np.asarray(cv2.resize(placed.map, self.small, interpolation=cv2.INTER_NEAREST), np.uint8)
        out, free = edges.copy(), np.zeros(coarse.shape, np.bool_)
        for index, name in enumerate(self.design.names):
            found = keys_around(self.design.directions, name, placed.number)
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
            solved = self._record(fill_free(out, ~free, **self._walls(coarse)))
            alone = free & (np.abs(solved).sum(axis=0) == 0)
            out = np.where(alone, edges, solved)
        soft = np.isin(coarse, self._with_border("soft"))
        return soften(out, soft, SOFT * min(self.small), self.small) if soft.any() else np.asarray(out, np.float32)

    def _of_key(self, edges: OrientationField, key: DirectionKey, placed: RegionPlacement) -> OrientationField:
        if not key.elements:
            return edges
        own, now = placed.keyed.get((key.region, key.frame)), placed.now.get(key.region)
        moved = [self._element(element, own, now if key.follow else None) for element in key.elements]
        return design_field(edges, moved, key.edge_weight)

    def _element(self, given: ElementAt, own: Ellipse | None, now: Ellipse | None) -> Element:
        """The element in px of the orientation field, moved with its region."""
        width, height = self.size
        element = moved(given, own, now, self.size)
        sx, sy = self.small[0] / width, self.small[1] / height
        return replace(
            element, x=(element.x + 0.5) * sx - 0.5, y=(element.y + 0.5) * sy - 0.5,
            decay_per_px=element.decay_per_px / sy,
        )  # fmt: skip


HUE = FIELDS.index("hue")


def _difference(one: AnyArray, other: AnyArray) -> AnyArray:
    """`other` minus `one`; for styles, the hue goes the shorter way round."""
    out = np.asarray(other - one)
    if len(out) == len(FIELDS):
        out[HUE] = _shorter(out[HUE])
    return out


def _unwrapped(hues_deg: NDArray[np.float32]) -> NDArray[np.float32]:
    """Hues shifted by whole turns, so that each is within half a turn of the first one."""
    return np.asarray(hues_deg[0] + _shorter(hues_deg - hues_deg[0]), np.float32)


def _shorter(difference_deg: AnyArray) -> AnyArray:
    """A difference of hues modulo 360, in -180..180; a value within this range does not change."""
    revolutions = np.where(np.abs(difference_deg) > 180, np.round(difference_deg / 360), 0)
    return np.asarray(difference_deg - 360 * revolutions, difference_deg.dtype)
