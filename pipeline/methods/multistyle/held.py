"""The held picture: the video without its noise. Where nothing happens it does not change by one bit.

Strokes, their colours and directions are made from it. A painted edge makes a large difference of a small one, so an
average that still trembles is not enough: what is within the tolerance of what was there is what was there.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.flow.warp import fetch
from pipeline.frames import Flow, Mask, Plane
from pipeline.segmentation.jit import kernel
from pipeline.segmentation.motion import hold_still
from pipeline.strokes.linger import changes

MOVING = 0.25
"""What is carried by bilinear samples goes at least so far towards the new picture, or it would blur away."""
LEAST, LIKELY, PLAIN = 6.0, 20.0, 30.0
"""Change of the mean colour about a pixel, gray levels, see `changes`: beyond the first it is followed slowly; from the
second on something else may be there, which is followed the faster the more; beyond the third it is, and is there at
once."""
TURNING = 0.3
"""The same for a direction."""
MARGIN, NOISY = 1.4, 2.5
"""The tolerance is at least so many times the median difference, and at most so many times what was asked for."""
TEXTURE = 64.0
"""Slope, by Sobel's filter at a quarter of the size, from which on a motion would show."""
ABOUT, EVERYWHERE = 0.15, 0.03
"""Side, in heights, of the window in which textures tell whether a plain pixel rests; weight of all the picture's."""
STRAYS, CONTESTED = 0.003, 0.9
"""What the flow moves farther than this, in heights, does not rest, however little it changes, unless nearly all
textures about it rest: plain things go past things at rest. A smaller motion may reach out from what moves beside."""
SLOWLY = 0.3
"""How far a pixel goes towards the new picture in a frame where only its texture differs, not the colour about it:
folds and fur that move are not quite where the flow says, and a painter who followed each would paint what flickers."""


