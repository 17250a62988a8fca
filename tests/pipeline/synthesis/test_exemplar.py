"""Preparation of paintings: spectrum like a video's, exact palette, strokes that keep their share of the frame."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.methods.analogy.inputs import StylePair
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.style_scaling import scaled_pair
from pipeline.synthesis.exemplar import VIDEO_SHARPNESS, PaintingColours, contrast, natural_sigma
from pipeline.synthesis.images import halved


def noise(height: int, width: int, sigma: float) -> np.ndarray:
    """Coloured noise blurred by a Gaussian."""
    rough = np.random.default_rng(4).integers(0, 256, (height, width, 3), dtype=np.uint8)
    if sigma == 0:
        return rough
    smooth = cv2.GaussianBlur(rough.astype(np.float32), (0, 0), sigma)
    return np.rint((smooth - smooth.min()) * (255 / (smooth.max() - smooth.min()))).astype(np.uint8)


def sharpness(picture: np.ndarray) -> float:
    gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return contrast(gray) / contrast(halved(gray).astype(np.float32))


def test_a_sharpened_picture_is_blurred_to_the_sharpness_of_videos_and_a_smooth_one_is_not() -> None:
    rough = noise(120, 160, 0)
    sigma = natural_sigma(rough)
    assert sharpness(rough) > 1.5 and sharpness(cv2.GaussianBlur(rough, (0, 0), sigma)) < VIDEO_SHARPNESS + 0.02
    assert sharpness(cv2.GaussianBlur(rough, (0, 0), sigma / 2)) > VIDEO_SHARPNESS
    assert natural_sigma(noise(120, 160, 3)) == 0


@pytest.mark.parametrize("colours", [1, 7, 4000])
def test_colours_become_the_nearest_of_the_palette(colours: int) -> None:
    palette = np.random.default_rng(colours).integers(0, 256, (1, colours, 3), dtype=np.uint8)
    picture = noise(20, 30, 1)
    found = PaintingColours(palette).nearest(picture).astype(int)
    differences = picture.reshape(-1, 1, 3).astype(int) - palette.reshape(1, -1, 3)
    nearest = (differences**2).sum(-1).min(1)
    np.testing.assert_array_equal(((found - picture) ** 2).sum(-1).ravel(), nearest)
    assert {tuple(c) for c in found.reshape(-1, 3)} <= {tuple(c) for c in palette.reshape(-1, 3).astype(int)}


def pair_of(painting: np.ndarray) -> StylePair:
    return StylePair(painting, cv2.cvtColor(painting[..., :3], cv2.COLOR_RGB2Lab), True)


@pytest.mark.parametrize(("stroke_scale", "share"), [(1.0, 1.0), (2.0, 4.0), (0.5, 0.25)])
def test_strokes_keep_their_share_of_the_frame_at_every_frame_size(stroke_scale: float, share: float) -> None:
    """Painting and frame have equally many pixels, times the square of `stroke_scale`."""
    pair, params = pair_of(noise(330, 220, 2)), AnalogyParams(stroke_scale=stroke_scale)
    for size in ((160, 90), (400, 225), (640, 360)):
        height, width = scaled_pair(pair, params, size).output.shape[:2]
        assert height * width / (size[0] * size[1]) == pytest.approx(share, rel=0.03)
        assert height / width == pytest.approx(1.5, rel=0.03)


def test_a_scaled_painting_has_only_colours_of_the_painting() -> None:
    painting = noise(120, 160, 0) // 64 * 64
    scaled = scaled_pair(pair_of(painting), AnalogyParams(), (80, 60)).output
    assert scaled.shape == (60, 80, 3) and sharpness(scaled) < 0.8
    assert {tuple(c) for c in scaled.reshape(-1, 3)} <= {tuple(c) for c in painting.reshape(-1, 3)}


def test_transparent_pixels_of_a_painting_give_no_colours() -> None:
    painting = np.dstack([noise(120, 160, 2), np.full((120, 160), 255, np.uint8)])
    painting[:, :80] = (255, 0, 255, 0)
    scaled = scaled_pair(pair_of(painting), AnalogyParams(), (80, 60)).output
    assert scaled.shape == (60, 80, 4) and not (scaled[..., :3] == (255, 0, 255)).all(-1).any()


def test_a_smooth_painting_of_the_size_of_the_frame_is_used_as_it_is() -> None:
    pair = pair_of(noise(90, 160, 3))
    assert scaled_pair(pair, AnalogyParams(), (160, 90)).output is pair.output
