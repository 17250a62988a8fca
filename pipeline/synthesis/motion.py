"""Which way to a frame's neighbour in time: from optical flow, or from velocities that are given."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.flow.reliability import chi_minus, chi_plus
from pipeline.frames import Flow
from pipeline.synthesis.images import Bytes, halved


@dataclass(frozen=True)
class Motion:
    """From a frame to a neighbour in time."""

    way: Flow
    """float32 (h, w, 2): from each pixel to where it is in the other frame, px."""
    visible: Bytes
    """uint8 (h, w): chi of benard2013stylizing, 1 = seen in the other frame."""


def between(velocity_plus: Flow, velocity_minus: Flow, epsilon_px2: float) -> tuple[Motion, Motion]:
    """The motions between two frames: from the first to the second, and back.

    Args:
        velocity_plus: V+ of the first frame: a point at p goes to p + V+(p).
        velocity_minus: V- of the second frame: a point at p came from p - V-(p).
        epsilon_px2: of chi; math.inf = nothing is ever taken to be hidden.
    """
    forth = chi_plus(velocity_plus, velocity_minus, epsilon_px2)
    back = chi_minus(velocity_minus, velocity_plus, epsilon_px2)
    return Motion(velocity_plus, forth.astype(np.uint8)), Motion(-velocity_minus, back.astype(np.uint8))


STILL_PX = 0.1
BARELY_PX = 0.5
STILL_LEVELS = 2.0
"""Mean difference of the grays over 5x5 up to which what barely moves stands still."""


def stilled(velocity: Flow, here: Bytes, there: Bytes) -> Flow:
    """A velocity field that is exactly 0 where nothing moves.

    Args:
        velocity: float32 (h, w, 2), px, as estimated.
        here, there: uint8 (h, w), both frames' grays.

    Departure: an estimated velocity is a few hundredths of a pixel wherever nothing moves, and strokes that it carries
    slip to and fro by a pixel. Up to `STILL_PX` it is taken for 0, and up to `BARELY_PX` where the pictures do not
    differ. A flat part of what moves faster goes on moving with the rest of it.
    """
    squares = np.square(velocity).sum(-1)
    apart = cv2.boxFilter(cv2.absdiff(here, there), cv2.CV_32F, (5, 5))
    still = (squares < STILL_PX**2) | ((squares < BARELY_PX**2) & (apart <= STILL_LEVELS))
    return np.where(still[..., None], np.float32(0), velocity)


def coarser(velocity: Flow, levels: int) -> Flow:
    """A velocity field `levels` levels up: half the size and half the speed each.

    The top left pixel of each four, since a mean of two objects' velocities is neither's.
    """
    for _ in range(levels):
        velocity = np.asarray(halved(velocity, nearest=True), np.float32) / np.float32(2)
    return np.ascontiguousarray(velocity)
