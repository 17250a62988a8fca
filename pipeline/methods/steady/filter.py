"""Removal of flicker from a video that some tool stylised frame by frame (bonneel2015blind)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray, Arrays, State
from pipeline.frames import Flow, Frame, Plane, same_size
from pipeline.kernels.buffers import Buffers
from pipeline.kernels.executors import INLINE, FrameExecutor, Pending, Ready
from pipeline.methods.over_time import largest
from pipeline.methods.steady.confidence import Evidence, Picture, TrustedMotion, confidence, motion, onward_motion
from pipeline.methods.steady.detail import NO_AMOUNTS, Amounts, amounts_of, resized_amounts, sharpen
from pipeline.methods.steady.equation import LARGEST_AGE, add_clipped, age_weights, equation_terms, remember, show
from pipeline.methods.steady.params import SteadyParams
from pipeline.perception.cuts import is_cut, thumbnail
from pipeline.perception.flow.warp import positions
from pipeline.solvers.screened import solve_screened

_LEVELS = {np.dtype(np.uint16): 255 / 65535, np.dtype(np.float32): 255.0}
"""Factors from the values of styled frames to gray levels, 0..255."""


@dataclass(frozen=True)
class SourceAnalysis:
    """Properties of the source frame on which a result depends."""

    back: TrustedMotion
    """Motion from this frame to the previous one."""
    weight: Plane
    """Weight of the previous result, moved along that motion, float32 (h, w), 0..strength."""
    onward: TrustedMotion | None
    """Motion from the previous frame to this one; only with `look_ahead`."""


class SteadyFilter:
    """Removes the flicker of a stylised stream, using past frames only.

    `step` is `apply(analyze(source), styled)`. `analyze` uses the source only, and the two stages keep separate state,
    so that each may run on a thread of its own. Not thread-safe otherwise.

    Each result x minimises, over the picture,

        |grad x - grad S|^2  +  w |x - P|^2  +  (2^(1/h) - 1) w |x - S|^2  +  (1 - c)^2 |x - S - m|^2

    with the styled frame S, the previous result P moved along the motion of the source, the confidence c in that
    motion, the weight w = strength * c * min(age / 10, 1) * mask, and the mean m of P - S weighted by w. The
    Euler-Lagrange equation, a screened Poisson equation, is solved for x - S - m.

    Source: bonneel2015blind, eq. 1 to 3.

    Departures:
        - The weight is high enough to keep fine texture steady, too. The warp is bicubic, and P is sharpened as far as
          results have less texture than the styled frames (`sharpen`). The result has the amount of the styled frames'
          texture, not its place: a result with the texture of each frame would flicker as they do.
        - The third term lets the colours follow the styled video with half-life h. Without it, a shot keeps the mean
          colour of its first frame.
        - The fourth term keeps the colours of one object from diffusing into another where the motion is unknown.
        - A pixel's past has an age in frames: (age of the previous frame's pixel + 1) c^(1/4), at most 40. Where an
          object has uncovered the background, the past weighs little for some frames, so that its errors are averaged
          out.
        - The confidence compares the source with a memory of the source that is averaged along the motion as results
          are (bilinear samples suffice here). A trail of a result is a trail in the memory, too, is recognised there in
          every later frame, and fades.
    """

    def __init__(
        self, params: SteadyParams, size: tuple[int, int], deep: bool = False, background: FrameExecutor = INLINE
    ) -> None:  # fmt: skip
        """
        Args:
            size: (width, height) of the frames, px.
            deep: whether results are float32 with white at 1, not rounded, instead of uint8.
            background: may take rows of the analyses and of the results.
        """
        self._background = background
        self.params, self.size, self._deep = params, size, deep
        self._source: Frame | None = None
        self._memory = self._result = np.empty((0, 0, 3), np.float32)
        self._age = np.empty((0, 0), np.float32)
        self._analyzing, self._applying = Buffers(), Buffers()
        self._everywhere = np.ones((size[1], size[0]), np.float32)
        self._amounts: Pending[Amounts] = Ready(NO_AMOUNTS)

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

    @property
    def source(self) -> Frame | None:
        """The source of the last analysed frame."""
        return self._source

    def analyze(self, source: Frame, flows: tuple[Flow, Flow] | None = None, number: int = 0) -> SourceAnalysis | None:
        """First half of `step`: motion and confidence; None at the first frame of a shot, where the result starts
        afresh.

        Args:
            flows: `motion` between the last source and this one; None = estimated here.
            number: of the frame in the film, for parameters that vary over it.

        Raises: BadFrame.
        """
        same_size(source, self.size, "source")
        before, self._source = self._source, source
        if before is None or is_cut(thumbnail(before), thumbnail(source), self.params.cut_sensitivity):
            self._memory = source.astype(np.float32)
            self._age = np.full(source.shape[:2], LARGEST_AGE, np.float32)
            return None
        params = self.params.at(number)
        two_sided, alpha = params.look_ahead > 0, params.trail_suppression
        back, forth = motion(before, source, two_sided) if flows is None else flows
        there, buffers = positions(back), self._analyzing
        round_trip, expected = buffers.get("round trip", forth.shape), buffers.get("expected", source.shape)
        age, warped = np.empty_like(self._age), np.empty_like(before)
        moves = (forth, round_trip), (self._memory, expected), (before, warped), (self._age, age)

        def move(rows: slice) -> None:
            places = there[0][rows], there[1][rows]
            for picture, moved in moves:
                cv2.remap(picture, *places, cv2.INTER_LINEAR, dst=moved[rows], borderMode=cv2.BORDER_REPLICATE)

        self._rows(move, len(source))
        evidence = Evidence(back, round_trip, source, warped, expected)
        trust = confidence(evidence, alpha, buffers, self._background)
        self._age, weight, strength = age, np.empty_like(trust), np.float32(params.strength)

        def take(rows: slice) -> None:
            age_weights(age[rows], trust[rows], strength, weight[rows])
            remember(source[rows], expected[rows], weight[rows], self._memory[rows])

        self._rows(take, len(source))
        onward = onward_motion(before, source, (back, forth), alpha, buffers, self._background) if two_sided else None
        return SourceAnalysis(TrustedMotion(there, trust), weight, onward)

    def apply(
        self, analysis: SourceAnalysis | None, styled: AnyArray, mask: Plane | None = None, number: int = 0
    ) -> AnyArray:
        """Second half of `step`. `styled`: uint8, or uint16 or float32 if the filter is deep. Raises: BadFrame."""
        same_size(styled, self.size, "styled")
        levels = styled if styled.dtype == np.uint8 else styled.astype(np.float32) * np.float32(_LEVELS[styled.dtype])
        before = self._amounts.result()  # they read the last target, whose memory the next one takes
        if analysis is None:
            self._result, self._amounts = levels.astype(np.float32), Ready(NO_AMOUNTS)
            return self._result / np.float32(255) if self._deep else styled.copy()
        buffers, shape = self._applying, styled.shape
        target = buffers.get("target", shape)
        np.copyto(target, levels)
        mask = self._everywhere if mask is None else mask
        self._solve(analysis, target, mask, self.params.at(number), before)
        if largest(self.params.detail) > 0:
            self._amounts = self._background.submit_parallel(partial(amounts_of, self._result, target, before, buffers))
        if self._deep:
            return (target + mask[..., None] * (self._result - target)) / np.float32(255)
        shown: NDArray[np.uint8] = np.empty(shape, np.uint8)
        self._rows(lambda rows: show(self._result[rows], target[rows], mask[rows], shown[rows]), shape[0])
        return shown

    def _rows(self, work: Callable[[slice], object], height: int) -> None:
        """Call `work` for all rows of a picture, on several threads if there are any."""

        def span(first: int, last: int) -> None:
            work(slice(first, last))

        self._background.rows(span, height)

    def _solve(
        self, analysis: SourceAnalysis, target: Picture, mask: Plane, params: SteadyParams, amounts: Amounts
    ) -> None:
        """Replace the previous result by the solution of the equation for the styled frame `target`."""
        buffers, back = self._applying, analysis.back
        moved, absorb = buffers.get("moved", target.shape), buffers.get("absorb", target.shape[:2])
        blurred = buffers.get("blurred", target.shape)
        (xs, ys), height = back.to, len(target)

        def move(rows: slice) -> None:
            cv2.remap(
                self._result, xs[rows], ys[rows], cv2.INTER_CUBIC, dst=blurred[rows], borderMode=cv2.BORDER_REPLICATE
            )

        self._rows(move, height)
        sharpen(blurred, back, amounts, params.detail, moved, self._background)
        weight, source = buffers.get("weight", target.shape[:2]), buffers.get("source", target.shape)
        np.multiply(analysis.weight, mask, out=weight)
        half_life = params.colour_half_life
        returning = 2 ** (1 / half_life) - 1 if half_life > 0 else 0.0
        equation_terms(moved, target, back.trust, weight, returning, (absorb, source), self._background)
        found = solve_screened(absorb, source, buffers, self._background)
        self._rows(lambda rows: add_clipped(target[rows], found[rows], self._result[rows]), height)

    def reconfigure(self, params: SteadyParams, size: tuple[int, int]) -> SteadyFilter:
        """Continue with other parameters or another frame size: the state is resized. See `LiveFilter`."""
        after = SteadyFilter(params, size, self._deep, self._background)
        if self._source is not None:
            resized = {name: _resized(plane, size) for name, plane in self.state().items() if name != "amounts"}
            after.restore({**resized, "amounts": resized_amounts(self._amounts.result(), size)})
        return after

    def state(self) -> State:
        """The complete state; a filter restored from it continues with the same bytes."""
        assert self._source is not None
        memory, result = self._memory.copy(), self._result.copy()
        state: State = {"source": self._source, "memory": memory, "age": self._age, "result": result}
        return state | {"amounts": self._amounts.result()}

    def restore(self, state: Arrays) -> None:
        self._source, self._age, self._amounts = state["source"], state["age"], Ready(state["amounts"])
        self._memory, self._result = state["memory"].copy(), state["result"].copy()


def _resized(picture: AnyArray, size: tuple[int, int]) -> AnyArray:
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR))
