"""Light on paint."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipeline.compute import device, report
from pipeline.strokes.brush import blank
from pipeline.strokes.emboss import Light, emboss, weave

ODD = (37, 53)


def hill() -> np.ndarray:
    canvas = blank(np.full((*ODD, 3), 120, np.uint8))
    y, x = np.indices(ODD)
    canvas[..., 3] = np.maximum(0, 3 - np.hypot(x - 26, y - 18) / 4)
    return canvas


@pytest.mark.real("opencl")
@pytest.mark.parametrize("channels", [4, 7])
@pytest.mark.parametrize("size", [(37, 53), (66, 130), (1, 9), (9, 1)])
def test_the_kernel_does_what_the_specification_says(size: tuple[int, int], channels: int) -> None:
    rng = np.random.default_rng(2)
    canvas = rng.uniform(-20, 280, (*size, channels)).astype(np.float32)
    canvas[..., 3] = rng.uniform(0, 4, size)
    light = Light(0.7, 0.4, gloss=0.3, weave_px=0.4)
    specified = emboss(canvas, light)
    for row in report(fresh=False):
        if row["works"]:
            got = emboss(canvas, light, device(str(row["platform"])))
            if row["kind"] == "cpu":
                np.testing.assert_array_equal(got, specified, str(row["platform"]))
            assert np.abs(got.astype(int) - specified).max() <= 1, str(row["platform"])


def test_light_from_the_other_side_swaps_lit_and_shaded() -> None:
    one = emboss(hill(), Light(0.4, 0.3, gloss=0)).astype(int)
    other = emboss(hill(), Light(0.4 + math.pi, 0.3, gloss=0)).astype(int)
    assert np.abs(one + other - 240).max() <= 1
    assert one.max() > 125


def test_the_side_towards_the_light_is_lit() -> None:
    lit = emboss(hill(), Light(math.pi, 0.5, gloss=0))
    assert lit[18, 20, 0] > 122 > 118 > lit[18, 32, 0]


def test_level_paint_and_no_light_keep_the_colour() -> None:
    canvas = hill()
    np.testing.assert_array_equal(emboss(canvas, Light(strength=0, gloss=0)), 120)
    canvas[..., 3] = 5
    np.testing.assert_array_equal(emboss(canvas, Light()), 120)


def test_gloss_only_adds_light() -> None:
    plain, glossy = (emboss(hill(), Light(strength=0, gloss=g)).astype(int) for g in (0.0, 0.9))
    assert (glossy >= plain).all() and (glossy > plain).any()


def test_paint_fills_the_weave() -> None:
    thin, thick = blank(np.full((*ODD, 3), 120, np.uint8)), blank(np.full((*ODD, 3), 120, np.uint8))
    thick[..., 3] = 4
    bare, filled = (emboss(c, Light(weave_px=1.0, gloss=0)).std() for c in (thin, thick))
    assert bare > 3 * filled > 0


def test_the_weave_repeats_without_a_seam() -> None:
    tile = weave()
    inner = np.abs(np.diff(tile, axis=0)).max()
    assert np.abs(tile[0] - tile[-1]).max() <= inner * 1.2
    assert tile.min() == -1 and tile.max() == 1
