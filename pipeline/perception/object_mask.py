"""The object under a click, or in a box, of a frame.

The frame is segmented from fine to coarse by graph segmentation (Felzenszwalb and Huttenlocher 2004). Each segmentation
proposes an object: the segment that is clicked, or the segments in the box. The proposal whose outline has the
strongest contrast is chosen, and its outline is decided again by iterated graph cuts (Rother, Kolmogorov, Blake 2004,
"GrabCut"). Both are OpenCV's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from math import ceil
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Labels, Mask

Box = tuple[float, float, float, float]
"""Left, top, right, bottom, as fractions of the frame's sides."""

THREADS = 4
"""Number of segmentations that are made at the same time."""


class ObjectParams(NamedTuple):
    """Constants of the search; lengths as shares of the longer side."""

    click: float = 0.005
    """Side of a box up to which it is a click, and radius around a click that is the object."""
    scales: tuple[float, float, int] = (30, 20_000, 14)
    """Smallest and largest scale of the segmentations, and their number."""
    sigma_px: float = 0.5
    """Blur before a segmentation."""
    least_px: int = 20
    """Size of the smallest segment, and of the smallest object, px."""
    window_px: int = 7
    """Side of the windows in which the colours inside and outside an outline are compared, px."""
    size: float = 0.2
    """Power of a proposal's size that weighs its contrast: the larger of two with the same contrast is the object."""
    most: float = 0.8
    """Largest share of the frame that an object has."""
    least: float = 0.25
    """Smallest share of a box that its object has. If no proposal does, the graph cuts divide the box."""
    middle: float = 0.25
    """Sides, as shares of the box, of the ellipse in its middle that is the object if nothing else was found."""
    within: float = 0.9
    """Share of a segment that lies in the box if it is of the object."""
    partly: float = 0.4
    """The same, if the box cuts the object."""
    along: float = 0.3
    """Largest share of the edge of a box that lies in one segment of the object."""
    band: float = 0.012
    """Distance from the outline up to which the graph cuts decide."""
    around: float = 0.05
    """Distance from the object up to which its surroundings give the colours of the background."""
    rounds: int = 2
    """Number of iterations of the graph cuts."""


OBJECT = ObjectParams()


def object_mask(frame: Frame, box: Box, other: Mask | None = None, before: Mask | None = None) -> Mask:
    """Pixels of the object: bool (h, w). The same arguments give the same pixels.

    Args:
        frame: uint8 (h, w, 3).
        box: around the object: nothing outside is part of it. Or a click on it, a box of about no size: then the part
            that is connected with it. Corners may be in any order.
        other: bool (h, w), pixels that are not part of the object.
        before: bool (h, w), what has been found of the object already: a click adds to it.
    """
    inside = clicked_pixels(frame, box)
    outside = np.zeros_like(inside) if other is None else other & ~inside
    if not _is_click(frame, box):
        outside |= ~inside
        segmentations = list(_segmentations(frame))
        found = _in_box(frame, segmentations, inside, outside, OBJECT.within)
        if found is None:
            anywhere = _cut(frame, inside & ~outside, outside, np.zeros_like(inside))
            if anywhere.sum() >= OBJECT.least * inside.sum():
                return anywhere
            found = _in_box(frame, segmentations, inside, outside, OBJECT.partly)
        if found is None:
            return _cut(frame, inside & ~outside, outside, _middle(frame, box) & ~outside)
        return _cut(frame, found, outside)
    known = np.zeros_like(inside) if before is None else before
    proposals = (_clicked(labels, inside, outside) for labels in _segmentations(frame))
    found = _best(frame, proposals, lambda proposal: proposal | known)
    found = _cut(frame, inside if found is None else found | known, outside) | inside | known
    _, parts = cv2.connectedComponents(found.astype(np.uint8), connectivity=4)
    return np.asarray((np.isin(parts, parts[inside]) & found) | known)


def without_object(frame: Frame, mask: Mask, box: Box, kept: Mask) -> Mask:
    """The mask without the object under a click, or in a box: bool (h, w).

    What is clicked is found by the contrast of what is left, if something is `kept`; else by its own.

    Args:
        kept: bool (h, w), pixels that stay in the mask.
    """
    inside = clicked_pixels(frame, box)
    others = kept & ~inside
    if not (_is_click(frame, box) and others.any()):
        return np.asarray(mask & (others | ~object_mask(frame, box, others)))
    proposals = (_clicked(labels, inside, others) for labels in _segmentations(frame))
    found = _best(frame, proposals, lambda proposal: mask & ~proposal)
    return np.asarray(mask & ~(inside if found is None else found))


def _is_click(frame: Frame, box: Box) -> bool:
    height, width = frame.shape[:2]
    sides = abs(box[2] - box[0]) * width, abs(box[3] - box[1]) * height
    return bool(max(sides) <= OBJECT.click * max(frame.shape))


def clicked_pixels(frame: Frame, box: Box) -> Mask:
    """Pixels of a box, or of the disc around a click."""
    height, width = frame.shape[:2]
    (left, right), (top, bottom) = sorted(box[::2]), sorted(box[1::2])
    pixels = np.zeros((height, width), np.uint8)
    if _is_click(frame, box):
        at = (min(int(left * width), width - 1), min(int(top * height), height - 1))
        cv2.circle(pixels, at, max(1, round(OBJECT.click * max(frame.shape))), 1, -1)
    else:
        pixels[int(top * height) : ceil(bottom * height), int(left * width) : ceil(right * width)] = 1
    return pixels > 0


