"""Removal of flicker from a video that some tool stylised frame by frame (bonneel2015blind)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.arrays import AnyArray, Arrays, State
from pipeline.flow.warp import fetch, positions
from pipeline.frames import Flow, Frame, Plane, same_size
from pipeline.methods.steady.confidence import Picture, confidence, motion
from pipeline.methods.steady.detail import NO_AMOUNTS, resized_amounts, restore_detail
from pipeline.methods.steady.params import SteadyParams
from pipeline.segmentation.cuts import is_cut, thumbnail
from pipeline.solvers.screened import solve_screened

DISTRUST = np.float32(1)
"""Weight of the styled frame's colours where the motion cannot be trusted at all."""
MEMORY_WEIGHT = np.float32(1)
"""Weight of the source in its own memory; results keep about as much of the past, `strength` against 1."""


@dataclass(frozen=True)
class SourceAnalysis:
    """Properties of the source frame on which a result depends."""

    back: Flow
    """Motion from this frame to the last, px."""
    trust: Plane
    """Confidence in that motion, float32 (h, w), 0..1."""


class SteadyFilter:
    """Removes the flicker of a stylised stream, using past frames only.

    `step` is `apply(analyze(source), styled)`. `analyze` uses the source only, and the two halves keep separate state,
    so that each may run on a thread of its own. Not thread-safe otherwise.

    Each result x minimises, over the picture,

        |grad x - grad S|^2  +  w |x - P|^2  +  (2^(1/h) - 1) w |x - S|^2  +  (1 - c)^2 |x - S - m|^2

    with the styled frame S, the previous result P moved along the motion of the source, the confidence c in that
    motion, the weight w = strength * c * mask, and the mean m of P - S weighted by w. The Euler-Lagrange equation, a
    screened Poisson equation, is solved for x - S - m.

    Source: bonneel2015blind, eq. 1 to 3.

    Departures:
        - The weight is high enough to hold fine texture, too, and the warp is bicubic, so that it does not blur. Detail
          that is averaged out is amplified afterwards (`restore_detail`), outside the recursion. It has the amount of
          the styled frame's texture, not its place: a result with the texture of each frame would flicker as they do.
        - The third term lets the colours follow the styled video with half-life h. Without it, a shot keeps the mean
          colour of its first frame.
        - The fourth term keeps the colours of one object from diffusing into another where the motion is unknown.
        - The confidence compares the source with a memory of the source that is averaged along the motion as results
          are. A trail of a result is a trail in the memory, too, is recognised there in every later frame, and fades.
    """

    def __init__(self, params: SteadyParams, size: tuple[int, int]) -> None:
        """
        Args:
            size: (width, height) of the frames, px.
        """
        self.params, self.size = params, size
        self._source: Frame | None = None
        self._memory = self._result = np.empty((0, 0, 3), np.float32)
        self._amounts = NO_AMOUNTS
        half_life = params.colour_half_life
        self._return = np.float32(2 ** (1 / half_life) - 1 if half_life > 0 else 0)

    def step(self, source: Frame, styled: Frame, mask: Plane | None = None) -> Frame:
        """The next frame of the result.

        Args:
            source: frame of the original video.
            styled: the same frame, as some tool stylised it.
            mask: 1 = steady, 0 = as styled, float32 (h, w); None = 1 everywhere.

        Raises:
            BadFrame: a frame has another size than the first.
        """
        return self.apply(self.analyze(source), styled, mask)

    def analyze(self, source: Frame) -> SourceAnalysis | None:
        """First half of `step`: motion and confidence; None at the first frame of a shot, where the result starts
        afresh. Raises: BadFrame."""
        same_size(source, self.size, "source")
        before, self._source = self._source, source
        if before is None or is_cut(thumbnail(before), thumbnail(source), self.params.cut_sensitivity):
            self._memory = source.astype(np.float32)
            return None
        back, forth = motion(before, source)
        expected, warped = _moved(self._memory, back), fetch(before, back)
        trust = confidence(back, forth, source, warped, expected, self.params.trail_suppression)
        weight = trust * np.float32(self.params.strength)
        self._memory = _mixed(source.astype(np.float32), expected, weight / (weight + MEMORY_WEIGHT))
        return SourceAnalysis(back, trust)

    def apply(self, analysis: SourceAnalysis | None, styled: Frame, mask: Plane | None = None) -> Frame:
        """Second half of `step`. Raises: BadFrame."""
        target = same_size(styled, self.size, "styled").astype(np.float32)
        if analysis is None:
            self._result, self._amounts = target, NO_AMOUNTS
            return styled.copy()
        weight = analysis.trust * np.float32(self.params.strength)
        if mask is not None:
            weight *= mask
        moved = _moved(self._result, analysis.back)
        self._result = self._solved(target, moved, weight, np.square(1 - analysis.trust) * DISTRUST)
        shown, detail = self._result, self.params.detail
        if detail > 0:
            shown, self._amounts = restore_detail(self._result, target, detail, self._amounts)
        return _rounded(shown if mask is None else _mixed(target, shown, mask))

    def _solved(self, target: Picture, moved: Picture, weight: Plane, distrust: Plane) -> Picture:
        """Solution of the equation for the styled frame, the moved previous result and the weights."""
        keep = 1 + self._return
        source = cv2.subtract(moved, target) * weight[..., None]
        mean = np.array(cv2.mean(source)[:3]) / max(keep * cv2.mean(weight)[0], 1e-6)
        mean = mean.astype(np.float32)
        source -= (weight * keep)[..., None] * mean
        correction = solve_screened(weight * keep + distrust, source)
        correction += mean
        return np.asarray((target + correction).clip(0, 255), np.float32)

    def reconfigure(self, params: SteadyParams, size: tuple[int, int]) -> SteadyFilter:
        """Continue with other parameters or another frame size: what is remembered is resized. See `LiveFilter`."""
        after = SteadyFilter(params, size)
        if self._source is not None:
            resized = {name: _resized(plane, size) for name, plane in self.state().items() if name != "amounts"}
            after.restore({**resized, "amounts": resized_amounts(self._amounts, size)})
        return after

    def state(self) -> State:
        """The complete state; a filter restored from it continues with the same bytes."""
        assert self._source is not None
        return {"source": self._source, "memory": self._memory, "result": self._result, "amounts": self._amounts}

    def restore(self, state: Arrays) -> None:
        self._source, self._memory, self._result = state["source"], state["memory"], state["result"]
        self._amounts = state["amounts"]


def _moved(picture: Picture, flow: Flow) -> Picture:
    """The picture where the flow leads, continued beyond its border."""
    moved = cv2.remap(picture, *positions(flow), cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, np.float32)


def _mixed(base: Picture, other: Picture, share: Plane) -> Picture:
    """`base`, with a share 0..1 of `other`."""
    return base + share[..., None] * (other - base)


def _resized(picture: AnyArray, size: tuple[int, int]) -> AnyArray:
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR))


def _rounded(picture: Picture) -> Frame:
    return np.asarray(np.rint(picture.clip(0, 255)), np.uint8)
