"""Motion vectors of renderers: which channels, which unit, which signs, and from which frame to which.

The result is V+ and V- of benard2013stylizing, px, y down: the point at p of a frame moves to p + V+(p) in the next
frame, and came from p - V-(p) in the frame before. Programs differ in the signs, in the direction of y, in the unit,
and in whether they write one vector or two; a name alone does not tell. So vectors of an unknown convention are tried
in all of them on two frames: the right one gives the smallest difference between a frame and its neighbour, warped.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadInput
from pipeline.formats.base import PlaneImage
from pipeline.frames import Flow, Frame, Mask
from pipeline.passes.find import ANYWHERE, FoundPass, Where, find
from pipeline.perception.flow.invert import invert_flow
from pipeline.perception.flow.warp import warp_back

Convention = Literal["auto", "blender", "cycles", "eevee", "nuke"]
Factors = tuple[float, float, float]
"""Factors of the next-frame vectors (gives V+), of the previous-frame vectors (gives V-), and of all y components."""
Way = Literal["both", "next", "previous"]
"""To which frame the vectors of a frame point. "next" and "previous": they are one-way."""

_STATED: Mapping[str, Factors] = {
    "blender": (-1.0, -1.0, -1.0),
    "cycles": (-1.0, -1.0, -1.0),
    "eevee": (-1.0, -1.0, -1.0),
    "nuke": (1.0, -1.0, 1.0),
}
_SIDE_PX = 640
"""Longest side of the pictures in which conventions are compared, px."""
_BLUR_PX = 1.5
"""Standard deviation of the blur of these pictures, px: few samples a pixel make more noise than motion does."""
_BETTER = 0.98
"""Share of the first convention's error below which another one is the better one."""
_USEFUL = 0.95
"""Share of the error without vectors below which vectors are used."""
_STILL_LEVELS = 0.3
"""Mean difference of two frames, gray levels, below which they tell nothing about their motion."""
_CODED_TOLERANCE = 0.02
_OTHER_WAY = 0.75
"""As `_BETTER`, for vectors to the other frame than their name says."""
_MOVES = 0.05
"""Share of the longest vector from which a pixel counts as moving."""
_LIMIT_LEVELS = 64
"""Largest difference of a pixel that counts, gray levels."""


class VectorPass(NamedTuple):
    """The channels of an image that hold motion vectors; None: those of one direction are missing."""

    next: FoundPass | None
    previous: FoundPass | None

    @property
    def programs(self) -> str:
        return (self.next or self.previous or FoundPass("", "", ())).programs

    @property
    def layers(self) -> str:
        """Names of the layers that hold them."""
        return " and ".join(dict.fromkeys(one.layer for one in (self.next, self.previous) if one is not None))


def vector_pass(image: PlaneImage, where: Where = ANYWHERE) -> VectorPass | None:
    """The motion vectors of an image; None: it has none."""
    if (four := find(image, "vectors", where)) is not None:
        parts = (FoundPass(four.layer, four.programs, four.channels[at : at + 2]) for at in (2, 0))
        return VectorPass(*parts)
    forth, back = find(image, "next", where), find(image, "previous", where)
    return VectorPass(forth, back) if forth or back else None


def raw_vectors(image: PlaneImage, where: Where = ANYWHERE) -> tuple[Flow | None, Flow | None]:
    """Motion vectors as stored, without any change of sign or axis: (to the next, to the previous frame); None =
    missing."""
    found = vector_pass(image, where)
    if found is None:
        return None, None
    forth, back = (None if one is None else one.planes(image) for one in found)
    return forth, back


@dataclass(frozen=True)
class VectorFacts:
    """What is known about the motion vectors of a sequence.

    Attributes:
        layers, programs: where they are, and the programs that name them so.
        way: to which frame they point.
        factors: what stored vectors are multiplied by; they contain the unit.
        unit: of the stored vectors, in words.
        error, still: mean difference of moving pixels between two frames, one warped along the vectors, and as they
            are, gray levels.
        stated: the convention that the user named; "" = found by warping.
        fault: why they are not used; "" = they are.
    """

    layers: str
    programs: str
    way: Way
    factors: Factors
    unit: str = "px"
    error: float = 0.0
    still: float = 0.0
    stated: str = ""
    fault: str = ""

    @property
    def used(self) -> bool:
        return not self.fault

    def sentence(self) -> str:
        """The finding, for a user."""
        if self.fault:
            return f"The motion vectors in {self.layers} are not used: {self.fault}"
        one_way = "" if self.way == "both" else f", one-way, to the {self.way} frame; the other direction is completed"
        how = f"stated as {self.stated}" if self.stated else "found by warping"
        return (
            f"The motion vectors in {self.layers} (as {self.programs} names them{one_way}) replace optical flow. Their "
            f"convention, {how}: unit {self.unit}, {self._signs()}; what moves differs by {self.error:.1f} gray levels "
            f"along them, by {self.still:.1f} without."
        )

    def _signs(self) -> str:
        signs = ["negated" if factor < 0 else "as stored" for factor in self.factors[:2]]
        both = "x " + (signs[0] if self.way != "previous" else signs[1])
        if self.way == "both" and signs[0] != signs[1]:
            both = f"x to the next frame {signs[0]}, to the previous one {signs[1]}"
        return f"{both}, y {'up' if self.factors[2] < 0 else 'down'}"


