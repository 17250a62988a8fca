"""Motion clustering of a frame from the labels of the preceding frames (zhang2011patches, section 4).

votes         optical flow links every pixel to the preceding frames of the window; reliable links vote for a label
background    pixels that follow the dominant homography of the frame pair vote for the background
random walk   spreads the votes between pixels of similar motion; uncertain pixels stay unclustered
new clusters  trackable pixels without a label are grouped by motion, seeded at corners
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Labels, Mask, Plane
from pipeline.kernels.executors import INLINE, FrameExecutor
from pipeline.kernels.jit import kernel
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.patch_styles import BACKGROUND
from pipeline.methods.patches.window_flow import WindowFlow, textured
from pipeline.regions.components import absorb_specks
from pipeline.regions.foreground import FOREGROUND, propagate_foreground
from pipeline.regions.motion_groups import GROUPS, motion_groups
from pipeline.regions.random_walk import Edges, motion_edges, vote
from pipeline.warp.homography import deviation, dominant, fit

COLOUR_UNIT = 12.0
"""Colour difference, gray levels, that separates pixels as much as a motion difference of 1 px, at full weight."""
MOTION_EDGE_WINDOW_PX = 7
"""Window, working px, over which optical flow is blurred across silhouettes."""
MOTION_EDGE_RANGE_PX = 0.3
"""Range of the flow within that window, working px, above which a silhouette is likely and links are unreliable."""
MOTION_EDGE_WEIGHT = 0.04
"""Factor on the weight of links near silhouettes. It lets colour edges decide wherever they exist."""
STRONG_DEVIATION = 2.0
"""Deviation from the background motion, in tolerances, above which a pixel loses the background label (hysteresis)."""
TOLERANCE_FACTOR = 3.0
"""Tolerance, as a multiple of the background's median deviation from its homography."""
FLAT_WEIGHT = 0.01
"""Weight of the background vote where motion is not visible: above the random walk's leak, below any neighbour."""
USUAL_CLUSTER = 3.0
"""Smallest cluster, per mille of the frame, below which new clusters may also be narrower, in proportion."""
MIN_UNTRACKABLE_PX = 9
"""Untrackable areas narrower than this, working px, are rims of moving objects and take the label around them."""

Votes = tuple[NDArray[np.int32], NDArray[np.float32]]
"""Labels int32 (k, h, w), 0 = unclustered, and their weights float32 (k, h, w); one plane per source of votes."""


@dataclass
class ClusterState:
    """State that is passed from frame to frame.

    Attributes:
        maps: label maps of the window's frames, int32 (h, w), by frame number.
        foregrounds: foreground maps by frame number, int32 (h, w), 2 = foreground, 1 = background; empty before the
            first user mask of the shot.
        next_label: the next unused label.
        begin: first frame that is used: the shot's first frame, or the last keyframe with a corrected label map.
        uncertainty: uncertainty of each label in the last frame, see `uncertainty_of`.
    """

    maps: dict[int, Labels] = field(default_factory=dict)
    foregrounds: dict[int, Labels] = field(default_factory=dict)
    next_label: int = BACKGROUND + 1
    begin: int = 0
    uncertainty: dict[int, float] = field(default_factory=dict)

    def restart(self, index: int, labels: Labels) -> Labels:
        """Restart from a label map of frame `index` that the user has corrected."""
        self.maps, self.begin = {index: labels}, index
        self.uncertainty = dict.fromkeys((int(label) for label in np.unique(labels) if label), 0.0)
        self.next_label = max(self.next_label, int(labels.max(initial=0)) + 1)
        return labels

    def trim(self, index: int, window: int) -> None:
        """Drop the maps of frames that have left the window of frame `index`."""
        self.maps = {key: labels for key, labels in self.maps.items() if key > index - window + 1}
        self.foregrounds = {key: labels for key, labels in self.foregrounds.items() if key > index - window + 1}


@dataclass(frozen=True)
class WindowMotion:
    """Motion of one frame at the working size.

    Attributes:
        small: the frame, uint8 (h, w, 3).
        textured: bool (h, w), pixels with enough texture for reliable motion.
        forward, backward: flow to the next and to the previous frame, with its reliability; None at the ends of the
            shot.
    """

    small: Frame
    textured: Mask
    forward: tuple[Flow, Plane] | None
    backward: tuple[Flow, Plane] | None

    @property
    def available(self) -> list[tuple[Flow, Plane]]:
        """The forward and the backward flow, as far as they exist."""
        return [pair for pair in (self.forward, self.backward) if pair is not None]

    def trackable(self, min_reliability: float) -> Mask:
        """Pixels linked to a neighbouring frame with at least this reliability: bool (h, w)."""
        found: Mask = np.zeros(self.small.shape[:2], np.bool_)
        for _, reliable in self.available:
            found |= reliable >= min_reliability
        return found


