"""Label map of a frame from those of the preceding frames (zhang2011patches, section 4).

links       optical flow links every pixel to the preceding frames of the window; reliable links vote for a label
background  pixels that follow the dominant homography of the frame pair
walk        a random walk spreads the votes between pixels of similar motion; uncertain pixels stay unclustered
newcomers   trackable pixels without a label form new clusters, seeded at corners
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Labels, Mask, Plane
from pipeline.jit import kernel
from pipeline.methods.patches.links import Links, textured
from pipeline.methods.patches.newcomers import newcomers
from pipeline.methods.patches.params import PatchesParams
from pipeline.segmentation.components import absorb_specks
from pipeline.segmentation.foreground import CERTAIN, carry_foreground
from pipeline.segmentation.random_walk import Edges, motion_edges, vote
from pipeline.warp.homography import deviation, dominant, fit

BACKGROUND = 1
"""Label of the background; objects are 2, 3, ..."""
UNKNOWN_SHARE = 0.25
"""Weight of a link to an unclustered pixel, relative to a labelled one. It is low, so that labels can spread there."""
COLOUR_UNIT = 12.0
"""Colour difference, gray levels, that separates pixels as much as a motion difference of 1 px, at full weight."""
BLUR_PX = 7
"""Window, working px, over which optical flow is blurred across silhouettes."""
ABRUPT_PX = 0.3
"""Range of the flow within `BLUR_PX`, working px, above which a silhouette is likely and links are unreliable."""
DOUBT = 0.04
"""Factor on the weight of links near silhouettes. It lets colour edges decide wherever they exist."""
STRAY = 2.0
"""Deviation from the background motion, in tolerances, above which a pixel loses the background label (hysteresis)."""
TOLERATED = 3.0
"""Tolerance, as a multiple of the background's median deviation from its homography."""
FLAT_SHARE = 0.01
"""Weight of the background vote where motion is not visible: above the random walk's leak, below any neighbour."""
COARSE_PX = 9
"""Untrackable areas narrower than this, working px, are rims of moving objects and take the label around them."""


@dataclass
class Tracker:
    """State that is passed from frame to frame.

    Attributes:
        maps: label maps of the window's frames, int32 (h, w), by frame number.
        grounds: foreground maps by frame number, int32 (h, w), 2 = foreground, 1 = background; empty before the first
            user mask of the shot.
        next_label: the next unused label.
        uncertainty: uncertainty of each label in the last frame, see `uncertainty_of`.
        begin: first frame that is used: the shot's first frame, or the last keyframe with a corrected label map.
    """

    maps: dict[int, Labels] = field(default_factory=dict)
    grounds: dict[int, Labels] = field(default_factory=dict)
    next_label: int = BACKGROUND + 1
    begin: int = 0
    uncertainty: dict[int, float] = field(default_factory=dict)

    def correct(self, index: int, labels: Labels) -> Labels:
        """Restart tracking from a label map corrected by the user."""
        self.maps, self.begin = {index: labels}, index
        self.uncertainty = dict.fromkeys((int(label) for label in np.unique(labels) if label), 0.0)
        self.next_label = max(self.next_label, int(labels.max(initial=0)) + 1)
        return labels

    def trim(self, index: int, window: int) -> None:
        """Drop the maps of frames that have left the window."""
        self.maps = {key: labels for key, labels in self.maps.items() if key > index - window + 1}
        self.grounds = {key: ground for key, ground in self.grounds.items() if key > index - window + 1}


@dataclass(frozen=True)
class FrameEvidence:
    """Observations of one frame at the working size.

    Attributes:
        small: the frame, uint8 (h, w, 3).
        textured: bool (h, w), pixels with enough texture to see motion.
        ahead, back: flow to the next and to the previous frame, with its reliability; None at the ends of the shot.
    """

    small: Frame
    textured: Mask
    ahead: tuple[Flow, Plane] | None
    back: tuple[Flow, Plane] | None

    @property
    def known(self) -> list[tuple[Flow, Plane]]:
        return [pair for pair in (self.ahead, self.back) if pair is not None]

    def trackable(self, least: float) -> Mask:
        """Pixels linked to a neighbouring frame with reliability of at least `least`: bool (h, w)."""
        found: Mask = np.zeros(self.small.shape[:2], np.bool_)
        for _, reliable in self.known:
            found |= reliable >= least
        return found


def frame_evidence(links: Links, index: int, begin: int) -> FrameEvidence:
    """Observations of frame `index`; frames before `begin` are ignored."""
    small = links.small(index)
    return FrameEvidence(small, textured(small), links.ahead(index), links.back(index) if index > begin else None)


