"""Temporal denoising of the input: what changes by less than the noise stays bit-identical.

Strokes, their colours and directions are made from the denoised picture. A painted edge amplifies small differences, so
a running mean, which still fluctuates, is not enough: values within the tolerance of the past keep the past's value.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.frames import Flow, Mask, Plane
from pipeline.kernels.jit import kernel
from pipeline.kernels.selection import upper_median
from pipeline.perception.flow.warp import warp_back
from pipeline.perception.motion import zero_still_flow
from pipeline.strokes.accumulation import ACCUMULATION, changes


class DenoiseParams(NamedTuple):
    """Constants of temporal denoising."""

    moving_share: float = 0.25
    """Least weight of the new picture where the past is resampled at fractional positions, so that it does not blur."""
    least: float = 6.0
    likely: float = 20.0
    plain: float = 30.0
    """Change of the mean colour around a pixel, gray levels, see `changes`. Above the first the new picture is followed
    slowly, from the second on increasingly fast, above the third at once: another surface is visible."""
    direction_share: float = 0.3
    """Largest weight of new directions a frame."""
    margin: float = 1.4
    noisy: float = 2.5
    """The tolerance is at least `margin` times the median difference, and at most `noisy` times the requested
    tolerance."""
    texture: float = 64.0
    """Sobel slope at a quarter of the size from which on motion would be visible."""
    window: float = 0.15
    overall: float = 0.03
    """Side of the window, as a fraction of the frame's shorter side, in which textured pixels decide whether a flat
    pixel rests; weight of the textured pixels of the whole picture."""
    far: float = 0.003
    contested: float = 0.9
    """A flat pixel that the flow moves by more than `far`, as a fraction of the shorter side, moves, unless at least
    the fraction `contested` of the textures around it rests. Smaller motion may be an overshoot from a moving
    neighbour."""
    texture_share: float = 0.3
    """Largest weight of the new picture a frame where only texture differs: moving folds and fur are not exactly
    where the flow says, and following each of them would flicker."""


DENOISE = DenoiseParams()


def zero_still_flow_by_texture(
    flow: Flow, before: NDArray[np.uint8], gray: NDArray[np.uint8], tolerance: float
) -> Flow:
    """Set the flow of still pixels to exactly 0, in place; return it: float32 (h, w, 2), px.

    A pixel that does not change may be still, or belong to a flat surface that moves, such as the sky in a pan. An
    unchanged flat pixel is therefore still only if textured pixels around it do not change either. If some of them do,
    it is still only if the flow moves it little.

    Args:
        before, gray: uint8 (h, w), the previous frame and this one.
        tolerance: mean absolute difference over 5 x 5 px up to which a pixel counts as unchanged, gray levels.
    """
    size = (gray.shape[1], gray.shape[0])
    small = (max(1, size[0] // 4), max(1, size[1] // 4))
    change = cv2.resize(cv2.absdiff(gray, before), small, interpolation=cv2.INTER_AREA)
    coarse = cv2.resize(gray, small, interpolation=cv2.INTER_AREA)
    across, down = (np.abs(cv2.Sobel(coarse, cv2.CV_32F, *axes)) for axes in ((1, 0), (0, 1)))
    texture = (across + down > np.float32(DENOISE.texture)).astype(np.float32)
    resting = texture * (change <= np.uint8(tolerance))
    side = max(3, round(DENOISE.window * min(small))) | 1
    near, all_near = (cv2.boxFilter(plane, -1, (side, side)) for plane in (resting, texture))
    far, all_far = (np.float32(DENOISE.overall * plane.mean() + 1e-6) for plane in (resting, texture))
    votes = near + far, all_near + all_far
    moving = (2 * votes[0] <= votes[1]).astype(np.uint8) + (votes[0] < np.float32(DENOISE.contested) * votes[1])
    decisions = np.asarray(moving, np.uint8)
    wide = np.asarray(cv2.resize(decisions, size, interpolation=cv2.INTER_NEAREST), np.uint8)
    _decide_uncertain(flow, np.float32((DENOISE.far * min(size)) ** 2), wide)
    return zero_still_flow(flow, before, gray, tolerance, wide)


@kernel
def _decide_uncertain(flow: Flow, most2: np.float32, moving: NDArray[np.uint8]) -> None:
    """Replace 1 (contested) by 0 (rests) or 1 (moves), in place; 2 means moves."""
    height, width = moving.shape
    for y in range(height):
        for x in range(width):
            if moving[y, x] == 1:
                dx, dy = flow[y, x, 0], flow[y, x, 1]
                moving[y, x] = dx * dx + dy * dy > most2


class TemporalDenoiser:
    """Denoises consecutive frames of one size.

    Args:
        tolerance: mean difference over 5 x 5 px, gray levels, up to which a pixel keeps its past value; 0 = off.

    Attributes:
        past: float32 (h, w, 3), the last result.
        changed: bool (h, w), pixels that show another surface than in the previous frame; None before the second frame.
    """

    def __init__(self, tolerance: float) -> None:
        self.tolerance = tolerance
        self.past: NDArray[np.float32] | None = None
        self.changed: Mask | None = None

    def step(
        self, frame: NDArray[np.float32], back: Flow | None, attention: Plane | None = None
    ) -> NDArray[np.uint8]:  # fmt: skip
        """Denoise the next frame: uint8 (h, w, 3).

        Args:
            frame: float32 (h, w, 3).
            back: flow from this frame to the one before, px, exactly 0 where nothing moves; None = a shot begins.
            attention: increases the change, see `denoise`.
        """
        now = frame
        if back is not None and self.past is not None:
            denoised, self.changed = denoise(now, self.past, back, self.tolerance, attention)
            now = denoised if self.tolerance else now
        self.past = now
        return np.asarray(np.rint(now), np.uint8)

    def state(self) -> State:
        return {} if self.past is None else {"past": self.past}

    def restore(self, state: Arrays) -> None:
        self.past = state.get("past")


def denoise(
    now: NDArray[np.float32], past: NDArray[np.float32], back: Flow, tolerance: float, attention: Plane | None = None
) -> tuple[NDArray[np.float32], Mask]:  # fmt: skip
    """Denoised frame, float32 (h, w, 3), and pixels that show another surface than before, bool (h, w).

    Differences of texture are followed slowly; differences of colour at the scale of a stroke are taken over at once.

    Args:
        now: the frame, float32 (h, w, 3).
        past: result for the previous frame.
        back: flow from this frame to the previous one, float32 (h, w, 2), px.
        tolerance: mean difference over 5 x 5 px up to which a pixel keeps its past value; up to three times that, the
            new value's weight rises. Noisy pictures raise the tolerance, up to `DENOISE.noisy` times.
        attention: increases the change, see `accumulation.Painting`.
    """
    advected = np.asarray(warp_back(past, back), np.float32)
    red, green, blue = cv2.split(cv2.absdiff(now, advected))
    most = cv2.max(cv2.max(red, green), blue)
    difference = np.asarray(cv2.boxFilter(most, -1, (5, 5)), np.float32)
    noise = float(upper_median(difference))
    tolerance = max(min(max(tolerance, DENOISE.margin * noise), DENOISE.noisy * tolerance), 0.01)
    changed = changes(now, advected, attention)
    _raise_where_torn(changed, np.asarray(most, np.float32), back)
    least_share = np.clip((changed - np.float32(DENOISE.likely)) / np.float32(DENOISE.plain - DENOISE.likely), 0, 1)
    slow = np.float32(DENOISE.texture_share) * np.clip(
        (changed - np.float32(DENOISE.least)) / np.float32(DENOISE.least), 0, 1
    )
    out = np.empty_like(now)
    limits = np.float32(tolerance), np.float32(DENOISE.texture_share)
    _blend(np.ascontiguousarray(now), advected, back, difference, np.maximum(least_share, slow), limits, out)
    return out, np.asarray(changed > np.float32(DENOISE.plain), np.bool_)


@kernel
def _raise_where_torn(changed: Plane, difference: Plane, back: Flow) -> None:
    """Raise the change to the difference of the pixel itself where the flow is torn, in place: see
    `ACCUMULATION.torn`."""
    height, width = changed.shape
    steps = back.reshape(-1)
    for y in range(height):
        for x in range(width):
            if difference[y, x] <= changed[y, x]:
                continue
            at = np.uintp(2 * (y * width + x))
            dx, dy, far = steps[at], steps[at + np.uintp(1)], np.float32(0)
            for j, i in ((y, x - 1), (y, x + 1), (y - 1, x), (y + 1, x)):
                if 0 <= j < height and 0 <= i < width:
                    other = np.uintp(2 * (j * width + i))
                    far = max(far, abs(steps[other] - dx), abs(steps[other + np.uintp(1)] - dy))
            if far > ACCUMULATION.torn:
                changed[y, x] = difference[y, x]


def denoise_directions(
    now: NDArray[np.float32], past: NDArray[np.float32], back: Flow, tolerance: float
) -> NDArray[np.float32]:
    """`denoise` for an orientation field, float32 (2, h, w), (cos 2a, sin 2a).

    Args:
        tolerance: length of the difference up to which a direction stays the same; 0.2 is 6 degrees.
    """
    advected = np.ascontiguousarray(warp_back(past.transpose(1, 2, 0), back), np.float32)
    fresh = np.ascontiguousarray(now.transpose(1, 2, 0))
    u, v = cv2.split(fresh - advected)
    difference = np.asarray(cv2.boxFilter(np.sqrt(u * u + v * v), -1, (3, 3)), np.float32)
    out = np.empty_like(fresh)
    limits = np.float32(tolerance), np.float32(DENOISE.direction_share)
    _blend(fresh, advected, back, difference, np.zeros_like(difference), limits, out)
    return np.ascontiguousarray(out.transpose(2, 0, 1))


@kernel
def _blend(
    now: NDArray[np.float32], past: NDArray[np.float32], back: Flow, difference: Plane, least_share: Plane,
    limits: tuple[np.float32, np.float32], out: NDArray[np.float32],
) -> None:  # fmt: skip
    """Blend past and present. `limits` is (tolerance, weight of the present at three times the tolerance)."""
    height, width, channels = now.shape
    tolerance, quickly = limits
    zero, one = np.float32(0), np.float32(1)
    for y in range(height):
        for x in range(width):
            over = min(max((difference[y, x] - tolerance) / (tolerance + tolerance), zero), one)
            share = max(quickly * over, least_share[y, x])
            dx, dy = back[y, x, 0], back[y, x, 1]
            if dx != zero or dy != zero:
                share = max(share, np.float32(DENOISE.moving_share))
                px, py = np.float32(x) + dx, np.float32(y) + dy
                if px < zero or py < zero or px > np.float32(width - 1) or py > np.float32(height - 1):
                    share = one
            for c in range(channels):
                out[y, x, c] = past[y, x, c] + share * (now[y, x, c] - past[y, x, c])