def frame_motion(flow: WindowFlow, index: int, begin: int) -> WindowMotion:
    """Motion of frame `index`; frames before `begin` are ignored."""
    small = flow.small(index)
    return WindowMotion(
        small, textured(small), flow.forward(index), flow.backward(index) if index > begin else None
    )  # fmt: skip


def edge_weights(motion: WindowMotion, params: PatchesParams) -> Edges:
    """Edge weights of the random walk between neighbouring pixels of the frame."""
    forward, backward = (None if pair is None else pair[0] for pair in (motion.forward, motion.backward))
    unit = COLOUR_UNIT / params.colour_edges if params.colour_edges > 0 else 0.0
    return motion_edges(forward, backward, motion.small, unit)


@dataclass(frozen=True)
class FrameFeatures:
    """The inputs of a frame's labels, except the labels of the frames before it.

    Attributes:
        index: number of the frame.
        edges: edge weights of the random walk.
        links: (earlier frame of the window, flow to it, float32 (h, w, 2), weights of the links, float32 (h, w)). Links
            with reliability R of at least `params.reliable` have weight lambda R; all others have weight 0.
        near_edges: bool (h, w), pixels near motion discontinuities.
        untrackable: bool (h, w), areas without reliable links to a neighbouring frame.
    """

    index: int
    motion: WindowMotion
    edges: Edges
    links: tuple[tuple[int, Flow, Plane], ...]
    near_edges: Mask
    untrackable: Mask

    @classmethod
    def of(cls, flow: WindowFlow, index: int, begin: int, params: PatchesParams) -> FrameFeatures:
        """The features of frame `index`; the flow from it to frames before `begin` is only a link."""
        motion = frame_motion(flow, index, begin)
        pairs = ((gap, flow.backward(index, gap)) for gap in range(1, params.window))
        least, most = np.float32(params.reliable), np.float32(params.interframe)
        links = tuple(
            (index - gap, pair[0], np.where(pair[1] >= least, most * pair[1], np.float32(0)))
            for gap, pair in pairs if pair is not None
        )  # fmt: skip
        edges = edge_weights(motion, params)
        return cls(index, motion, edges, links, near_motion_edges(motion), _untrackable(motion, params))


