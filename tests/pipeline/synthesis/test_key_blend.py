"""Blend of keyframes: colours lead smoothly from one to the other, texture and contrast stay."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.synthesis.key_blend import KeyPicture, Synthesised, with_blended_colours

SIZE = (64, 96)
ALL = np.ones(SIZE, np.bool_)


def textured(mean: int, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(-20, 21, (*SIZE, 3))
    return (mean + noise).astype(np.uint8)


def shifted(picture: np.ndarray, axis: int) -> np.ndarray:
    """Each pixel's neighbour in the given direction; the last row or column is repeated."""
    last = picture[:, -1:] if axis == 1 else picture[-1:]
    return np.concatenate([picture[:, 1:] if axis == 1 else picture[1:], last], axis)


SCENE = np.random.default_rng(4).integers(60, 200, (*SIZE, 3)).astype(np.uint8)
LEFT = np.broadcast_to(np.arange(SIZE[1]) < 48, SIZE)


def positions(size: tuple[int, int] = SIZE) -> np.ndarray:
    """Offsets that reproduce a keyframe."""
    return np.stack(np.meshgrid(np.arange(size[1]), np.arange(size[0])), -1).astype(np.float32)


def synthesised(picture: np.ndarray) -> Synthesised:
    return Synthesised(picture, shifted(picture, 1), shifted(picture, 0), positions(), SCENE)


def keys(weight: float = 0.5, scenes: tuple[np.ndarray, np.ndarray] = (SCENE, SCENE)) -> tuple[KeyPicture, KeyPicture]:
    """A darker and a brighter keyframe with different textures; `weight` is that of the darker one."""
    colours = textured(90, 1), textured(150, 2)
    return (
        KeyPicture(colours[0], scenes[0], ALL, weight, 0.5), KeyPicture(colours[1], scenes[1], ALL, 1 - weight, 0.5)
    )  # fmt: skip


def halves(before: KeyPicture, after: KeyPicture) -> Synthesised:
    """The left half is of the keyframe before, the right half of the one after."""
    pairs = zip((before.colours, *_next(before)), (after.colours, *_next(after)), strict=True)
    parts = [np.where(LEFT[..., None], one, other) for one, other in pairs]
    offsets = positions() + np.where(LEFT, 0, 100).astype(np.float32)[..., None] * np.float32([0, 1])
    return Synthesised(parts[0], parts[1], parts[2], offsets, SCENE)


def _next(key: KeyPicture) -> tuple[np.ndarray, np.ndarray]:
    return shifted(key.colours, 1), shifted(key.colours, 0)


def step(picture: np.ndarray) -> float:
    """Difference of the means of 8 px on both sides of the middle."""
    return float(picture[8:-8, 48:56].mean() - picture[8:-8, 40:48].mean())


def test_a_seam_between_pixels_of_both_keyframes_disappears_and_the_texture_stays() -> None:
    before, after = keys()
    frame = halves(before, after)
    out = with_blended_colours(frame, before, after, 1.0)
    assert abs(step(out)) < 0.1 * abs(step(frame.colours))
    inside = (slice(8, -8), slice(4, 40))
    kept = np.corrcoef(*(np.diff(picture[inside].astype(float), axis=1).ravel() for picture in (out, frame.colours)))
    assert kept[0, 1] > 0.95


@pytest.mark.parametrize("skipped", [1, 20])
def test_an_edge_at_which_offsets_skip_a_pixel_stays_and_one_at_a_distant_part_disappears(skipped: int) -> None:
    edge = np.where(LEFT[..., None], np.uint8(30), np.uint8(200)).repeat(3, 2)
    between = [KeyPicture(np.full_like(edge, 115), SCENE, ALL, 0.5, 0.5)] * 2
    offsets = positions() + np.where(LEFT, 0, skipped).astype(np.float32)[..., None] * np.float32([1, 0])
    out = with_blended_colours(Synthesised(edge, edge, edge, offsets, SCENE), between[0], between[1], 1.0)
    assert (step(out) > 100) if skipped == 1 else (abs(step(out)) < 20)


@pytest.mark.parametrize("weight", [0.25, 0.5, 0.9])
def test_the_colours_are_the_weighted_mean_and_the_contrast_stays(weight: float) -> None:
    before, after = keys(weight)
    out = with_blended_colours(synthesised(before.colours), before, after, 1.0)
    assert out.mean() == pytest.approx(weight * 90 + (1 - weight) * 150, abs=1)
    assert out.std() == pytest.approx(before.colours.astype(float).std(), rel=0.1)


def test_a_thing_that_only_one_keyframe_shows_leaves_no_ghost() -> None:
    """The right half of the keyframe after shows another part of the scene: an object has moved away."""
    other = np.where(LEFT[..., None], SCENE, 255 - SCENE // 2)
    before, after = keys(scenes=(SCENE, other))
    change = with_blended_colours(synthesised(before.colours), before, after, 1.0).astype(float) - before.colours
    assert change[:, :16].mean() == pytest.approx(30, abs=3)
    assert np.abs(change[:, 90:]).mean() < 2


def test_a_scene_that_becomes_darker_evenly_is_what_both_keyframes_show() -> None:
    bright, dark = (np.clip(SCENE.astype(int) + light, 0, 255).astype(np.uint8) for light in (40, -40))
    before, after = keys(scenes=(bright, dark))
    assert with_blended_colours(synthesised(before.colours), before, after, 1.0).mean() == pytest.approx(120, abs=1)


def test_where_one_keyframe_is_hidden_the_colours_are_those_of_the_other() -> None:
    before, after = keys()
    hidden = KeyPicture(before.colours, before.scene, LEFT, 0.5, 0.5)
    out = with_blended_colours(synthesised(after.colours), hidden, after, 1.0).astype(float)
    assert out[:, 88:].mean() == pytest.approx(150, abs=2) and out[:, :8].mean() == pytest.approx(120, abs=2)


def test_a_frame_that_no_keyframe_reaches_is_unchanged() -> None:
    before, after = (KeyPicture(key.colours, key.scene, ~ALL, key.weight, 0.5) for key in keys())
    picture = textured(120, 3)
    np.testing.assert_array_equal(with_blended_colours(synthesised(picture), before, after, 1.0), picture)


@pytest.mark.parametrize("size", [(1, 1), (1, 2), (7, 9), (30, 41)])
def test_frames_of_every_size_are_adjusted(size: tuple[int, int]) -> None:
    dark, bright, scene = (np.full((*size, 3), level, np.uint8) for level in (90, 150, 100))
    both = [KeyPicture(colours, scene, np.ones(size, np.bool_), 0.5, 0.5) for colours in (dark, bright)]
    out = with_blended_colours(Synthesised(dark, dark, dark, positions(size), scene), both[0], both[1], 1.0)
    np.testing.assert_array_equal(out, np.full((*size, 3), 120, np.uint8))


def test_the_amount_scales_the_change() -> None:
    before, after = keys(0.2)
    frame = synthesised(before.colours)
    means = [with_blended_colours(frame, before, after, amount).mean() for amount in (0.0, 0.5, 1.0)]
    original = frame.colours.mean()
    assert means[0] == original and means[1] - original == pytest.approx((means[2] - original) / 2, rel=0.05)
