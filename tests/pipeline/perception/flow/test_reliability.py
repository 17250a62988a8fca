"""Reliability and warping, against scenes whose occlusions are known."""

from __future__ import annotations

import numpy as np

from pipeline.perception.flow import estimate
from pipeline.perception.flow.reliability import inside, motion_boundary, visible
from pipeline.perception.flow.warp import warp_back
from pipeline.scenes import scene


def ramp(height: int = 24, width: int = 32) -> np.ndarray:
    y, x = np.mgrid[:height, :width].astype(np.float32)
    return np.stack([x, y, x + y], axis=-1)


def constant(dx: float, dy: float, height: int = 24, width: int = 32) -> np.ndarray:
    return np.broadcast_to(np.float32([dx, dy]), (height, width, 2)).copy()


def test_fetch_reads_where_the_flow_points() -> None:
    got = warp_back(ramp(), constant(2.5, -1.25))
    np.testing.assert_allclose(got[4:-4, 4:-4], (ramp() + np.float32([2.5, -1.25, 1.25]))[4:-4, 4:-4], atol=0.05)


def test_points_of_opposite_flows_are_visible() -> None:
    there, back = constant(3, 1), constant(-3, -1)
    assert visible(there, back).sum() == (24 - 1) * (32 - 3)
    assert not visible(there, constant(0, 0)).any()
    assert inside(there).sum() == (24 - 1) * (32 - 3)


def test_motion_boundaries_lie_at_flow_discontinuities() -> None:
    flow = constant(0, 0)
    flow[:, 16:] = 4
    edge = motion_boundary(flow)
    assert edge[:, 15:17].all() and not edge[:, :14].any() and not edge[:, 18:].any()


def test_known_occlusions_are_found() -> None:
    made = scene("shapes", (256, 144), 6, 12.0)
    here, after = made.frame(3), made.frame(4)
    mask = visible(here.velocity_next, -after.velocity_previous)
    assert mask[~here.occluded_next].mean() > 0.98
    assert mask[here.occluded_next].mean() < 0.15


def test_the_visibility_test_separates_visible_from_hidden_points() -> None:
    made = scene("shapes", (256, 144), 6, 12.0)
    here, after = made.frame(3), made.image(4)
    mask = visible(estimate(here.image, after, "dis-medium"), estimate(after, here.image, "dis-medium"))
    assert mask[~here.occluded_next].mean() > 0.97
    assert mask[here.occluded_next].mean() < 0.7
