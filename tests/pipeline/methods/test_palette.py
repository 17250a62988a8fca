"""Region colours over time: zhang2011online, eq. 4."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.colour.scheme import Tone, learn
from pipeline.colour.spaces import lab_to_srgb, srgb_to_lab, to_8bit
from pipeline.methods.abstraction.palette import LARGEST_LAG, Palette
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.regions.segmenter import Segmentation

GRAY, DARKER, DARK, RED = (150, 128, 128), (138, 128, 128), (60, 128, 128), (140, 190, 170)
"""8-bit Lab."""


def regions(means: list[tuple[int, int, int]], previous: list[int], alpha: list[float]) -> Segmentation:
    rows = len(means) + 1
    labels = np.repeat(np.arange(1, rows, dtype=np.int32)[:, None], 16, axis=1)
    return Segmentation(
        labels=labels,
        ids=np.arange(rows, dtype=np.int64),
        areas=np.full(rows, 100, np.int32),
        means=np.array([(0, 128, 128), *means], np.float32),
        previous=np.array([0, *previous], np.int32),
        alpha=np.array([0, *alpha], np.float32),
        residual=0,
        propagated=np.array([0, *previous], np.int32)[labels],
    )


def lab_of(mean: tuple[int, int, int]) -> np.ndarray:
    return np.array(mean) * (100 / 255, 1, 1) - (0, 128, 128)


def rgb_of(lab: np.ndarray) -> np.ndarray:
    return to_8bit(lab_to_srgb(lab))


def palette(**values: float) -> Palette:
    return Palette(AbstractionParams(**values), None)


def test_without_a_reference_a_region_has_its_mean_colour() -> None:
    made = palette().step(regions([GRAY, RED], [0, 0], [0, 0]), None)
    np.testing.assert_array_equal(made[1:], rgb_of(np.stack([lab_of(GRAY), lab_of(RED)])))
    assert made.dtype == np.uint8


@pytest.mark.parametrize("alpha", [0.0, 0.25, 0.8, 1.0])
def test_equation_4_on_known_values(alpha: float) -> None:
    """o(i) = (1 - alpha) o(i-1) + alpha c(i), in CIELAB: the paper's equation, without a half-life."""
    mixing = palette(colour_half_life=0)
    mixing.step(regions([GRAY], [0], [0]), None)
    made = mixing.step(regions([DARK], [1], [alpha]), None)
    wanted = (1 - alpha) * lab_of(GRAY) + alpha * lab_of(DARK)
    np.testing.assert_array_equal(made[1], rgb_of(wanted))


def test_colours_are_blended_with_the_previous_output() -> None:
    mixing = palette(colour_half_life=0)
    mixing.step(regions([GRAY], [0], [0]), None)
    mixing.step(regions([DARK], [1], [0.5]), None)
    made = mixing.step(regions([DARK], [1], [0.5]), None)
    np.testing.assert_array_equal(made[1], rgb_of(0.25 * lab_of(GRAY) + 0.75 * lab_of(DARK)))


def test_a_new_region_has_its_target_colour_at_once() -> None:
    mixing = palette(colour_half_life=0)
    mixing.step(regions([GRAY, RED], [0, 0], [0, 0]), None)
    made = mixing.step(regions([RED, DARK, DARK], [2, 0, 1], [0.5, 0.0, 0.0]), None)
    np.testing.assert_array_equal(made[1:], rgb_of(np.stack([lab_of(RED), lab_of(DARK), lab_of(GRAY)])))


def test_a_new_region_starts_from_what_was_painted_there() -> None:
    """With a half-life of one frame, half of the old colour remains: the region was half `GRAY`, half `DARKER`."""
    mixing = palette(colour_half_life=1)
    mixing.step(regions([GRAY, DARKER], [0, 0], [0, 0]), None)
    after = regions([GRAY], [0], [0])
    after.labels[:], after.propagated[:] = 1, np.repeat([1, 2], 8)
    made = srgb_to_lab(mixing.step(after, None)[1] / 255)
    assert np.abs(made - (0.75 * lab_of(GRAY) + 0.25 * lab_of(DARKER))).max() < 0.4


def test_the_half_life_parameter_is_the_half_life() -> None:
    """After three frames at alpha = 1, half of the difference remains."""
    mixing = palette(colour_half_life=3)
    mixing.step(regions([GRAY], [0], [0]), None)
    for _ in range(3):
        made = mixing.step(regions([DARKER], [1], [1.0]), None)
    assert np.abs(srgb_to_lab(made[1] / 255) - (lab_of(GRAY) + lab_of(DARKER)) / 2).max() < 0.3


def test_a_colour_lags_behind_by_a_limit_at_most() -> None:
    """A region that has lost the pixels of another object does not keep that object's colour."""
    mixing = palette(colour_half_life=30)
    mixing.step(regions([GRAY, GRAY], [0, 0], [0, 0]), None)
    made = mixing.step(regions([DARK, DARKER], [1, 2], [1.0, 1.0]), None)
    lag = np.linalg.norm(srgb_to_lab(made[1:] / 255) - [lab_of(DARK), lab_of(DARKER)], axis=1)
    np.testing.assert_allclose(lag, [LARGEST_LAG, np.linalg.norm(lab_of(GRAY) - lab_of(DARKER))], atol=0.4)


def test_in_a_fade_colours_change_at_once() -> None:
    mixing = palette(colour_half_life=30)
    mixing.step(regions([GRAY], [0], [0]), None)
    made = mixing.step(regions([DARK], [1], [1.0]), None, light_steadiness=0.0)
    np.testing.assert_array_equal(made[1], rgb_of(lab_of(DARK)))


def test_vividness_scales_chroma_and_leaves_gray() -> None:
    made = palette(vividness=1.5).step(regions([GRAY, RED], [0, 0], [0, 0]), None)
    np.testing.assert_array_equal(made[1], rgb_of(lab_of(GRAY)))
    np.testing.assert_array_equal(made[2], rgb_of(lab_of(RED) * (1, 1.5, 1.5)))


def test_a_reference_changes_targets_with_the_tone_of_the_frame() -> None:
    frame = np.zeros((20, 20, 3), np.uint8)
    frame[:, :, 2] = 220
    blue = learn([frame])
    made = Palette(AbstractionParams(keep_brightness=1, hue_neighbourhood=180), blue).step(
        regions([(120, 150, 60)], [0], [0]), Tone(0.5, 0.2, 0.5)
    )
    assert made[1, 2] > made[1, 0] + 60 and made[1, 2] > made[1, 1] + 60


def test_a_restored_palette_continues_with_the_same_bytes() -> None:
    one, two = palette(), palette()
    one.step(regions([GRAY, RED], [0, 0], [0, 0]), None)
    two.restore({key: array.copy() for key, array in one.state().items()})
    after = regions([DARK, GRAY], [1, 2], [0.7, 0.3])
    np.testing.assert_array_equal(one.step(after, None), two.step(after, None))
    assert palette().state() == {}
