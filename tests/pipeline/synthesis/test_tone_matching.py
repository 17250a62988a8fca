"""Tone matching: distributions agree, contrast changes within limits only, details and figures stay."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.synthesis.tone_matching import ToneAccumulator, ToneMatch, tone_statistics


def guide(low: int, high: int, spread: float = 3) -> np.ndarray:
    """CIELAB: lightness rises from `low` to `high` along x, hues are normal around 128."""
    rng = np.random.default_rng(low + high)
    lightness = np.broadcast_to(np.linspace(low, high, 100), (100, 100))
    hues = rng.normal(128, spread, (100, 100, 2))
    return np.dstack([lightness, hues]).clip(0, 255).round().astype(np.uint8)


def gray(lightness: np.ndarray) -> np.ndarray:
    """CIELAB without hue."""
    return np.dstack([lightness, np.full((*lightness.shape, 2), 128)]).astype(np.uint8)


def matched(own: np.ndarray, wanted: np.ndarray, limit: float) -> np.ndarray:
    return ToneMatch(tone_statistics([own]), tone_statistics([wanted]), limit)(own).astype(float)


@pytest.mark.parametrize("limit", [1.5, 3.0])
def test_contrast_is_raised_up_to_the_limit_only(limit: float) -> None:
    flat, painting = guide(120, 130), guide(20, 220)
    out = matched(flat, painting, limit)
    assert np.ptp(out[..., 0]) <= limit * 10 + 1
    assert out[..., 0].mean() == pytest.approx(matched(flat, painting, 256)[..., 0].mean(), abs=2)


def test_contrast_of_the_scene_is_kept_where_the_painting_has_none() -> None:
    scene, painting = guide(20, 220), guide(120, 130)
    assert np.ptp(matched(scene, painting, 2)[..., 0]) >= 0.5 * 200 - 5
    assert np.ptp(matched(scene, painting, 20)[..., 0]) <= 35


def test_distributions_agree_if_the_contrast_is_within_the_limit() -> None:
    out = matched(guide(60, 160, spread=8), guide(30, 200, spread=12), 2)
    assert np.quantile(out[..., 0], [0.05, 0.5, 0.95]) == pytest.approx([38, 115, 191], abs=5)
    assert out[..., 1:].std((0, 1)) == pytest.approx([12, 12], rel=0.1)


@pytest.mark.parametrize(("low", "high"), [(30, 90), (190, 250)])
def test_a_night_stays_dark_and_a_bright_day_bright(low: int, high: int) -> None:
    scene, painting = guide(low, high), guide(20, 220)
    own, mean = (low + high) / 2, matched(scene, painting, 2)[..., 0].mean()
    assert max(mean / own, own / mean) == pytest.approx(2**0.5, abs=0.05)


def test_a_night_in_a_bright_painting_uses_a_quarter_of_it() -> None:
    """The darkest tones alone would repeat: the mean is that of an exponential share of a quarter of the painting."""
    mean = matched(guide(5, 15), guide(120, 220), 2)[..., 0].mean()
    assert 130 <= mean <= 145


def test_noise_keeps_its_contrast_where_that_of_areas_is_raised() -> None:
    noise = np.random.default_rng(0).integers(-4, 5, (100, 100))
    scene = guide(60, 160)
    scene[..., 0] = np.where(np.arange(100) < 50, 90, 130) + noise
    out = matched(scene, guide(20, 240), 2)[..., 0]
    left, right = out[:, :40], out[:, 60:]
    assert right.mean() - left.mean() > 1.2 * 40
    assert left.std() == pytest.approx(noise.std(), rel=0.2)


def test_a_detail_keeps_its_contrast_where_that_of_areas_is_lowered() -> None:
    lightness = np.broadcast_to(np.linspace(20, 220, 240), (240, 240)).copy()
    lightness[119:122, 119:122] -= 20
    out = matched(gray(lightness), gray(np.broadcast_to(np.linspace(120, 130, 240), (240, 240))), 2)[..., 0]
    around = np.concatenate([out[110:116, 119:122], out[125:131, 119:122]])
    assert around.mean() - out[120, 120] >= 0.8 * 20
    assert np.ptp(out[:100]) < 0.6 * 200


def test_contrast_is_raised_less_where_other_areas_would_merge() -> None:
    """A window in front of a wall: the painting has few bright tones, so that raised contrasts of the darker areas
    would be larger than that of the window."""
    scene = np.full((160, 160), 140)
    scene[:, :80] = np.repeat(np.linspace(60, 110, 20).round(), 8)[:, None]
    scene[20:140, 100:150] = 255
    painting = np.concatenate([np.linspace(40, 180, 4000), np.linspace(180, 215, 12000)]).reshape(160, 100)
    match = ToneMatch(tone_statistics([gray(scene)]), tone_statistics([gray(painting)]), 2)
    dark, middle = (float(match(gray(np.full((20, 20), lightness)))[0, 0, 0]) for lightness in (70, 100))
    assert 1.0 <= (middle - dark) / (100 - 70) <= 1.3


def test_hues_that_are_raised_beyond_the_limit_count_less() -> None:
    faint, strong, painting = guide(60, 160, spread=5), guide(60, 160, spread=12), guide(60, 160, spread=20)
    wanted = tone_statistics([painting])
    match = ToneMatch(tone_statistics([faint]), wanted, 2)
    assert match(faint)[..., 1:].std((0, 1)) == pytest.approx([20, 20], rel=0.1)
    assert match.hue_weight == pytest.approx((2 / 4) ** 2, rel=0.1)
    assert ToneMatch(tone_statistics([strong]), wanted, 2).hue_weight == 1


def test_statistics_count_pixels_inside_only_and_in_any_order() -> None:
    images = [guide(20, 220), guide(60, 90)]
    inside = np.zeros((100, 100), bool)
    inside[:, :50] = True
    found = []
    for order in (images, images[::-1]):
        accumulator = ToneAccumulator()
        for image in order:
            accumulator.add(image, inside)
        found.append(accumulator.statistics())
    cut = tone_statistics([image[:, :50] for image in images])
    for name, values in vars(found[0]).items():
        np.testing.assert_array_equal(values, vars(found[1])[name])
        np.testing.assert_allclose(values, vars(cut)[name])