def edges_of(evidence: FrameEvidence, params: PatchesParams) -> Edges:
    """Edge weights of the random walk between neighbouring pixels of the frame."""
    ahead, back = (None if pair is None else pair[0] for pair in (evidence.ahead, evidence.back))
    unit = COLOUR_UNIT / params.colour_edges if params.colour_edges > 0 else 0.0
    return motion_edges(ahead, back, evidence.small, unit)


def track(tracker: Tracker, links: Links, index: int, params: PatchesParams, said: Plane | None = None) -> Labels:
    """Compute the labels of frame `index`, int32 (h, w), 0 = unclustered, and store them in the tracker.

    Args:
        said: the user's foreground mask of this frame, see `pipeline.segmentation.foreground`; None = no mask.
    """
    evidence = frame_evidence(links, index, tracker.begin)
    edges = edges_of(evidence, params)
    choices, weights = link_votes(tracker.maps, links, index, evidence, params)
    fore = _foreground(tracker, links, index, evidence, edges, params, said)
    if fore is None:
        ground = background_motion(evidence, choices, weights, params)
        choices, weights = _background_votes(choices, weights, ground)
    weights = np.where(abrupt(evidence), np.where(choices > 0, weights * np.float32(DOUBT), 0), weights)
    if fore is not None:
        choices, weights = _masked_votes(choices, weights, fore)
    labels, probability = vote(choices, weights, edges)
    labels[_untrackable(evidence, params) & (fore is None or fore)] = 0
    area = int(labels.size * params.smallest_cluster / 1000)
    labels = absorb_specks(labels, max(area // 12, 4), max(area // 3, 8))
    labels = _with_newcomers(tracker, labels, evidence, edges, params, area, fore)
    tracker.maps[index] = absorb_specks(labels, 4, max(area // 3, 8))
    tracker.uncertainty = uncertainty_of(tracker.maps[index], probability)
    tracker.trim(index, params.window)
    return tracker.maps[index]


def uncertainty_of(labels: Labels, probability: Plane) -> dict[int, float]:
    """Mean uncertainty of each label in a frame: 0 = certain, 1 = the label has a probability of 0.5 or less.

    Args:
        probability: float32 (h, w), probability of the label chosen by the random walk, at least 0.5 where it chose
            one. Pixels that were labelled otherwise (new clusters, absorbed specks) count as uncertain.
    """
    doubt = 2 * (1 - np.clip(probability, 0.5, 1))
    areas, sums = np.bincount(labels.ravel()), np.bincount(labels.ravel(), weights=doubt.ravel())
    return {int(k): round(float(sums[k] / areas[k]), 3) for k in np.flatnonzero(areas[1:]) + 1}


def _with_newcomers(
    tracker: Tracker,
    labels: Labels,
    evidence: FrameEvidence,
    edges: Edges,
    params: PatchesParams,
    area: int,
    fore: Mask | None,
) -> Labels:
    free = (labels == 0) & evidence.textured & np.all([sure >= params.reliable for _, sure in evidence.known], axis=0)
    if fore is not None:
        free = (labels == 0) & fore
    motion = [flow for flow, _ in evidence.known]
    among = labels if fore is None else np.where(labels == BACKGROUND, 0, labels)
    fresh = newcomers(free, among, motion, edges, evidence.small, area, tracker.next_label)
    labels = np.where(fresh > 0, fresh, labels).astype(np.int32)
    tracker.next_label = max(tracker.next_label, int(labels.max(initial=0)) + 1)
    return labels


def _foreground(
    tracker: Tracker,
    links: Links,
    index: int,
    evidence: FrameEvidence,
    edges: Edges,
    params: PatchesParams,
    said: Plane | None,
) -> Mask | None:
    """Foreground of the frame, bool (h, w), stored in the tracker; None if the shot has had no user mask so far."""
    if said is None and not tracker.grounds:
        return None
    choices, weights = link_votes(tracker.grounds, links, index, evidence, params)
    fore = carry_foreground(choices, weights, evidence.small, edges, said)
    tracker.grounds[index] = np.where(fore, 2, 1).astype(np.int32)
    return fore


def _masked_votes(
    choices: NDArray[np.int32], weights: NDArray[np.float32], fore: Mask
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Restrict votes by the foreground mask: label `BACKGROUND` outside the foreground, all other labels inside."""
    wrong = (choices == BACKGROUND) == fore
    weights = np.where(wrong, 0, weights).astype(np.float32)
    choices[0], weights[0] = np.where(fore, 0, BACKGROUND), np.where(fore, 0, CERTAIN)
    return choices, weights


def link_votes(
    maps: Mapping[int, Labels], links: Links, index: int, evidence: FrameEvidence, params: PatchesParams
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Votes of the preceding frames: labels int32 (k, h, w) and weights float32 (k, h, w).

    Plane 0 is empty, for the background's vote; each further plane is one gap of the window. Links with reliability R
    of at least `params.reliable` vote with weight lambda R; all others have weight 0.
    """
    choices, weights = [np.zeros(evidence.small.shape[:2], np.int32)], [np.zeros(evidence.small.shape[:2], np.float32)]
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
    """Sample labels at the flow's targets, nearest neighbour: int32 (h, w).

    Args:
        at: position (x, y) of the flow's top left pixel in the frame, px.
    """
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
    """Pixels by their agreement with the background's motion, bool (h, w) each.

    Attributes:
        fits: reliable flow agrees with the background's motion.
        odd: reliable flow deviates by more than the tolerance.
        strays: reliable flow deviates by more than `STRAY` tolerances.
    """

    fits: Mask
    odd: Mask
    strays: Mask


def background_motion(
    evidence: FrameEvidence, choices: NDArray[np.int32], weights: NDArray[np.float32], params: PatchesParams
) -> Ground:
    """Compare the reliable flow with the background's motion.

    The background's motion is the homography fitted to the pixels with a background vote, or in the first frame the
    dominant homography. A homography is exact only for a planar scene, so the tolerance grows with the deviation of
    the background's own pixels.
    """
    was = ((choices == BACKGROUND) & (weights > 0)).any(axis=0)
    fits, odd, strays = (np.zeros(was.shape, np.bool_) for _ in range(3))
    for flow, reliable in evidence.known:
        linked = reliable >= params.reliable
        sure = linked & evidence.textured
        off, tolerance = _off_background(flow, sure, was, params.motion_tolerance)
        near = cv2.GaussianBlur(off, (0, 0), 1.0)
        fits |= linked & (near <= tolerance)
        odd |= sure & (near > tolerance)
        strays |= sure & (near > STRAY * tolerance)
    return Ground(fits & ~odd, odd, strays)


def _off_background(flow: Flow, sure: Mask, was: Mask, least_px: float) -> tuple[Plane, float]:
    """Deviation of the flow from the background's homography, float32 (h, w), and the tolerance, working px."""
    basis = sure & was
    known = int(basis.sum()) >= 0.05 * basis.size
    here, moved = _moved(flow, basis if known else sure)
    off = deviation(flow, (fit if known else dominant)(here, moved))
    usual = float(np.median(off[basis][::7])) if known else 0.0
    return off, min(max(least_px, TOLERATED * usual), 4 * least_px)


def _moved(flow: Flow, where: Mask) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Evenly sampled pixels of the mask (about 3000) and their flow targets: float64 (n, 2) each."""
    places = np.flatnonzero(where)
    places = places[:: max(1, len(places) // 3000)]
    here = np.stack([places % where.shape[1], places // where.shape[1]], axis=1).astype(np.float64)
    return here, here + flow.reshape(-1, 2)[places]


def abrupt(evidence: FrameEvidence) -> Mask:
    """Pixels near motion discontinuities of the forward or backward flow, usually silhouettes: bool (h, w)."""
    found = np.zeros(evidence.small.shape[:2], np.bool_)
    around = np.ones((BLUR_PX, BLUR_PX), np.uint8)
    for flow, _ in evidence.known:
        span = cv2.dilate(flow, around) - cv2.erode(flow, around)
        found |= np.maximum(span[..., 0], span[..., 1]) > ABRUPT_PX
    return found


def _untrackable(evidence: FrameEvidence, params: PatchesParams) -> Mask:
    """Areas at least `COARSE_PX` wide that are not reliably linked to any neighbouring frame: bool (h, w)."""
    lost = (~evidence.trackable(params.reliable)).astype(np.uint8)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (COARSE_PX, COARSE_PX))
    return np.asarray(cv2.morphologyEx(lost, cv2.MORPH_OPEN, disc) > 0)


def _background_votes(
    choices: NDArray[np.int32], weights: NDArray[np.float32], ground: Ground
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Combine link votes with the evidence for the background.

    Background votes are dropped where the motion deviates strongly. Pixels without any vote for a label vote by their
    motion: for the background if it agrees, for "unclustered" if it deviates. Where motion is not visible, the
    background gets a weak vote.
    """
    wrong = ground.strays & (choices == BACKGROUND)
    choices = np.where(wrong, 0, choices).astype(np.int32)
    claimed = ((choices > 0) & (weights > 0)).any(axis=0)
    choices[0] = np.where(ground.fits, BACKGROUND, 0)
    weights[0] = (ground.fits | ground.odd) & ~claimed
    flat = ~(ground.fits | ground.odd | claimed)
    choices[0][flat], weights[0][flat] = BACKGROUND, FLAT_SHARE
    return choices, weights
