"""Anti-aliased rendering: exact inside a piece, between pixels, soft at seams, and only painted neighbours count."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest

from pipeline.synthesis.antialias import antialiased
from pipeline.synthesis.images import StyleImage
from pipeline.synthesis.refine import colours


def style_image(bins: np.ndarray | None = None, channels: int = 3) -> StyleImage:
    """A smooth picture of 48x40 px."""
    noise = np.random.default_rng(2).integers(0, 256, (40, 48, channels), dtype=np.uint8)
    picture = np.asarray(cv2.GaussianBlur(noise, (0, 0), 2.5)).astype(np.float32)
    stretched = np.rint((picture - picture.min()) * (255 / (picture.max() - picture.min()))).astype(np.uint8)
    return StyleImage(stretched, stretched, bins)


def identity(dx: float = 0, dy: float = 0, size: tuple[int, int] = (20, 16)) -> np.ndarray:
    """Offsets of one piece of the style, from (8, 8) on, moved by a fraction."""
    y, x = np.mgrid[: size[1], : size[0]].astype(np.float32)
    return np.ascontiguousarray(np.stack([x + np.float32(8 + dx), y + np.float32(8 + dy)], -1))


def test_whole_offsets_inside_a_piece_copy_the_style() -> None:
    style, offsets = style_image(), identity()
    np.testing.assert_array_equal(antialiased(style, offsets), colours(style, offsets))


@pytest.mark.parametrize(("dx", "dy"), [(0.5, 0.0), (0.25, -0.4375), (0.0, 0.75)])
def test_fractional_offsets_are_sampled_between_pixels(dx: float, dy: float) -> None:
    """A shifted piece equals the style resampled by an independent cubic filter, which copying pixels does not."""
    style, offsets = style_image(), identity(dx, dy)
    expected = cv2.resize(style.colours, None, fx=16, fy=16, interpolation=cv2.INTER_CUBIC).astype(float)
    at = np.rint((offsets + 0.5) * 16 - 0.5).astype(int)
    expected = expected[at[..., 1], at[..., 0]]
    sampled, copied = (
        np.abs(picture - expected).mean() for picture in (antialiased(style, offsets), colours(style, offsets))
    )
    assert sampled < 0.5 * copied


def test_a_stroke_moves_by_a_fraction_of_a_pixel() -> None:
    """Along a shift in eight steps every picture differs a little from the one before; copied pixels jump once."""
    style = style_image()
    steps = [identity(k / 8) for k in range(9)]
    smooth = [antialiased(style, offsets).astype(float) for offsets in steps]
    copied = [colours(style, offsets).astype(float) for offsets in steps]
    change, jump = (max(np.abs(b - a).mean() for a, b in pairwise(p)) for p in (smooth, copied))
    assert change < 0.3 * jump


def test_seams_are_blended_with_the_weights_of_both_pieces() -> None:
    flat = np.zeros((40, 48, 3), np.uint8)
    flat[:, 24:] = 160
    offsets = identity(size=(12, 10))
    offsets[:, 6:, 0] += 24
    row = antialiased(StyleImage(flat, flat), offsets)[5, :, 0]
    np.testing.assert_array_equal(row[[4, 5, 6, 7]], [0, 40, 120, 160])


def test_pixels_that_may_not_be_painted_do_not_count_for_their_neighbours() -> None:
    flat = np.zeros((40, 48, 3), np.uint8)
    flat[:, 24:] = 160
    offsets = identity(size=(12, 10))
    offsets[:, 6:, 0] += 24
    paintable = np.ones((10, 12), np.uint8)
    paintable[:, 6:] = 0
    assert not antialiased(StyleImage(flat, flat), offsets, paintable=paintable)[:, :6].any()


def test_transparent_paint_gives_no_colour_to_its_neighbours() -> None:
    picture = np.zeros((40, 48, 4), np.uint8)
    picture[:, :24] = (200, 100, 50, 255)
    picture[:, 24:] = (0, 255, 0, 0)
    offsets = identity(size=(12, 10))
    offsets[:, 6:, 0] += 24
    out = antialiased(StyleImage(picture, picture), offsets)
    np.testing.assert_array_equal(out[5, 5], (200, 100, 50, 191))
    np.testing.assert_array_equal(out[5, 4], (200, 100, 50, 255))


def test_opacity_does_not_overshoot_at_the_edge_of_paint() -> None:
    """Cubic weights are negative beside an edge: fully transparent there, not nearly opaque."""
    picture = np.zeros((40, 48, 4), np.uint8)
    picture[:, :16] = (200, 100, 50, 255)
    opacity = antialiased(StyleImage(picture, picture), identity(0.5))[5, :, 3]
    assert opacity[:7].min() == 255 and opacity[8:].max() == 0


def test_pieces_that_are_rotated_agree_inside() -> None:
    """A turned piece is copied sharply: its neighbours' positions follow its direction, not the picture's axes."""
    size = (20, 16)
    bins, style_bins = np.full((16, 20), 40, np.uint8), np.full((40, 48), 8, np.uint8)
    angle = np.pi * (8 - 40) / 64
    y, x = np.mgrid[: size[1], : size[0]].astype(np.float32)
    c, s = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    offsets = np.stack([14 + c * x - s * y, 28 + s * x + c * y], -1).astype(np.float32)
    inside = (slice(1, 10), slice(1, 10))
    turned = antialiased(style_image(style_bins), offsets, bins)[inside]
    alone = antialiased(style_image(), offsets[::3, ::3].repeat(3, 0).repeat(3, 1)[:16, :20])[inside]
    exact = colours(style_image(), np.rint(offsets))[inside]
    assert np.abs(turned.astype(int) - exact).mean() < 0.5 * np.abs(alone.astype(int) - exact).mean()
