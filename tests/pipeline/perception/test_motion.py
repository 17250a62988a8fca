"""Still pixels, temporal denoising, and blending of outputs."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from pipeline.colour.lab8 import Lab8, LabPlanes
from pipeline.frames import Flow
from pipeline.perception.backward_maps import backward_maps
from pipeline.perception.motion import (
    FADE_TOLERANCE,
    FAR,
    denoise,
    past_weights,
    zero_still_flow,
)

Bytes = NDArray[np.uint8]
SHAPE = (12, 16)


def uniform_flow(dx: float, dy: float, shape: tuple[int, int] = SHAPE) -> Flow:
    return np.tile(np.array([dx, dy], np.float32), (*shape, 1))


def noise(seed: int, low: int = 0, high: int = 256, shape: tuple[int, ...] = (*SHAPE, 3)) -> Bytes:
    return np.random.default_rng(seed).integers(low, high, shape).astype(np.uint8)


def denoised_from(lab: Lab8, past: Lab8, flow: Flow, memory: float, tolerance: float = 6.0) -> tuple[Lab8, Bytes]:
    planes, residual = denoise(planes_of(lab), past, flow, backward_maps(flow), memory, tolerance)
    return np.stack(planes, axis=-1), residual


def planes_of(lab: Lab8) -> LabPlanes:
    return np.ascontiguousarray(lab.transpose(2, 0, 1))


# -- standing still


def test_noise_gets_zero_flow_and_moving_pixels_keep_their_flow() -> None:
    before = np.full((24, 32), 90, np.uint8)
    now = before + noise(0, 0, 3, before.shape)
    now[6:16, 4:14] = 160
    flow = zero_still_flow(uniform_flow(1.5, -0.7, before.shape), before, now, tolerance=2)
    np.testing.assert_array_equal(flow[6:16, 4:14], uniform_flow(1.5, -0.7, (10, 10)))
    assert not flow[:, 20:].any() and not flow[20:].any()


@pytest.mark.parametrize(("change", "stands"), [(2, True), (3, False)])
def test_stillness_depends_on_the_mean_change_around_a_pixel(change: int, stands: bool) -> None:
    before = np.full(SHAPE, 90, np.uint8)
    flow = zero_still_flow(uniform_flow(1, 0), before, before + np.uint8(change), tolerance=2)
    assert flow.any() != stands


@pytest.mark.parametrize(
    ("dx", "dy", "stands"), [(0.09, 0, True), (0.07, 0.06, True), (0.08, 0.07, False), (0, -0.11, False)]
)
def test_displacements_below_a_tenth_of_a_pixel_are_zero(dx: float, dy: float, stands: bool) -> None:
    before = np.full(SHAPE, 90, np.uint8)
    flow = zero_still_flow(uniform_flow(dx, dy), before, before + np.uint8(50), tolerance=2)
    assert flow.any() != stands


# -- settling


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 999), st.integers(-3, 3), st.integers(-3, 3), st.sampled_from([0.0, 0.5, 0.85]))
def test_denoising_equals_a_plain_implementation(seed: int, dx: int, dy: int, memory: float) -> None:
    """Out = now + w (past - now), w = memory exp(-(d / 6)^2), d = CIELAB difference to the advected previous value."""
    now, before = noise(seed, 100, 116), noise(seed + 1, 100, 116)
    out, residual = denoised_from(now, before, uniform_flow(dx, dy), memory)
    weight = memory if (dx, dy) == (0, 0) else 0
    for y, x in np.ndindex(*SHAPE):
        j, i = y - dy, x - dx
        if not (0 <= j < SHAPE[0] and 0 <= i < SHAPE[1]):
            assert residual[y, x] == FAR
            np.testing.assert_array_equal(out[y, x], now[y, x])
            continue
        away = before[j, i].astype(float) - now[y, x]
        difference = float(np.linalg.norm(away * (100 / 255, 1, 1)))
        assert abs(residual[y, x] - 4 * difference) < 1.01
        wanted = now[y, x] + weight * np.exp(-((difference / 6) ** 2)) * away
        assert np.abs(out[y, x] - wanted).max() <= 1


def test_completely_changed_pixels_are_not_averaged() -> None:
    before = np.full((*SHAPE, 3), 100, np.uint8)
    now = before.copy()
    now[4:8, 4:8] = (100, 140, 100)
    out, residual = denoised_from(now, before, uniform_flow(0, 0), 0.9)
    np.testing.assert_array_equal(out, now)
    assert (residual[4:8, 4:8] == 160).all() and not residual[0].any()


def test_the_largest_difference_differs_from_no_counterpart() -> None:
    out, residual = denoised_from(
        np.full((*SHAPE, 3), 250, np.uint8), np.zeros((*SHAPE, 3), np.uint8), uniform_flow(0, 0), 0.9
    )
    assert (residual == 254).all() and (out == 250).all()


def test_a_noisy_still_picture_converges_to_its_mean() -> None:
    rng = np.random.default_rng(5)
    frames = [np.clip(np.rint(rng.normal(120, 2.0, (40, 40, 3))), 0, 255).astype(np.uint8) for _ in range(30)]
    denoised = [frames[0]]
    for now in frames[1:]:
        denoised.append(denoised_from(now, denoised[-1], uniform_flow(0, 0, (40, 40)), 0.85)[0])
    assert unrest(denoised[20:]) < 0.4 * unrest(frames[20:])
    assert denoised[-1].std() < 0.7 * frames[-1].std()
    assert abs(float(denoised[-1].mean()) - 120) < 0.5


def unrest(frames: list[Lab8]) -> float:
    return float(np.abs(np.diff(np.stack(frames).astype(int), axis=0)).mean())


def test_inputs_are_not_modified() -> None:
    now, before, flow = noise(1), noise(2), uniform_flow(1, 0)
    kept = now.copy(), before.copy(), flow.copy()
    denoised_from(now, before, flow, 0.8)
    for array, copy in zip((now, before, flow), kept, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_past_weights_fall_with_the_residual() -> None:
    weights = past_weights(0.6) / 256
    assert weights[0] == pytest.approx(0.6, abs=0.01)
    assert weights[round(FADE_TOLERANCE * 4)] == pytest.approx(0.6 / np.e, abs=0.01)
    assert weights[254] == weights[FAR] == 0
    assert not past_weights(0.0).any()
