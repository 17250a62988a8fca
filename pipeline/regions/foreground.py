"""Propagation of foreground and background from frame to frame by flow, local colour models and a random walk.

zhang2011patches uses Video SnapCut (bai2009snapcut). Its main idea is kept: along a silhouette, foreground and
background are distinguished by local colours, not by the colours of the whole picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Labels, Plane
from pipeline.regions.random_walk import Edges, vote


@dataclass(frozen=True)
class ForegroundParams:
    """Constants of the choice of the foreground."""

    local_px: int = 31
    """Side of the windows of the local colour models, px."""
    colour_share: float = 0.4
    """Weight of a certain colour vote, relative to a link of the flow."""
    user_weight: float = 5.0
    """Weight of the user's marks, relative to a link of the flow."""
    noise: float = 6.0
    """Least standard deviation of a colour model, gray levels."""


FOREGROUND = ForegroundParams()


def propagate_foreground(
    choices: NDArray[np.int32], weights: NDArray[np.float32], small: Frame, edges: Edges, marks: Plane | None = None
) -> NDArray[np.bool_]:
    """Foreground of a frame: bool (h, w).

    Args:
        choices: int32 (k, h, w), label at the other end of each of a pixel's k links to other frames: 2 = foreground,
            1 = background, 0 = unknown.
        weights: float32 (k, h, w), weights of the links.
        small: uint8 (h, w, 3), the frame's colours.
        edges: weights of the edges within the frame.
        marks: float32 (h, w), the user's marks: 1 = foreground, 0 = background, NaN = none; None = no marks.
    """
    guess = _guess(choices, weights) if marks is None else np.where(np.isnan(marks), 0, marks + 1).astype(np.int32)
    likely = colour_odds(small, guess)
    colour = np.where(likely > 0, 2, 1).astype(np.int32)
    options, option_weights = [colour, *choices], [FOREGROUND.colour_share * np.abs(likely), *weights]
    if marks is not None:
        options.append(guess)
        option_weights.append(np.where(guess > 0, np.float32(FOREGROUND.user_weight), np.float32(0)))
    labels, _ = vote(
        np.stack(options), np.stack(option_weights).astype(np.float32), edges, leak=1e-4, certainty=0.0, tolerance=1e-4
    )
    return np.asarray(labels == 2)


def _guess(choices: NDArray[np.int32], weights: NDArray[np.float32]) -> Labels:
    """Label 2 or 1 where the links agree, 0 elsewhere."""
    ahead = ((choices == 2) * weights).sum(axis=0) - ((choices == 1) * weights).sum(axis=0)
    return np.where(np.abs(ahead) < 0.3, 0, np.where(ahead > 0, 2, 1)).astype(np.int32)


def colour_odds(small: Frame, guess: Labels) -> Plane:
    """Similarity of each pixel's colour to nearby foreground (towards 1) or background (towards -1): float32 (h, w).

    The colours of each label within FOREGROUND.local_px are modelled by normal distributions; 0 where one of them is
    missing.

    Args:
        guess: int32 (h, w): 2 = foreground, 1 = background, 0 = unknown.
    """
    colours = cv2.GaussianBlur(small, (0, 0), 0.7).astype(np.float32)
    fore, near_fore = _likelihood(colours, guess == 2)
    back, near_back = _likelihood(colours, guess == 1)
    both = np.minimum(near_fore, near_back)
    odds = np.tanh((fore - back) / 4)
    return np.asarray(odds * np.clip(both * 20, 0, 1), np.float32)


def _likelihood(colours: NDArray[np.float32], where: NDArray[np.bool_]) -> tuple[Plane, Plane]:
    """Log likelihood of each pixel's colour in the local model of `where`, and the share of `where` in the window."""
    mask = where.astype(np.float32)
    share = cv2.blur(mask, (FOREGROUND.local_px, FOREGROUND.local_px))
    scale = 1 / np.maximum(share, np.float32(1e-4))
    total: Plane = np.zeros(mask.shape, np.float32)
    for channel in range(3):
        plane = colours[..., channel]
        mean = cv2.blur(plane * mask, (FOREGROUND.local_px, FOREGROUND.local_px)) * scale
        square = cv2.blur(plane * plane * mask, (FOREGROUND.local_px, FOREGROUND.local_px)) * scale
        spread = np.maximum(square - mean * mean, np.float32(FOREGROUND.noise**2))
        total -= np.square(plane - mean) / spread + np.log(spread)
    return total, np.asarray(share, np.float32)
