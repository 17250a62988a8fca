"""Lighting of paint."""

from __future__ import annotations

import math

import numpy as np

from pipeline.strokes.brush import blank
from pipeline.strokes.emboss import Lighting, emboss, weave

ODD = (37, 53)


def hill() -> np.ndarray:
    canvas = blank(np.full((*ODD, 3), 120, np.uint8))
    y, x = np.indices(ODD)
    canvas[..., 3] = np.maximum(0, 3 - np.hypot(x - 26, y - 18) / 4)
    return canvas


def test_lighting_per_pixel_is_the_same_as_uniform_lighting_where_it_is_uniform() -> None:
    left = np.zeros(ODD, np.float32)
    left[:, :26] = 0.4
    mixed = emboss(hill(), Lighting(strength=left, gloss=0))
    np.testing.assert_array_equal(mixed[:, :26], emboss(hill(), Lighting(strength=0.4, gloss=0))[:, :26])
    np.testing.assert_array_equal(mixed[:, 26:], 120)


def test_light_from_the_other_side_swaps_lit_and_shaded() -> None:
    one = emboss(hill(), Lighting(0.4, 0.3, gloss=0)).astype(int)
    other = emboss(hill(), Lighting(0.4 + math.pi, 0.3, gloss=0)).astype(int)
    assert np.abs(one + other - 240).max() <= 1
    assert one.max() > 125


def test_the_side_towards_the_light_is_lit() -> None:
    lit = emboss(hill(), Lighting(math.pi, 0.5, gloss=0))
    assert lit[18, 20, 0] > 122 > 118 > lit[18, 32, 0]


def test_level_paint_and_no_light_keep_the_colour() -> None:
    canvas = hill()
    np.testing.assert_array_equal(emboss(canvas, Lighting(strength=0, gloss=0)), 120)
    canvas[..., 3] = 5
    np.testing.assert_array_equal(emboss(canvas, Lighting()), 120)


def test_gloss_only_adds_light() -> None:
    plain, glossy = (emboss(hill(), Lighting(strength=0, gloss=g)).astype(int) for g in (0.0, 0.9))
    assert (glossy >= plain).all() and (glossy > plain).any()


def test_paint_fills_the_weave() -> None:
    thin, thick = blank(np.full((*ODD, 3), 120, np.uint8)), blank(np.full((*ODD, 3), 120, np.uint8))
    thick[..., 3] = 4
    bare, filled = (emboss(c, Lighting(weave_px=1.0, gloss=0)).std() for c in (thin, thick))
    assert bare > 3 * filled > 0


def test_the_weave_repeats_without_a_seam() -> None:
    tile = weave()
    inner = np.abs(np.diff(tile, axis=0)).max()
    assert np.abs(tile[0] - tile[-1]).max() <= inner * 1.2
    assert tile.min() == -1 and tile.max() == 1