def _segmentations(frame: Frame) -> Iterable[Labels]:
    """Labels of the segments, fine to coarse: int32 (h, w)."""
    colours = cv2.cvtColor(frame, cv2.COLOR_RGB2Lab)

    def segment(scale: float) -> Labels:
        segments = cv2.ximgproc.segmentation.createGraphSegmentation(OBJECT.sigma_px, scale, OBJECT.least_px)
        return np.asarray(segments.processImage(colours), np.int32)

    with ThreadPoolExecutor(THREADS) as pool:
        yield from pool.map(segment, np.geomspace(*OBJECT.scales).tolist())


def _clicked(labels: Labels, inside: Mask, outside: Mask) -> Mask:
    """The segments with pixels of `inside`; none if one of them has pixels of `outside`, too."""
    found = np.isin(labels, labels[inside])
    return np.asarray(found & ~(found & outside).any())


def _in_box(frame: Frame, segmentations: Sequence[Labels], inside: Mask, outside: Mask, within: float) -> Mask | None:
    """The best proposal of segments that lie in the box with at least this share of their size; None: there is none.
    What runs along the edge of the box is the background; that of the whole frame tells nothing."""
    inner = cv2.erode(inside.astype(np.uint8), np.ones((3, 3)), borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
    edge = inside & ~inner if outside.any() else np.zeros_like(inside)
    proposals = []
    for labels in segmentations:
        sizes = np.bincount(labels.ravel())
        own = np.bincount(labels[inside], minlength=len(sizes))
        along = np.bincount(labels[edge], minlength=len(sizes))
        chosen = (own >= within * sizes) & (along <= OBJECT.along * edge.sum())
        proposals.append(chosen[labels] & ~outside)
    least = OBJECT.least * inside.sum()
    return _best(frame, (one for one in proposals if one.sum() >= least))


def _best(frame: Frame, proposals: Iterable[Mask], result: Callable[[Mask], Mask] = np.asarray) -> Mask | None:
    """The proposal whose result has the strongest contrast; None: there is none."""
    colours = np.asarray(cv2.cvtColor(frame.astype(np.float32) / 255, cv2.COLOR_RGB2Lab), np.float32)
    best, most = None, 0.0
    for proposal in proposals:
        contrast = _contrast(colours, result(proposal)) if proposal.any() else 0.0
        if contrast > most:
            best, most = proposal, contrast
    return best


def _contrast(colours: NDArray[np.float32], mask: Mask) -> float:
    """Mean colour difference across the outline, which has none along the frame's edge, weighted by the mask's size.

    Args:
        colours: float32 (h, w, 3), CIELAB.
    """
    share = float(mask.mean())
    if mask.sum() < OBJECT.least_px or share > OBJECT.most:
        return 0.0
    window = (OBJECT.window_px, OBJECT.window_px)
    own = mask.astype(np.float32)
    part = cv2.blur(own, window)
    inner, whole = cv2.blur(colours * own[..., None], window), cv2.blur(colours, window)
    outline = (cv2.dilate(own, np.ones((3, 3))) > 0) & ~mask
    weights = part[outline][:, None]
    inside = inner[outline] / np.maximum(weights, 1e-6)
    outside = (whole[outline] - inner[outline]) / np.maximum(1 - weights, 1e-6)
    edge = sum(int(mask[side].sum()) for side in (0, -1, (slice(None), 0), (slice(None), -1)))
    difference = float(np.linalg.norm(inside - outside, axis=1).sum()) / (len(weights) + edge)
    return float(difference * mask.sum() ** OBJECT.size * (1 - share))


def _middle(frame: Frame, box: Box) -> Mask:
    """The ellipse in the middle of a box."""
    height, width = frame.shape[:2]
    at = round((box[0] + box[2]) / 2 * width), round((box[1] + box[3]) / 2 * height)
    sides = abs(box[2] - box[0]) * width, abs(box[3] - box[1]) * height
    axes = [max(1, round(OBJECT.middle / 2 * side)) for side in sides]
    return cv2.ellipse(np.zeros((height, width), np.uint8), at, axes, 0, 0, 360, 1, -1) > 0


def _cut(frame: Frame, found: Mask, outside: Mask, sure: Mask | None = None) -> Mask:
    """The object with its outline decided again, by colours of the object and of its surroundings.

    Args:
        found: where it may be.
        outside: where it is not.
        sure: where it is; None: in all of `found` but a band along its outline.
    """
    band, around = (max(2, round(share * max(frame.shape))) for share in (OBJECT.band, OBJECT.around))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * band + 1, 2 * band + 1))
    own = found.astype(np.uint8)
    labels = np.where(found, np.uint8(cv2.GC_PR_FGD), np.uint8(cv2.GC_PR_BGD))
    labels[(cv2.dilate(own, disc) == 0) | outside] = cv2.GC_BGD
    if sure is not None:  # there is a background always
        labels[[0, -1]] = labels[:, [0, -1]] = cv2.GC_BGD
    labels[cv2.erode(own, disc, borderType=cv2.BORDER_REPLICATE) > 0 if sure is None else sure] = cv2.GC_FGD
    left, top, width, height = cv2.boundingRect(own)
    part = (
        slice(max(top - around, 0), top + height + around),
        slice(max(left - around, 0), left + width + around),
    )
    piece = np.ascontiguousarray(labels[part])
    if not found.any() or np.isin(piece, (cv2.GC_FGD, cv2.GC_PR_FGD)).all():
        return found
    cv2.setRNGSeed(0)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(np.ascontiguousarray(frame[part]), piece, (0, 0, 1, 1), *models, OBJECT.rounds, cv2.GC_INIT_WITH_MASK)
    labels[part] = piece
    return np.isin(labels, (cv2.GC_FGD, cv2.GC_PR_FGD))