class Velocities(NamedTuple):
    """V+ of a frame and V- of the next one, float32 (h, w, 2), px, y down; None = not stored."""

    plus: Flow | None
    minus: Flow | None


def signed(forth: Flow | None, back: Flow | None, factors: Factors) -> Velocities:
    """Convert stored vectors to V+ and V- by factors; values that are not finite become 0."""
    axis = np.array([1.0, factors[2]], np.float32)

    def scaled(field: Flow | None, factor: float) -> Flow | None:
        if field is None:
            return None
        return np.ascontiguousarray(np.nan_to_num(field, posinf=0, neginf=0) * (np.float32(factor) * axis), np.float32)

    return Velocities(scaled(forth, factors[0]), scaled(back, factors[1]))


def of_pair(facts: VectorFacts, first: PlaneImage, second: PlaneImage, where: Where = ANYWHERE) -> Velocities:
    """V+ of a frame and V- of the next one, as far as they are stored, from the images of both."""
    forth, back = raw_vectors(first, where)[0], raw_vectors(second, where)[1]
    if facts.way == "next":
        forth = forth if forth is not None else raw_vectors(first, where)[1]
        back = None
    elif facts.way == "previous":
        back = back if back is not None else raw_vectors(second, where)[0]
        forth = None
    return signed(forth, back, facts.factors)


def completed(found: Velocities, first: Frame, second: Frame) -> tuple[Flow, Flow]:
    """V+ of a frame and V- of the next one, of which the missing one is the inverse of the other, by splatting.

    Args:
        first, second: both pictures, uint8 (h, w, 3): of several pixels that move to the same one, the pixel of the
            most similar brightness is visible there.
    """
    here, there = (np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8) for frame in (first, second))
    if found.minus is None:
        assert found.plus is not None
        return found.plus, -_inverse(found.plus, here, there)
    return (_inverse(-found.minus, there, here), found.minus) if found.plus is None else (found.plus, found.minus)


def _inverse(flow: Flow, here: NDArray[np.uint8], there: NDArray[np.uint8]) -> Flow:
    """The flow in the opposite direction; uncovered pixels get the motion of the nearest visible ones."""
    found, visible = invert_flow(flow, here, there)
    return found if visible.all() or not visible.any() else _filled(found, visible)


def _filled(flow: Flow, known: Mask) -> Flow:
    _, nearest = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    at = np.zeros(int(nearest.max()) + 1, np.intp)
    at[nearest[known]] = np.flatnonzero(known)
    return np.ascontiguousarray(flow.reshape(-1, 2)[at[nearest]])


# -- the convention


@dataclass(frozen=True)
class _Candidate:
    way: Way
    factors: Factors
    unit: str


def vector_facts(
    first: tuple[PlaneImage, Frame], second: tuple[PlaneImage, Frame], stated: str | Factors = "auto",
    where: Where = ANYWHERE,
) -> VectorFacts:  # fmt: skip
    """The convention of the motion vectors of a sequence.

    Args:
        first, second: image and picture, uint8 (h, w, 3), of two consecutive frames.
        stated: a `Convention`, or factors; "auto": the one with the smallest warping error.

    Raises:
        BadInput: the convention is unknown, or the images have no motion vectors.
    """
    known = (*get_args(Convention),)
    if isinstance(stated, str) and stated not in known:
        raise BadInput("The vector convention is unknown.", field="vectors", value=stated,
                       remedy=f"Use one of: {', '.join(known)}.")  # fmt: skip
    channels = vector_pass(first[0], where)
    if channels is None or vector_pass(second[0], where) is None:
        raise BadInput("The images contain no motion vectors.", field="vectors", remedy="Render the Vector pass.")
    name = "" if stated == "auto" else stated if isinstance(stated, str) else "factors"
    pair = _Pair.of(first, second, where)
    if not name and pair.is_coded():
        fault = ("They are coded as colours (0.5 = no motion), so that their scale is unknown. Render them in pixels, "
                 "as raw floating point.")  # fmt: skip
        return VectorFacts(channels.layers, channels.programs, "both", (1.0, 1.0, 1.0), fault=fault)
    tried = list(_stated(stated, channels) if name else _candidates(channels, first[1].shape, pair.longest()))
    best, error, still = pair.best(tried)
    fault = ""
    if not name and still >= _STILL_LEVELS and error > _USEFUL * still:
        fault = (f"what moves differs by {error:.1f} gray levels along them in the best of all conventions, by "
                 f"{still:.1f} without them.")  # fmt: skip
    return VectorFacts(
        channels.layers, channels.programs, best.way, best.factors, best.unit, error, still, name, fault
    )  # fmt: skip


def _ways(channels: VectorPass) -> tuple[Way, ...]:
    if channels.next and channels.previous:
        return ("both",)
    return ("next", "previous") if channels.next else ("previous", "next")