def rest(flow: Flow, before: NDArray[np.uint8], gray: NDArray[np.uint8], tolerance: float) -> Flow:
    """The flow, exactly 0 where things rest: float32 (h, w, 2), px; changed in place.

    A pixel that does not change may rest, or be a part of a plain thing that moves, as the sky does in a pan. So what
    does not change rests only if things with a texture about it do not change either: those would, if they moved. Where
    some do and some do not, it rests only if it hardly moves by the flow.

    Args:
        before, gray: uint8 (h, w), the last frame and this one.
        tolerance: mean absolute difference over 5 x 5 px up to which a pixel does not change, gray levels.
    """
    size = (gray.shape[1], gray.shape[0])
    small = (max(1, size[0] // 4), max(1, size[1] // 4))
    change = cv2.resize(cv2.absdiff(gray, before), small, interpolation=cv2.INTER_AREA)
    coarse = cv2.resize(gray, small, interpolation=cv2.INTER_AREA)
    across, down = (np.abs(cv2.Sobel(coarse, cv2.CV_32F, *way)) for way in ((1, 0), (0, 1)))
    texture = (across + down > np.float32(TEXTURE)).astype(np.float32)
    resting = texture * (change <= np.uint8(tolerance))
    side = max(3, round(ABOUT * small[1])) | 1
    near, all_near = (cv2.boxFilter(plane, -1, (side, side)) for plane in (resting, texture))
    far, all_far = (np.float32(EVERYWHERE * plane.mean() + 1e-6) for plane in (resting, texture))
    votes = near + far, all_near + all_far
    moving = (2 * votes[0] <= votes[1]).astype(np.uint8) + (votes[0] < np.float32(CONTESTED) * votes[1])
    small_calls = np.asarray(moving, np.uint8)
    wide = np.asarray(cv2.resize(small_calls, size, interpolation=cv2.INTER_NEAREST), np.uint8)
    _call_contested(flow, np.float32((STRAYS * size[1]) ** 2), wide)
    return hold_still(flow, before, gray, tolerance, wide)


@kernel
def _call_contested(flow: Flow, most2: np.float32, moving: NDArray[np.uint8]) -> None:
    """0 = rests, 1 = contested, 2 = moves; in place: 0 or not."""
    height, width = moving.shape
    for y in range(height):
        for x in range(width):
            if moving[y, x] == 1:
                dx, dy = flow[y, x, 0], flow[y, x, 1]
                moving[y, x] = dx * dx + dy * dy > most2


def hold(
    now: NDArray[np.float32], past: NDArray[np.float32], back: Flow, tolerance: float
) -> tuple[NDArray[np.float32], Mask]:  # fmt: skip
    """The held picture of this frame, float32 (h, w, 3); and where it shows something else than before, bool (h, w).

    What differs in texture is followed slowly; what differs in colour, at the scale of a stroke, is there at once.

    Args:
        now: the frame, float32 (h, w, 3).
        past: the held picture of the frame before.
        back: from this frame to the one before, float32 (h, w, 2), px; exactly 0 where nothing moves.
        tolerance: mean difference over 5 x 5 px up to which a pixel keeps its past; beyond three times that it follows,
            slowly. More where the whole picture is noisy: up to `NOISY` times as much.
    """
    carried = np.asarray(fetch(past, back), np.float32)
    red, green, blue = cv2.split(cv2.absdiff(now, carried))
    most = cv2.max(cv2.max(red, green), blue)
    apart = np.asarray(cv2.boxFilter(most, -1, (5, 5)), np.float32)
    noise = float(np.partition(apart, apart.size // 2, axis=None)[apart.size // 2])
    tolerance = max(min(max(tolerance, MARGIN * noise), NOISY * tolerance), 0.01)
    changed = changes(now, carried)
    urge = np.clip((changed - np.float32(LIKELY)) / np.float32(PLAIN - LIKELY), 0, 1)
    urge = np.maximum(urge, np.float32(SLOWLY) * np.clip((changed - np.float32(LEAST)) / np.float32(LEAST), 0, 1))
    out = np.empty_like(now)
    _hold(np.ascontiguousarray(now), carried, back, apart, urge, np.float32(tolerance), np.float32(SLOWLY), out)
    return out, np.asarray(changed > np.float32(PLAIN), np.bool_)


def hold_field(
    now: NDArray[np.float32], past: NDArray[np.float32], back: Flow, tolerance: float
) -> NDArray[np.float32]:
    """The same for directions, float32 (2, h, w), (cos 2a, sin 2a): strokes do not tremble where nothing happens.

    Args:
        tolerance: length of the difference up to which a direction stays; 0.2 is 6 degrees.
    """
    carried = np.ascontiguousarray(fetch(past.transpose(1, 2, 0), back), np.float32)
    fresh = np.ascontiguousarray(now.transpose(1, 2, 0))
    u, v = cv2.split(fresh - carried)
    apart = np.asarray(cv2.boxFilter(np.sqrt(u * u + v * v), -1, (3, 3)), np.float32)
    out = np.empty_like(fresh)
    _hold(fresh, carried, back, apart, np.zeros_like(apart), np.float32(tolerance), np.float32(TURNING), out)
    return np.ascontiguousarray(out.transpose(2, 0, 1))


@kernel
def _hold(
    now: NDArray[np.float32], past: NDArray[np.float32], back: Flow, apart: Plane, urge: Plane, tolerance: np.float32,
    quickly: np.float32, out: NDArray[np.float32],
) -> None:  # fmt: skip
    height, width, channels = now.shape
    zero, one = np.float32(0), np.float32(1)
    for y in range(height):
        for x in range(width):
            over = min(max((apart[y, x] - tolerance) / (tolerance + tolerance), zero), one)
            share = max(quickly * over, urge[y, x])
            dx, dy = back[y, x, 0], back[y, x, 1]
            if dx != zero or dy != zero:
                share = max(share, np.float32(MOVING))
                px, py = np.float32(x) + dx, np.float32(y) + dy
                if px < zero or py < zero or px > np.float32(width - 1) or py > np.float32(height - 1):
                    share = one
            for c in range(channels):
                out[y, x, c] = past[y, x, c] + share * (now[y, x, c] - past[y, x, c])
