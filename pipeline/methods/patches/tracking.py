"""Clusters of one frame from those of the frames before it: the heart of the method (zhang2011patches, section 4).

links       every pixel is linked by flow to the frames of the window before it; reliable links vote for a label
background  what moves as the dominant motion does, one plane motion for each pair of frames
walk        a random walk spreads the votes along edges of like motion, and stops where nothing is certain
newcomers   what can be tracked and has no label becomes clusters of its own, seeded at good corners
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Labels, Mask, Plane
from pipeline.methods.patches.links import Links, textured
from pipeline.methods.patches.newcomers import newcomers
from pipeline.methods.patches.params import PatchesParams
from pipeline.segmentation.components import absorb_specks
from pipeline.segmentation.foreground import CERTAIN, carry_foreground
from pipeline.segmentation.jit import kernel
from pipeline.segmentation.random_walk import Edges, motion_edges, vote
from pipeline.warp.homography import deviation, dominant, fit

BACKGROUND = 1
"""Label of the background; objects are 2, 3, ..."""
UNKNOWN_SHARE = 0.25
"""Weight of a link to something without a label, beside one to a label: what was unclear may become clear."""
COLOUR_UNIT = 12.0
"""Gray levels of a step of colour that keeps apart like a difference in motion of 1 px, where colour counts fully."""
BLUR_PX = 7
"""Flow is smooth over silhouettes this far, working px."""
ABRUPT_PX = 0.3
"""Range of the flow within BLUR_PX from which a silhouette is likely: links are doubtful there."""
DOUBT = 0.04
"""Weight of a doubtful link to a label: colour edges decide, and the link only where these say nothing."""
STRAY = 2.0
"""Tolerances from which what was background is background no more: between one and this, it stays what it was."""
TOLERATED = 3.0
"""Tolerance in medians of what the background differs by from its homography."""
FLAT_SHARE = 0.01
"""Weight of that doubt, beside a vote: more than the leak to nothing, less than any neighbour."""
COARSE_PX = 9
"""Untrackable places narrower than this belong to what is around them: they are the rims of moving things."""


@dataclass
class Tracker:
    """What is handed from frame to frame, for the window's frames by number.

    Attributes:
        maps: label maps; `grounds`: 2 = foreground, 1 = background, once a mask has said so.
        next_label: the next free one.
        begin: nothing before this frame counts: the shot's first, or a keyframe with a label map.
    """

    maps: dict[int, Labels] = field(default_factory=dict)
    grounds: dict[int, Labels] = field(default_factory=dict)
    next_label: int = BACKGROUND + 1
    begin: int = 0

    def correct(self, index: int, labels: Labels) -> Labels:
        """Start again from a label map that the user has corrected."""
        self.maps, self.begin = {index: labels}, index
        self.next_label = max(self.next_label, int(labels.max(initial=0)) + 1)
        return labels

    def trim(self, index: int, window: int) -> None:
        """Forget what no later frame is linked to."""
        self.maps = {key: labels for key, labels in self.maps.items() if key > index - window + 1}
        self.grounds = {key: ground for key, ground in self.grounds.items() if key > index - window + 1}


@dataclass(frozen=True)
class Sight:
    """What one frame shows, at the working size: its colours, motion to both neighbours and how reliable that is."""

    small: Frame
    textured: Mask
    ahead: tuple[Flow, Plane] | None
    back: tuple[Flow, Plane] | None

    @property
    def known(self) -> list[tuple[Flow, Plane]]:
        return [pair for pair in (self.ahead, self.back) if pair is not None]

    def trackable(self, least: float) -> Mask:
        """Pixels that have a reliable partner in a neighbouring frame."""
        found: Mask = np.zeros(self.small.shape[:2], np.bool_)
        for _, reliable in self.known:
            found |= reliable >= least
        return found


def look(links: Links, index: int, begin: int) -> Sight:
    """Frame `index`; nothing before frame `begin` counts."""
    small = links.small(index)
    return Sight(small, textured(small), links.ahead(index), links.back(index) if index > begin else None)


def edges_of(sight: Sight, params: PatchesParams) -> Edges:
    """Weights of the edges within the frame."""
    ahead, back = (None if pair is None else pair[0] for pair in (sight.ahead, sight.back))
    unit = COLOUR_UNIT / params.colour_edges if params.colour_edges > 0 else 0.0
    return motion_edges(ahead, back, sight.small, unit)


def track(tracker: Tracker, links: Links, index: int, params: PatchesParams, said: Plane | None = None) -> Labels:
    """Labels of frame `index`, int32 (h, w), 0 = unclustered; the tracker remembers them.

    Args:
        said: the user's mask of this frame, see `pipeline.segmentation.foreground`.
    """
    sight = look(links, index, tracker.begin)
    edges = edges_of(sight, params)
    choices, weights = link_votes(tracker.maps, links, index, sight, params)
    fore = _foreground(tracker, links, index, sight, edges, params, said)
    if fore is None:
        evidence = background_motion(sight, choices, weights, params)
        choices, weights = _background_votes(choices, weights, evidence)
    weights = np.where(abrupt(sight), np.where(choices > 0, weights * np.float32(DOUBT), 0), weights)
    if fore is not None:
        choices, weights = _masked_votes(choices, weights, fore)
    labels, _ = vote(choices, weights, edges)
    labels[_untrackable(sight, params) & (fore is None or fore)] = 0
    area = int(labels.size * params.smallest_cluster / 1000)
    labels = absorb_specks(labels, max(area // 12, 4), max(area // 3, 8))
    labels = _with_newcomers(tracker, labels, sight, edges, params, area, fore)
    tracker.maps[index] = absorb_specks(labels, 4, max(area // 3, 8))
    tracker.trim(index, params.window)
    return tracker.maps[index]


def _with_newcomers(
    tracker: Tracker, labels: Labels, sight: Sight, edges: Edges, params: PatchesParams, area: int, fore: Mask | None
) -> Labels:
    free = (labels == 0) & sight.textured & np.all([sure >= params.reliable for _, sure in sight.known], axis=0)
    if fore is not None:
        free = (labels == 0) & fore
    motion = [flow for flow, _ in sight.known]
    among = labels if fore is None else np.where(labels == BACKGROUND, 0, labels)
    fresh = newcomers(free, among, motion, edges, sight.small, area, tracker.next_label)
    labels = np.where(fresh > 0, fresh, labels).astype(np.int32)
    tracker.next_label = max(tracker.next_label, int(labels.max(initial=0)) + 1)
    return labels


def _foreground(
    tracker: Tracker, links: Links, index: int, sight: Sight, edges: Edges, params: PatchesParams, said: Plane | None
) -> Mask | None:
    """Where the foreground is, if a mask has ever said so in this shot; the tracker remembers it."""
    if said is None and not tracker.grounds:
        return None
    choices, weights = link_votes(tracker.grounds, links, index, sight, params)
    fore = carry_foreground(choices, weights, sight.small, edges, said)
    tracker.grounds[index] = np.where(fore, 2, 1).astype(np.int32)
    return fore


def _masked_votes(
    choices: NDArray[np.int32], weights: NDArray[np.float32], fore: Mask
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Votes as the mask allows: the background is background, and nothing else is."""
    wrong = (choices == BACKGROUND) == fore
    weights = np.where(wrong, 0, weights).astype(np.float32)
    choices[0], weights[0] = np.where(fore, 0, BACKGROUND), np.where(fore, 0, CERTAIN)
    return choices, weights