def _stated(stated: str | Factors, channels: VectorPass) -> Iterator[_Candidate]:
    factors = _STATED[stated] if isinstance(stated, str) else stated
    yield from (_Candidate(way, factors, "as stated") for way in _ways(channels)[:1])


def _candidates(channels: VectorPass, shape: tuple[int, ...], longest: float) -> Iterator[_Candidate]:
    """Conventions to try, the most frequent ones first. Vectors longer than the frame are no shares of its sides."""
    height, width = shape[:2]
    units: list[tuple[str, float, float]] = [("px", 1.0, 1.0), ("px of half a frame's time", 2.0, 2.0)]
    if longest <= 1:
        units += [("frame sides", width, height), ("half frame sides", width / 2, height / 2)]
    signs = (-1.0, 1.0) if "Blender" in channels.programs else (1.0, -1.0)
    for unit, across, down in units:
        for way in _ways(channels):
            for forth in signs:
                for back in signs if way == "both" else (forth,):
                    for up in (-1.0, 1.0):
                        yield _Candidate(way, (forth * across, back * across, up * down / across), unit)


class _Pair(NamedTuple):
    """Two consecutive frames, at most `_SIDE_PX` on a side and blurred against noise, and their vectors in px of the
    frames."""

    pictures: tuple[Frame, Frame]
    first: tuple[Flow | None, Flow | None]
    second: tuple[Flow | None, Flow | None]
    scale: float

    @classmethod
    def of(cls, first: tuple[PlaneImage, Frame], second: tuple[PlaneImage, Frame], where: Where) -> _Pair:
        height, width = first[1].shape[:2]
        scale = min(1.0, _SIDE_PX / max(height, width))
        size = max(1, round(width * scale)), max(1, round(height * scale))

        def field(image: PlaneImage) -> tuple[Flow | None, Flow | None]:
            forth, back = (
                None if one is None else np.asarray(cv2.resize(one, size, interpolation=cv2.INTER_NEAREST), np.float32)
                for one in raw_vectors(image, where)
            )
            return forth, back

        pictures = (
            cv2.GaussianBlur(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), (0, 0), _BLUR_PX)
            for _, frame in (first, second)
        )  # fmt: skip
        before, now = (np.asarray(picture, np.uint8) for picture in pictures)
        return cls((before, now), field(first[0]), field(second[0]), scale)

    def is_coded(self) -> bool:
        """Whether vectors are coded as colours: 0 to 1, with 0.5 where nothing moves."""
        given = [field for field in (*self.first, *self.second) if field is not None]
        middle = [np.abs(np.median(field, (0, 1)) - 0.5).max() < _CODED_TOLERANCE for field in given]
        return all(middle) and all(field.min() >= 0 and field.max() <= 1 for field in given)

    def longest(self) -> float:
        """The largest component of the stored vectors."""
        given = [field for field in (*self.first, *self.second) if field is not None]
        return max(float(np.abs(np.nan_to_num(field, posinf=0, neginf=0)).max()) for field in given)

    def best(self, tried: list[_Candidate]) -> tuple[_Candidate, float, float]:
        """The candidate with the smallest error, with its errors as `misfit` returns them; of nearly equal ones the
        first. Another direction than the name says has to fit much better, because a steady motion fits both."""
        chosen, (least, still) = tried[0], self.misfit(tried[0])
        for candidate in tried[1:]:
            error, without = self.misfit(candidate)
            if error < (_BETTER if candidate.way == chosen.way else _OTHER_WAY) * least:
                chosen, least, still = candidate, error, without
        return chosen, least, still

    def misfit(self, candidate: _Candidate) -> tuple[float, float]:
        """Mean absolute difference between a frame and the other one, warped along the vectors and as it is, gray
        levels, where the vectors are not 0."""
        (forth, other), (given, back) = self.first, self.second
        if candidate.way == "next":
            forth, back = forth if forth is not None else other, None
        elif candidate.way == "previous":
            forth, back = None, back if back is not None else given
        found = signed(forth, back, candidate.factors)
        first, second = self.pictures
        errors = []
        if found.plus is not None:
            errors.append(_misfit(first, second, found.plus * np.float32(self.scale)))
        if found.minus is not None:
            errors.append(_misfit(second, first, -found.minus * np.float32(self.scale)))
        if not errors:
            return math.inf, 0.0
        return sum(one[0] for one in errors) / len(errors), sum(one[1] for one in errors) / len(errors)


def _misfit(here: Frame, there: Frame, way: Flow) -> tuple[float, float]:
    length = np.abs(way).max(-1)
    moves = length > _MOVES * length.max()
    if not moves.any():
        return 0.0, 0.0
    return _unlike(here, warp_back(there, way), moves), _unlike(here, there, moves)


def _unlike(one: Frame, other: Frame, where: Mask) -> float:
    apart = np.abs(one.astype(np.float32) - other).mean(-1)[where]
    return float(np.minimum(apart, _LIMIT_LEVELS).mean())  # what is covered fits in no convention
