"""Ink on thin coloured stripes."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.colour.lab8 import rgb_to_lab8
from pipeline.lines.coloured_stripes import stripe_shares
from tests.pipeline.lines.drawn import SIGMA_PX, traced

RED, BLACK, WHITE, SALMON = (215, 40, 40), (20, 20, 20), (235, 235, 235), (235, 90, 80)


@pytest.mark.parametrize(
    ("stripe", "above", "below", "removed"),
    [
        (RED, WHITE, WHITE, True), (BLACK, WHITE, WHITE, False), (RED, WHITE, SALMON, False),
        ((40, 130, 50), WHITE, (120, 170, 230), True),
    ],
    ids=["red thread", "black line", "outline of a red area", "green stem before a sky"],
)  # fmt: skip
def test_only_the_ink_of_coloured_stripes_is_removed(
    stripe: tuple[int, ...], above: tuple[int, ...], below: tuple[int, ...], removed: bool
) -> None:  # fmt: skip
    frame = np.empty((40, 80, 3), np.uint8)
    frame[:18], frame[18:22], frame[22:] = above, stripe, below
    planes = rgb_to_lab8(np.asarray(cv2.GaussianBlur(frame, (0, 0), 0.8), np.uint8))
    points, curves, _ = traced(planes[0].astype(np.float32))
    shares = stripe_shares(points, curves, planes, 1.0, SIGMA_PX)
    on_stripe = np.abs(points["y"][curves.order] - 19.5) < 2
    assert on_stripe.sum() > 60
    assert (shares[on_stripe].min() > 0.9) if removed else (shares.max() < 0.1)
