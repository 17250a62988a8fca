"""Refinement of one frame at one level: rounds that render the offsets, count their uses and improve each offset."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.synthesis.images import Bytes, Offsets, StyleImage
from pipeline.synthesis.operations import FrameState, LoadedStyle, Operations, RandomKey, Search, T

_JUMPS = (8, 4, 2, 1)
FARTHEST_PX = max(_JUMPS)
"""Maximum distance of a neighbour that proposes its offset to a pixel, px."""


@dataclass(frozen=True)
class Rounds:
    """Number and options of the rounds of a refinement.

    Attributes:
        count: rounds of PatchMatch.
        search_px: radius of the random search, px.
        settles: whether rounds without random search skip settled pixels, around which no offset changed in the round
            before.
        full_rounds: if `settles`, number of rounds after which rounds with random search skip settled pixels, too;
            None = they never do.
        near: whether offsets propagate from direct neighbours only, which suffices for a frame that starts from the
            offsets of another frame.
        votes: whether candidates are compared with the mean of the patches that overlap at a pixel (wexler2007space),
            not with the picture of the offsets: patches that disagree with their neighbours are then replaced.
        every: whether the random search runs in every round, as in the paper.
    """

    count: int
    search_px: float
    settles: bool = False
    full_rounds: int | None = None
    near: bool = False
    votes: bool = False
    every: bool = False

    def search(self, key: RandomKey, index: int) -> Search:
        """Search of round `index`."""
        jump = _JUMPS[index % len(_JUMPS)] if self.count > 1 and not self.near else 1
        return Search(key, index, jump, self.search_px if self._searches(index) else 0.0)

    def skips_settled(self, index: int) -> bool:
        """Whether round `index` skips settled pixels."""
        full = self._searches(index) and (self.full_rounds is None or index < self.full_rounds)
        return self.settles and not full

    def _searches(self, index: int) -> bool:
        return self.every or (index % 2 == 0 and (index == 0 or index + 1 < self.count))


def refine(
    ops: Operations[T], style: LoadedStyle[T], state: FrameState[T], offsets: T, key: RandomKey, rounds: Rounds
) -> T:
    """Run rounds of parallel PatchMatch, as in section 3.3 of benard2013stylizing.

    Every pixel is improved with respect to the picture of the previous round (Jacobi iteration), so the order of the
    pixels does not matter.

    Departures: besides the four direct neighbours, the four at 8, 4, 2 and 1 px (one distance per round) propose their
    offsets, so a good offset travels as far in 4 rounds as otherwise in 15. The random search runs in every second
    round only, and not in the last of several, unless `Rounds.every`; the other rounds propagate its results, which
    saves time. A single round asks the direct neighbours only, because no later round would fill the gaps that distant
    proposals leave. For further departures see `Rounds`.
    """
    before: T | None = None
    for index in range(rounds.count):
        ops.render(style, state, offsets, rounds.votes)
        penalty = ops.penalty(style, state.size, offsets) if style.energy.w_h > 0 else None
        state.before = before if rounds.skips_settled(index) else None
        before = offsets
        offsets = ops.improve(style, state, offsets, penalty, rounds.search(key, index))
    state.before = None
    return offsets


def colours(style: StyleImage, offsets: Offsets) -> Bytes:
    """Render offsets: I^(p) = S^(M(p)), uint8 (h, w, 3), or (h, w, 4) if the style has opacity."""
    return sampled(style.colours, offsets)


def sampled(image: Bytes, offsets: Offsets) -> Bytes:
    """The pixels of an image at rounded offsets, uint8 (h, w) or (h, w, channels).

    OpenCV copies the pixels. Numba would be as fast, but a still image would load Numba for this kernel alone.
    """
    height, width = image.shape[:2]
    at = np.clip(np.rint(offsets), 0, np.array((width - 1, height - 1), np.float32)).astype(np.int16)
    return np.asarray(cv2.remap(image, at, None, cv2.INTER_NEAREST), np.uint8)  # type: ignore[call-overload]
