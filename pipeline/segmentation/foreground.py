"""Foreground and background carried from frame to frame: flow, local colour models, and a random walk between.

The paper uses Video SnapCut (bai2009snapcut), whose idea is kept: along a silhouette it is local colours that tell the
two apart, not those of the whole picture.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Labels, Plane
from pipeline.segmentation.random_walk import Edges, vote

LOCAL_PX = 31
"""Side of the windows that colours are learnt in, px."""
COLOUR_SHARE = 0.4
"""Weight of the colours' vote where they are sure, beside 1 for a link of the flow."""
CERTAIN = 5.0
"""Weight of what the user has said."""
NOISE = 6.0
"""Standard deviation that any colour has at least, gray levels."""


def carry_foreground(
    choices: NDArray[np.int32], weights: NDArray[np.float32], small: Frame, edges: Edges, said: Plane | None = None
) -> NDArray[np.bool_]:
    """Where the foreground is: bool (h, w).

    Args:
        choices: int32 (k, h, w), by each of a pixel's links to other frames: 2 = foreground, 1 = background, 0 = not
            known.
        weights: float32 (k, h, w), of the links.
        small: the frame's colours, uint8 (h, w, 3).
        edges: weights of the edges within the frame.
        said: float32 (h, w), what the user says: 1, 0, or NaN where nothing is said; None = nothing.
    """
    guess = _guess(choices, weights) if said is None else np.where(np.isnan(said), 0, said + 1).astype(np.int32)
    likely = colour_odds(small, guess)
    colour = np.where(likely > 0, 2, 1).astype(np.int32)
    options, shares = [colour, *choices], [COLOUR_SHARE * np.abs(likely), *weights]
    if said is not None:
        options.append(guess)
        shares.append(np.where(guess > 0, np.float32(CERTAIN), np.float32(0)))
    labels, _ = vote(
        np.stack(options), np.stack(shares).astype(np.float32), edges, leak=1e-4, certainty=0.0, tolerance=1e-4
    )
    return np.asarray(labels == 2)


def _guess(choices: NDArray[np.int32], weights: NDArray[np.float32]) -> Labels:
    """2 or 1 where the links agree well, 0 elsewhere."""
    ahead = ((choices == 2) * weights).sum(axis=0) - ((choices == 1) * weights).sum(axis=0)
    return np.where(np.abs(ahead) < 0.3, 0, np.where(ahead > 0, 2, 1)).astype(np.int32)


def colour_odds(small: Frame, guess: Labels) -> Plane:
    """Whether a pixel's colour is rather the foreground's near it (towards 1) or the background's (towards -1).

    Colours of each, within LOCAL_PX, are taken for normally distributed; 0 where only one of them, or none, is near.

    Args:
        guess: int32 (h, w): 2 = foreground, 1 = background, 0 = not known.
    """
    colours = cv2.GaussianBlur(small, (0, 0), 0.7).astype(np.float32)
    fore, near_fore = _likelihood(colours, guess == 2)
    back, near_back = _likelihood(colours, guess == 1)
    both = np.minimum(near_fore, near_back)
    odds = np.tanh((fore - back) / 4)
    return np.asarray(odds * np.clip(both * 20, 0, 1), np.float32)


def _likelihood(colours: NDArray[np.float32], where: NDArray[np.bool_]) -> tuple[Plane, Plane]:
    """Log likelihood of each pixel's colour in the local model, and the share of the window that the model is from."""
    mask = where.astype(np.float32)
    share = cv2.blur(mask, (LOCAL_PX, LOCAL_PX))
    scale = 1 / np.maximum(share, np.float32(1e-4))
    total: Plane = np.zeros(mask.shape, np.float32)
    for channel in range(3):
        plane = colours[..., channel]
        mean = cv2.blur(plane * mask, (LOCAL_PX, LOCAL_PX)) * scale
        square = cv2.blur(plane * plane * mask, (LOCAL_PX, LOCAL_PX)) * scale
        spread = np.maximum(square - mean * mean, np.float32(NOISE**2))
        total -= np.square(plane - mean) / spread + np.log(spread)
    return total, np.asarray(share, np.float32)
