"""Hands and arms: pieces of skin beside a face, found by the colour of that face.

Departure: the papers use faces only, and OpenCV has no detector of hands. A hand has the colour of its owner's face in
the same light, so that no table of skin colours is needed, and it is within the reach of the owner's arms.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.colour.lab8 import LabPlanes, rgb_to_lab8
from pipeline.frames import Frame, Plane
from pipeline.kernels.jit import kernel
from pipeline.kernels.selection import column_medians, upper_median
from pipeline.perception.faces import Faces
from pipeline.perception.shrink import shrink, size_within


class SkinParams(NamedTuple):
    """Constants of the search for hands and arms. Colours are CIELAB units."""

    side_px: int = 256
    """Longer side of the picture in which hands are searched, px."""
    middle: np.float32 = np.float32(128)
    """Level of a = 0 and b = 0 in 8-bit CIELAB."""
    least_face_px: float = 12.0
    """Width of a face in the searched picture below which its hands are too small to be found."""
    finest_face_px: float = 64.0
    """Width of a face in the searched picture from which on half of the resolution shows hands as well."""
    least_chroma: float = 7.0
    """Least chroma of a face (CIELAB) for this search. Below it, as in black-and-white films, many things have its
    colour."""
    least_detections: int = 2
    """Detections of a face before its hands are searched. A false face is rarely detected twice."""
    least_red: float = 2.0
    least_yellow: float = 2.0
    """Least a and b (CIELAB) of a face: what looks like one in leaves or grass is greener."""
    cheeks: tuple[float, float, float] = (0.3, 0.0, 0.28)
    """The part of a detected box that is surely skin, as fractions of the box's side: its half width, and the
    distances of its top and bottom below the centre."""
    chroma_spread: float = 1.5
    least_spread: float = 4.5
    most_spread: float = 7.0
    """Standard deviation of skin in a and b (CIELAB): this many times the median deviation in the cheeks, within
    limits."""
    darkest: float = 0.45
    lightest: float = 1.3
    """Lightness of skin elsewhere, relative to the face's."""
    reach: float = 4.5
    below: float = 2.0
    """The ellipse within which hands are searched, as fractions of the box's sides: its semi-axes, and how far its
    centre is below the face's."""
    least_area: float = 0.08
    most_area: float = 3.0
    """Least and largest area of a hand or arm, in areas of the box: a hand that is half hidden, two bare arms.
    Walls of the same colour are larger."""
    least_likelihood: float = 0.35
    """Likelihood, 0..1, from which on a pixel counts as skin."""
    farthest: float = 1.1 * math.log(1 / least_likelihood)
    """Distance from the face's colour, in the exponent of the likelihood, beyond which no pixel has that likelihood."""
    wider: float = 0.12
    soft: float = 0.12
    """Radius of the mask's dilation, which covers the blurred outlines of moving fingers, and standard deviation of the
    mask's blur; both as fractions of the box's side."""
    blur_reach: int = 4
    """Radius of OpenCV's Gaussian of 32-bit values, in standard deviations."""


SKIN = SkinParams()


class _Person(NamedTuple):
    """A face whose hands are searched: its number, the colour of its cheeks, 8-bit CIELAB levels, twice the variance of
    a and b in them, and its box in px of the searched picture."""

    face: int
    colour: NDArray[np.float32]
    spread: float
    box: NDArray[np.float64]


def skin_beside_faces(picture: Frame, faces: Faces, size: tuple[int, int]) -> Plane | None:
    """Soft mask of hands and arms, times the strengths of their faces; None without any.

    Args:
        picture: uint8 RGB (h, w, 3), the frame or a smaller version of it.
        size: (width, height) of the frame in whose pixels the faces are given.

    Returns: float32, 0..1, at most `SKIN.side_px` on the longer side, or half of that if all these faces are large.
    """
    searched = size_within(size, SKIN.side_px)
    widths = faces["box"][:, 2] * (searched[0] / size[0])
    chosen = np.flatnonzero((widths >= SKIN.least_face_px) & (faces["detections"] >= SKIN.least_detections))
    if chosen.size and widths[chosen].min() >= SKIN.finest_face_px:
        searched = searched[0] // 2, searched[1] // 2
    boxes = faces["box"] * np.tile(np.divide(searched, size), 2)
    lab = rgb_to_lab8(shrink(picture, searched)) if chosen.size else np.empty((3, 0, 0), np.uint8)
    people = [person for face in chosen if (person := _person(lab, int(face), boxes[face])) is not None]
    masks = []
    for person, skin in zip(people, _marked(lab, people), strict=True):
        kept = _pieces(skin, person.box)
        if kept is not None:
            masks.append(np.float32(faces["strength"][person.face]) * _softened(kept, person.box))
    return np.maximum.reduce(masks) if masks else None


def _person(lab: LabPlanes, face: int, box: NDArray[np.float64]) -> _Person | None:
    """The person with that face; None if it has not the colour of skin or hardly any pixels."""
    cx, cy, w, h = box
    half, top, bottom = SKIN.cheeks
    rows = slice(max(0, round(cy + top * h)), max(0, round(cy + bottom * h) + 1))
    columns = slice(max(0, round(cx - half * w)), max(0, round(cx + half * w) + 1))
    cheeks = lab[:, rows, columns].reshape(3, -1).astype(np.float32)
    if cheeks.shape[1] < 4:
        return None
    colour = column_medians(cheeks.T)
    red, yellow = colour[1] - SKIN.middle, colour[2] - SKIN.middle
    if np.hypot(red, yellow) < SKIN.least_chroma or red < SKIN.least_red or yellow < SKIN.least_yellow:
        return None
    spread = SKIN.chroma_spread * float(upper_median(np.abs(cheeks[1:] - colour[1:, None])))
    spread = min(max(spread, SKIN.least_spread), SKIN.most_spread)
    return _Person(face, colour, 2 * spread * spread, box)