def cluster_frame(
    state: ClusterState, features: FrameFeatures, params: PatchesParams, user_mask: Plane | None = None,
    background: FrameExecutor = INLINE,
) -> Labels:  # fmt: skip
    """Compute the labels of a frame, int32 (h, w), 0 = unclustered, and store them in the state.

    Args:
        user_mask: float32 (h, w), foreground mask of this frame: 1, 0, or NaN = unknown; None = no mask.
        background: its helper takes a part of the work.
    """
    motion, edges = features.motion, features.edges
    votes = link_votes(state.maps, features)
    foreground = _foreground(state, features, user_mask)
    if foreground is None:
        votes = _with_background_votes(votes, background_agreement(motion, votes, params, background))
    choices, weights = votes
    _damp(choices, features.near_edges, np.float32(MOTION_EDGE_WEIGHT), weights)
    if foreground is not None:
        choices, weights = _with_mask_votes((choices, weights), foreground)
    labels, probability = vote(choices, weights, edges, background=background)
    labels[features.untrackable & (foreground is None or foreground)] = 0
    area = int(labels.size * params.smallest_cluster / 1000)
    labels = absorb_specks(labels, max(area // 12, 4), max(area // 3, 8))
    labels = _with_new_clusters(state, labels, motion, edges, params, area, foreground)
    labels = absorb_specks(labels, 4, max(area // 3, 8))
    state.maps[features.index], state.uncertainty = labels, uncertainty_of(labels, probability)
    state.trim(features.index, params.window)
    return labels


def uncertainty_of(labels: Labels, probability: Plane) -> dict[int, float]:
    """Mean uncertainty of each label in a frame: 0 = certain, 1 = the label has a probability of 0.5 or less.

    Args:
        probability: float32 (h, w), probability of the label chosen by the random walk, at least 0.5 where it chose
            one. Pixels that were labelled otherwise (new clusters, absorbed specks) count as uncertain.
    """
    uncertain = 2 * (1 - np.clip(probability, 0.5, 1))
    areas, sums = np.bincount(labels.ravel()), np.bincount(labels.ravel(), weights=uncertain.ravel())
    return {int(k): round(float(sums[k] / areas[k]), 3) for k in np.flatnonzero(areas[1:]) + 1}


def _with_new_clusters(
    state: ClusterState,
    labels: Labels,
    motion: WindowMotion,
    edges: Edges,
    params: PatchesParams,
    area: int,
    foreground: Mask | None,
) -> Labels:
    """Add new clusters of at least `area` working px among the unlabelled pixels."""
    reliable = np.all([plane >= params.reliable for _, plane in motion.available], axis=0)
    free = (labels == 0) & (motion.textured & reliable if foreground is None else foreground)
    flows = [flow for flow, _ in motion.available]
    existing = labels if foreground is None else np.where(labels == BACKGROUND, 0, labels)
    narrow = min(1.0, math.sqrt(params.smallest_cluster / USUAL_CLUSTER)) * GROUPS.min_half_width_px
    new = motion_groups(free, existing, flows, edges, motion.small, area, state.next_label, narrow)
    labels = np.where(new > 0, new, labels).astype(np.int32)
    state.next_label = max(state.next_label, int(labels.max(initial=0)) + 1)
    return labels


def _foreground(state: ClusterState, features: FrameFeatures, user_mask: Plane | None) -> Mask | None:
    """Foreground of the frame, bool (h, w), stored in the state; None if the shot has had no user mask so far."""
    if user_mask is None and not state.foregrounds:
        return None
    choices, weights = link_votes(state.foregrounds, features)
    foreground = propagate_foreground(choices, weights, features.motion.small, features.edges, user_mask)
    state.foregrounds[features.index] = np.where(foreground, 2, 1).astype(np.int32)
    return foreground


def _with_mask_votes(votes: Votes, foreground: Mask) -> Votes:
    """Restrict votes by the foreground mask: label `BACKGROUND` outside the foreground, all other labels inside."""
    choices, weights = votes
    contradicts = (choices == BACKGROUND) == foreground
    weights = np.where(contradicts, 0, weights).astype(np.float32)
    choices[0], weights[0] = np.where(foreground, 0, BACKGROUND), np.where(foreground, 0, FOREGROUND.user_weight)
    return choices, weights


def link_votes(maps: Mapping[int, Labels], features: FrameFeatures) -> Votes:
    """Votes of the preceding frames for the labels of a frame.

    Plane 0 is empty, for the background's vote; each further plane is one gap of the window.

    Args:
        maps: label maps of preceding frames, int32 (h, w), by frame number.
    """
    found = [(maps[earlier], flow, weight) for earlier, flow, weight in features.links if earlier in maps]
    shape = len(found) + 1, *features.near_edges.shape
    choices, weights = np.zeros(shape, np.int32), np.zeros(shape, np.float32)
    for plane, (before, flow, weight) in enumerate(found, start=1):
        _warp_labels(before, flow, 0, 0, choices[plane])
        weights[plane] = weight
    return choices, weights


def warp_labels(labels: Labels, flow: Flow, at: tuple[int, int] = (0, 0)) -> Labels:
    """Sample labels at the flow's targets, nearest neighbour: int32 (h, w).

    Args:
        at: position (x, y) of the flow's top left pixel in the frame, px.
    """
    out = np.empty(flow.shape[:2], np.int32)
    _warp_labels(labels, flow, *at, out)
    return out


@kernel
def _warp_labels(labels: Labels, flow: Flow, left: int, top: int, out: Labels) -> None:
    height, width = labels.shape
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            column = int(np.rint(left + x + flow[y, x, 0]))
            row = int(np.rint(top + y + flow[y, x, 1]))
            out[y, x] = labels[min(max(row, 0), height - 1), min(max(column, 0), width - 1)]


@dataclass(frozen=True)
class BackgroundAgreement:
    """Agreement of each pixel's reliable flow with the background's motion, bool (h, w) each.

    Attributes:
        agrees: the flow agrees with the background's motion.
        deviates: the flow deviates by more than the tolerance.
        deviates_strongly: the flow deviates by more than `STRONG_DEVIATION` tolerances.
    """

    agrees: Mask
    deviates: Mask
    deviates_strongly: Mask


def background_agreement(
    motion: WindowMotion, votes: Votes, params: PatchesParams, executor: FrameExecutor = INLINE
) -> BackgroundAgreement:
    """Compare the reliable flow with the background's motion.

    The background's motion is the homography fitted to the pixels with a background vote, or in the first frame the
    dominant homography. A homography is exact only for a planar scene, so the tolerance grows with the deviation of
    the background's own pixels.
    """
    choices, weights = votes
    background = ((choices == BACKGROUND) & (weights > 0)).any(axis=0)

    def compared(flow: Flow, reliable: Plane) -> tuple[Mask, Mask, Mask]:
        linked = reliable >= params.reliable
        textured_links = linked & motion.textured
        off, tolerance = _background_deviation(flow, textured_links, background, params.motion_tolerance)
        smooth = cv2.GaussianBlur(off, (0, 0), 1.0)
        limits = (smooth <= tolerance, smooth > tolerance, smooth > STRONG_DEVIATION * tolerance)
        return linked & limits[0], textured_links & limits[1], textured_links & limits[2]

    pending = [executor.submit_parallel(partial(compared, *pair)) for pair in motion.available[:-1]]
    found = [compared(*pair) for pair in motion.available[-1:]] + [each.result() for each in pending]
    agrees, deviates, strongly = (np.zeros(background.shape, np.bool_) for _ in range(3))
    for more, less, least in found:
        agrees, deviates, strongly = agrees | more, deviates | less, strongly | least
    return BackgroundAgreement(agrees & ~deviates, deviates, strongly)


def _background_deviation(flow: Flow, reliable: Mask, background: Mask, least_px: float) -> tuple[Plane, float]:
    """Deviation of the flow from the background's homography, float32 (h, w), and the tolerance; both working px."""
    basis = reliable & background
    known = int(basis.sum()) >= 0.05 * basis.size
    sources, targets = _flow_samples(flow, basis if known else reliable)
    off = deviation(flow, (fit if known else dominant)(sources, targets))
    usual = float(np.median(off[basis][::7])) if known else 0.0
    return off, min(max(least_px, TOLERANCE_FACTOR * usual), 4 * least_px)


def _flow_samples(flow: Flow, where: Mask) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Evenly sampled pixels of the mask (about 3000) and their flow targets: float64 (n, 2) each."""
    places = np.flatnonzero(where)
    places = places[:: max(1, len(places) // 3000)]
    sources = np.stack([places % where.shape[1], places // where.shape[1]], axis=1).astype(np.float64)
    return sources, sources + flow.reshape(-1, 2)[places]


def near_motion_edges(motion: WindowMotion) -> Mask:
    """Pixels near motion discontinuities of the forward or backward flow, usually silhouettes: bool (h, w)."""
    found = np.zeros(motion.small.shape[:2], np.bool_)
    window = np.ones((MOTION_EDGE_WINDOW_PX, MOTION_EDGE_WINDOW_PX), np.uint8)
    for flow, _ in motion.available:
        span = cv2.dilate(flow, window) - cv2.erode(flow, window)
        found |= np.maximum(span[..., 0], span[..., 1]) > MOTION_EDGE_RANGE_PX
    return found


def _untrackable(motion: WindowMotion, params: PatchesParams) -> Mask:
    """Areas at least `MIN_UNTRACKABLE_PX` wide that are not reliably linked to a neighbouring frame: bool (h, w)."""
    lost = (~motion.trackable(params.reliable)).astype(np.uint8)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (MIN_UNTRACKABLE_PX, MIN_UNTRACKABLE_PX))
    return np.asarray(cv2.morphologyEx(lost, cv2.MORPH_OPEN, disc) > 0)


def _with_background_votes(votes: Votes, agreement: BackgroundAgreement) -> Votes:
    """Combine link votes with the evidence for the background.

    Background votes are dropped where the motion deviates strongly. Pixels without any vote for a label vote by their
    motion: for the background if it agrees, for "unclustered" if it deviates. Where motion is not visible, the
    background gets a weak vote.
    """
    choices, weights = votes
    _add_background(choices, weights, agreement.agrees, agreement.deviates, agreement.deviates_strongly)
    return choices, weights


@kernel
def _add_background(choices: NDArray[np.int32], weights: NDArray[np.float32], agrees: Mask, deviates: Mask,
                    strongly: Mask) -> None:  # fmt: skip
    """`_with_background_votes`, in place."""
    for y in range(agrees.shape[0]):
        for x in range(agrees.shape[1]):
            voted = False
            for k in range(choices.shape[0]):
                if strongly[y, x] and choices[k, y, x] == BACKGROUND:
                    choices[k, y, x] = 0
                voted = voted or (choices[k, y, x] > 0 and weights[k, y, x] > 0)
            visible = agrees[y, x] or deviates[y, x]
            flat = not visible and not voted
            choices[0, y, x] = BACKGROUND if agrees[y, x] or flat else 0
            weights[0, y, x] = FLAT_WEIGHT if flat else np.float32(visible and not voted)


@kernel
def _damp(choices: NDArray[np.int32], near: Mask, factor: np.float32, weights: NDArray[np.float32]) -> None:
    """Multiply the weights of votes for a label by `factor` near silhouettes, and remove those for none, in place."""
    for k in range(choices.shape[0]):
        for y in range(near.shape[0]):
            for x in range(near.shape[1]):
                if near[y, x]:
                    weights[k, y, x] = weights[k, y, x] * factor if choices[k, y, x] > 0 else np.float32(0)
