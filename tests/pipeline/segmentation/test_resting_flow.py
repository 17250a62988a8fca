"""Which pixels rest."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.frames import Flow
from pipeline.segmentation.resting_flow import zero_resting_flow

SHAPE = (12, 16)


def uniform_flow(dx: float, dy: float, shape: tuple[int, int] = SHAPE) -> Flow:
    return np.tile(np.array([dx, dy], np.float32), (*shape, 1))


def test_noise_gets_zero_flow_and_moving_pixels_keep_their_flow() -> None:
    before = np.full((24, 32), 90, np.uint8)
    now = before + np.random.default_rng(0).integers(0, 3, before.shape).astype(np.uint8)
    now[6:16, 4:14] = 100  # not enough for a texture that moves
    flow = zero_resting_flow(uniform_flow(1.5, -0.7, before.shape), before, now, tolerance=2)
    np.testing.assert_array_equal(flow[6:16, 4:14], uniform_flow(1.5, -0.7, (10, 10)))
    assert not flow[:, 20:].any() and not flow[20:].any()


@pytest.mark.parametrize(("change", "stands"), [(2, True), (3, False)])
def test_stillness_depends_on_the_mean_change_around_a_pixel(change: int, stands: bool) -> None:
    before = np.full(SHAPE, 90, np.uint8)
    flow = zero_resting_flow(uniform_flow(1, 0), before, before + np.uint8(change), tolerance=2)
    assert flow.any() != stands


@pytest.mark.parametrize(
    ("dx", "dy", "stands"), [(0.09, 0, True), (0.07, 0.06, True), (0.08, 0.07, False), (0, -0.11, False)]
)
def test_displacements_below_a_tenth_of_a_pixel_are_zero(dx: float, dy: float, stands: bool) -> None:
    before = np.full(SHAPE, 90, np.uint8)
    flow = zero_resting_flow(uniform_flow(dx, dy), before, before + np.uint8(50), tolerance=2)
    assert flow.any() != stands


@pytest.mark.parametrize(("moved", "sky"), [(240, -3), (0, 0), (120, None)])
def test_a_flat_sky_moves_with_the_camera(moved: int, sky: float | None) -> None:
    """The upper part has no texture; in the lower part texture moves by 3 px up to column `moved` and rests beyond."""
    rough = cv2.GaussianBlur(np.random.default_rng(4).normal(0, 900, (160, 260)), (0, 0), 2) + 128
    rough = np.clip(rough, 0, 255).astype(np.uint8)
    before, after = rough[:, :240].copy(), rough[:, :240].copy()
    after[:, :moved] = rough[:, 3 : moved + 3]
    before[:60], after[:60] = 200, 200
    flow = zero_resting_flow(np.full((160, 240, 2), (-3, 0), np.float32), before, after, 2)[..., 0]
    if sky is not None:
        assert (flow[:60] == sky).mean() > 0.9, "edges along the motion look as if they rested"
    assert (flow[52:60, 16:104] == (-3 if moved else 0)).mean() > 0.9, "the sky does what is below it"
    assert (flow[52:60, 136:224] == (-3 if moved == 240 else 0)).mean() > 0.9


@pytest.mark.parametrize(("flow_px", "goes"), [(-3.0, True), (-0.2, False)])
def test_a_flat_object_moves_past_still_objects_with_the_flow(flow_px: float, goes: bool) -> None:
    """A stripe with a rough edge moves by 3 px over a rough wall; its plain middle does not change."""
    rough = np.clip(cv2.GaussianBlur(np.random.default_rng(4).normal(0, 900, (160, 260)), (0, 0), 2) + 128, 0, 255)
    before = rough[:, :240].astype(np.uint8)
    after = before.copy()
    before[64:80], after[64:80] = 128, 128
    edge = np.random.default_rng(5).integers(0, 255, (4, 243), np.uint8)
    for top in (64, 76):
        before[top : top + 4], after[top : top + 4] = edge[:, :240], edge[:, 3:]
    flow = np.zeros((160, 240, 2), np.float32)
    flow[64:80, :, 0] = flow_px
    found = zero_resting_flow(flow, before, after, 2)[..., 0]
    assert (found[71:73, 30:210] == (flow_px if goes else 0)).mean() > 0.9
    assert (found[:40] == 0).all() and (found[120:] == 0).all()
