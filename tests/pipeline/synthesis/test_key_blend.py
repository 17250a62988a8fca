"""Blend of keyframes: colours lead smoothly from one to the other, texture and contrast stay."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.synthesis.key_blend import KeyColours, Synthesised, contrast_preserving_blend, with_blended_colours

SIZE = (64, 96)
ALL = np.ones(SIZE, np.bool_)


def textured(mean: int, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(-20, 21, (*SIZE, 3))
    return (mean + noise).astype(np.uint8)


def shifted(picture: np.ndarray, axis: int) -> np.ndarray:
    """Each pixel's neighbour in the given direction; the last row or column is repeated."""
    last = picture[:, -1:] if axis == 1 else picture[-1:]
    return np.concatenate([picture[:, 1:] if axis == 1 else picture[1:], last], axis)


def seamless(picture: np.ndarray) -> Synthesised:
    return Synthesised(picture, shifted(picture, 1), shifted(picture, 0))


def keys(weight: float = 0.5) -> tuple[KeyColours, KeyColours]:
    """A darker and a brighter keyframe with different textures; `weight` is that of the darker one."""
    return KeyColours(textured(90, 1), ALL, weight), KeyColours(textured(150, 2), ALL, 1 - weight)


def test_a_seam_between_pixels_of_both_keyframes_disappears_and_the_texture_stays() -> None:
    before, after = keys()
    picture = before.colours.copy()
    picture[:, 48:] = after.colours[:, 48:]
    left, right = seamless(before.colours), seamless(after.colours)
    parts = [np.where(np.arange(96)[:, None] < 48, *pair) for pair in (
        (left.colours, right.colours), (left.right, right.right), (left.below, right.below)
    )]  # fmt: skip
    out = with_blended_colours(Synthesised(*parts), before, after, 1.0).astype(float)
    sides = [out[8:-8, columns].mean() for columns in (slice(40, 48), slice(48, 56))]
    original = [picture[8:-8, columns].mean() for columns in (slice(40, 48), slice(48, 56))]
    assert abs(sides[1] - sides[0]) < 0.1 * abs(original[1] - original[0])
    inside = (slice(8, -8), slice(4, 40))
    kept = np.corrcoef(np.diff(out[inside], axis=1).ravel(), np.diff(picture[inside].astype(float), axis=1).ravel())
    assert kept[0, 1] > 0.95


@pytest.mark.parametrize("weight", [0.25, 0.5, 0.9])
def test_a_blend_has_the_weighted_mean_and_the_contrast_of_the_keyframes(weight: float) -> None:
    before, after = keys(weight)
    blend = contrast_preserving_blend(before, after)
    assert blend.mean() == pytest.approx(weight * 90 + (1 - weight) * 150, abs=1)
    assert blend.std() == pytest.approx(before.colours.astype(float).std(), rel=0.05)


def test_keyframes_that_are_alike_keep_their_contrast() -> None:
    painting = textured(120, 1)
    darker = (0.8 * painting).astype(np.uint8)
    blend = contrast_preserving_blend(KeyColours(painting, ALL, 0.5), KeyColours(darker, ALL, 0.5))
    np.testing.assert_allclose(blend, 0.9 * painting, atol=1)


def test_where_one_keyframe_is_hidden_the_colours_are_those_of_the_other() -> None:
    before, after = keys()
    left = np.zeros(SIZE, np.bool_)
    left[:, :48] = True
    blend = contrast_preserving_blend(KeyColours(before.colours, left, 0.5), after)
    np.testing.assert_array_equal(blend[:, 48:], after.colours[:, 48:])


def test_a_frame_that_no_keyframe_reaches_is_unchanged() -> None:
    before, after = (KeyColours(key.colours, ~ALL, key.weight) for key in keys())
    picture = textured(120, 3)
    np.testing.assert_array_equal(with_blended_colours(seamless(picture), before, after, 1.0), picture)


def test_the_amount_scales_the_change() -> None:
    before, after = keys(0.2)
    picture = before.colours
    means = [with_blended_colours(seamless(picture), before, after, amount).mean() for amount in (0.0, 0.5, 1.0)]
    assert means[0] == picture.mean() and means[1] - means[0] == pytest.approx((means[2] - means[0]) / 2, rel=0.05)
