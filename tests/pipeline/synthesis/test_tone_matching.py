"""Tone matching: distributions agree, contrast changes within limits only."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.synthesis.tone_matching import ToneMatch, tone_statistics


def guide(low: int, high: int, spread: float = 3) -> np.ndarray:
    """CIELAB noise: lightness uniform in [low, high), hues normal around 128."""
    rng = np.random.default_rng(low + high)
    lightness = rng.integers(low, high, (100, 100))
    hues = rng.normal(128, spread, (100, 100, 2))
    return np.dstack([lightness, hues]).clip(0, 255).round().astype(np.uint8)


def matched(own: np.ndarray, wanted: np.ndarray, limit: float) -> np.ndarray:
    return ToneMatch(tone_statistics([own]), tone_statistics([wanted]), limit)(own).astype(float)


@pytest.mark.parametrize("limit", [1.5, 3.0])
def test_noise_of_a_flat_area_is_amplified_up_to_the_limit_only(limit: float) -> None:
    flat, painting = guide(120, 130), guide(20, 220, spread=30)
    out = matched(flat, painting, limit)
    assert np.ptp(out[..., 0]) <= limit * np.ptp(flat[..., 0].astype(float)) + 1
    assert out[..., 0].mean() == pytest.approx(matched(flat, painting, 256)[..., 0].mean(), abs=2)
    assert out[..., 1].std() == pytest.approx(limit * flat[..., 1].astype(float).std(), rel=0.1)


def test_contrast_of_the_scene_is_kept_where_the_painting_has_none() -> None:
    scene, painting = guide(20, 220), guide(120, 130)
    assert np.ptp(matched(scene, painting, 2)[..., 0]) >= 0.5 * 199 - 1
    assert np.ptp(matched(scene, painting, 20)[..., 0]) <= 20


def test_distributions_agree_if_the_contrast_is_within_the_limit() -> None:
    out = matched(guide(60, 160, spread=8), guide(30, 200, spread=12), 2)
    assert np.quantile(out[..., 0], [0.05, 0.5, 0.95]) == pytest.approx([38, 115, 191], abs=5)
    assert out[..., 1:].std((0, 1)) == pytest.approx([12, 12], rel=0.1)