def link_votes(
    maps: Mapping[int, Labels], links: Links, index: int, sight: Sight, params: PatchesParams
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """For each gap in the window, the label that each pixel is linked to and the weight of the link: (k, h, w) each.

    Seeds are links with R at or above `params.reliable`; the weight is lambda R.
    """
    choices, weights = [np.zeros(sight.small.shape[:2], np.int32)], [np.zeros(sight.small.shape[:2], np.float32)]
    for gap in range(1, params.window):
        before, pair = maps.get(index - gap), links.back(index, gap)
        if before is None or pair is None:
            continue
        flow, reliable = pair
        choice = carry_labels(before, flow)
        weight = np.where(reliable >= params.reliable, params.interframe * reliable, 0)
        choices.append(choice)
        weights.append(np.where(choice > 0, weight, weight * UNKNOWN_SHARE).astype(np.float32))
    return np.stack(choices), np.stack(weights)


def carry_labels(labels: Labels, flow: Flow, at: tuple[int, int] = (0, 0)) -> Labels:
    """The label where each pixel's flow leads, to the nearest pixel: int32 (h, w); `at` is (x, y) of the first one."""
    out = np.empty(flow.shape[:2], np.int32)
    _follow(labels, flow, *at, out)
    return out


@kernel
def _follow(labels: Labels, flow: Flow, left: int, top: int, out: Labels) -> None:
    height, width = labels.shape
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            column = int(np.rint(left + x + flow[y, x, 0]))
            row = int(np.rint(top + y + flow[y, x, 1]))
            out[y, x] = labels[min(max(row, 0), height - 1), min(max(column, 0), width - 1)]


@dataclass(frozen=True)
class Ground:
    """Evidence for the background.

    Attributes:
        fits: bool (h, w), what is reliable moves as the background does.
        odd: something reliable moves otherwise.
        strays: so much so that what was background is so no more.
    """

    fits: Mask
    odd: Mask
    strays: Mask


def background_motion(
    sight: Sight, choices: NDArray[np.int32], weights: NDArray[np.float32], params: PatchesParams
) -> Ground:
    """Where everything reliable moves as the background does, and where something reliable does not.

    The background's motion is the homography of what voted for it; in a first frame, of what most pixels do. It is
    exact only of a flat world, so the tolerance grows with what the background itself differs by.
    """
    was = ((choices == BACKGROUND) & (weights > 0)).any(axis=0)
    fits, odd, strays = (np.zeros(was.shape, np.bool_) for _ in range(3))
    for flow, reliable in sight.known:
        linked = reliable >= params.reliable
        sure = linked & sight.textured
        off, tolerance = _off_background(flow, sure, was, params.motion_tolerance)
        near = cv2.GaussianBlur(off, (0, 0), 1.0)
        fits |= linked & (near <= tolerance)
        odd |= sure & (near > tolerance)
        strays |= sure & (near > STRAY * tolerance)
    return Ground(fits & ~odd, odd, strays)


def _off_background(flow: Flow, sure: Mask, was: Mask, least_px: float) -> tuple[Plane, float]:
    """Distance of the flow from the background's homography, float32 (h, w), and what of it is tolerable, px."""
    basis = sure & was
    known = int(basis.sum()) >= 0.05 * basis.size
    here, moved = _moved(flow, basis if known else sure)
    off = deviation(flow, (fit if known else dominant)(here, moved))
    usual = float(np.median(off[basis][::7])) if known else 0.0
    return off, min(max(least_px, TOLERATED * usual), 4 * least_px)


def _moved(flow: Flow, where: Mask) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Some thousand of the pixels, evenly chosen, and where they go: (n, 2) each."""
    places = np.flatnonzero(where)
    places = places[:: max(1, len(places) // 3000)]
    here = np.stack([places % where.shape[1], places // where.shape[1]], axis=1).astype(np.float64)
    return here, here + flow.reshape(-1, 2)[places]


def abrupt(sight: Sight) -> Mask:
    """Where motion changes within a few px, in either direction of time: near silhouettes."""
    found = np.zeros(sight.small.shape[:2], np.bool_)
    around = np.ones((BLUR_PX, BLUR_PX), np.uint8)
    for flow, _ in sight.known:
        span = cv2.dilate(flow, around) - cv2.erode(flow, around)
        found |= np.maximum(span[..., 0], span[..., 1]) > ABRUPT_PX
    return found


def _untrackable(sight: Sight, params: PatchesParams) -> Mask:
    """Places of some size that have no reliable partner in either neighbouring frame."""
    lost = (~sight.trackable(params.reliable)).astype(np.uint8)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (COARSE_PX, COARSE_PX))
    return np.asarray(cv2.morphologyEx(lost, cv2.MORPH_OPEN, disc) > 0)


def _background_votes(
    choices: NDArray[np.int32], weights: NDArray[np.float32], ground: Ground
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Votes for the background count where the motion is its own.

    Where no object has a say, the motion itself is a vote: for the background, or for nothing. Where motion cannot be
    seen, the background has the benefit of the doubt.
    """
    wrong = ground.strays & (choices == BACKGROUND)
    choices = np.where(wrong, 0, choices).astype(np.int32)
    claimed = ((choices > 0) & (weights > 0)).any(axis=0)
    choices[0] = np.where(ground.fits, BACKGROUND, 0)
    weights[0] = (ground.fits | ground.odd) & ~claimed
    flat = ~(ground.fits | ground.odd | claimed)
    choices[0][flat], weights[0][flat] = BACKGROUND, FLAT_SHARE
    return choices, weights