def _marked(lab: LabPlanes, people: Sequence[_Person]) -> NDArray[np.uint8]:
    """1 where a pixel has the colour of a person's skin, within reach of the arms: uint8 (people, h, w).

    The kernel runs without people, too, so that it is compiled before the first face.
    """
    skin = np.zeros((len(people), *lab.shape[1:]), np.uint8)
    colours = np.array([(*person.colour, person.spread) for person in people], np.float32).reshape(-1, 4)
    boxes = np.array([person.box for person in people], np.float32).reshape(-1, 4)
    _mark_skin(lab, colours, boxes, skin)
    return skin


@kernel
def _mark_skin(
    lab: LabPlanes, colours: NDArray[np.float32], boxes: NDArray[np.float32], skin: NDArray[np.uint8]
) -> None:  # fmt: skip
    """Write the marks. The likelihood of skin is that of the colour, times 1 where the arms reach to, which falls to 0
    at one and a half times that distance.

    Args:
        colours: float32 (people, 4): L, a, b, and twice the variance of a and b.
        boxes: float32 (people, 4): centre x, centre y, width, height, px.
    """
    height, width = skin.shape[1], skin.shape[2]
    across = np.empty(width, np.float32)
    for person in range(skin.shape[0]):
        cx, cy, w, h = boxes[person]
        own_light, own_a, own_b, spread = colours[person]
        darkest, lightest = np.float32(SKIN.darkest) * own_light, np.float32(SKIN.lightest) * own_light
        for x in range(width):
            across[x] = ((np.float32(x) + np.float32(0.5) - cx) / (np.float32(SKIN.reach) * w)) ** 2
        for y in range(height):
            down = (
                (np.float32(y) + np.float32(0.5) - cy - np.float32(SKIN.below) * h) / (np.float32(SKIN.reach) * h)
            ) ** 2
            if down > np.float32(2.25):
                continue
            light, red, yellow = lab[0, y], lab[1, y], lab[2, y]
            for x in range(width):
                a, b = np.float32(red[x]) - own_a, np.float32(yellow[x]) - own_b
                away = (a * a + b * b) / spread
                if away > np.float32(SKIN.farthest) or light[x] < darkest or light[x] > lightest:
                    continue
                reach = min(np.float32(3) - np.float32(2) * np.sqrt(across[x] + down), np.float32(1))
                skin[person, y, x] = np.exp(-away) * reach > np.float32(SKIN.least_likelihood)


def _pieces(skin: NDArray[np.uint8], box: NDArray[np.float64]) -> NDArray[np.uint8] | None:
    """1 in the connected pieces of skin that have the area of hands or arms and are not the face; None without any."""
    cx, cy, w, h = box
    part = _around(skin, 0)
    count, components = cv2.connectedComponents(skin[part], connectivity=8)
    pieces = np.asarray(components, np.int32)
    areas = np.zeros(count, np.int64)
    _measure_areas(pieces, areas)
    hands = ((areas >= SKIN.least_area * w * h) & (areas <= SKIN.most_area * w * h)).astype(np.uint8)
    hands[0] = 0
    y, x = (min(max(round(at), 0), side - 1) for at, side in zip((cy, cx), skin.shape, strict=True))
    if skin[y, x]:
        hands[pieces[y - part[0].start, x - part[1].start]] = 0
    if not np.count_nonzero(hands):
        return None
    out = np.zeros_like(skin)
    _mark_pieces(pieces, hands, out[part])
    return out


@kernel
def _measure_areas(pieces: NDArray[np.int32], areas: NDArray[np.int64]) -> None:
    """Add the number of pixels of each piece to `areas`, runs of one piece at once."""
    for y in range(pieces.shape[0]):
        own, run = np.int32(0), 0
        for x in range(pieces.shape[1]):
            if pieces[y, x] != own:
                areas[own] += run
                own, run = pieces[y, x], 0
            run += 1
        areas[own] += run


@kernel
def _mark_pieces(pieces: NDArray[np.int32], chosen: NDArray[np.uint8], out: NDArray[np.uint8]) -> None:
    for y in range(pieces.shape[0]):
        for x in range(pieces.shape[1]):
            out[y, x] = chosen[pieces[y, x]]


def _softened(hands: NDArray[np.uint8], box: NDArray[np.float64]) -> Plane:
    """Wider hands with soft outlines: float32, 0..1."""
    radius, sigma = round(SKIN.wider * box[2]), max(SKIN.soft * box[2], 0.5)
    part = _around(hands, radius + math.ceil(SKIN.blur_reach * sigma) + 1)
    wider = cv2.dilate(hands[part], cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1)))
    out = np.zeros(hands.shape, np.float32)
    out[part] = cv2.GaussianBlur(wider.astype(np.float32), (0, 0), sigma)
    return out


def _around(mask: NDArray[np.uint8], margin: int) -> tuple[slice, slice]:
    """Rows and columns of the pixels that are not 0, and of that many px around them."""
    x, y, width, height = cv2.boundingRect(mask)
    rows = slice(max(0, y - margin), min(mask.shape[0], y + height + margin))
    return rows, slice(max(0, x - margin), min(mask.shape[1], x + width + margin))
