"""Detection of cuts and fades from two thumbnails."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.perception.cuts import CUTS, is_cut, light_steadiness, thumbnail
from pipeline.scenes import scene

SIZE = (96, 64)


@pytest.fixture(scope="module")
def cut_frames() -> list[NDArray[np.uint8]]:
    shots = scene("cut", SIZE, frames=8, fps=6)
    return [shots.image(index) for index in range(8)]


def called(frames: list[NDArray[np.uint8]], sensitivity: float = 1.0) -> list[int]:
    thumbs = [thumbnail(frame) for frame in frames]
    return [i for i in range(1, len(thumbs)) if is_cut(thumbs[i - 1], thumbs[i], sensitivity)]


def test_only_the_cut_of_a_scene_is_detected(cut_frames: list[NDArray[np.uint8]]) -> None:
    assert called(cut_frames) == [4]


@pytest.mark.parametrize("name", ["harbour", "portrait", "shapes"])
def test_motion_within_a_shot_is_not_a_cut(name: str) -> None:
    shot = scene(name, SIZE, frames=8, fps=4)
    assert called([shot.image(index) for index in range(8)]) == []


def test_sensitivity_zero_detects_no_cut(cut_frames: list[NDArray[np.uint8]]) -> None:
    assert called(cut_frames, 0.0) == []
    assert not is_cut(thumbnail(cut_frames[3]), thumbnail(255 - cut_frames[3]), 0.0)


def test_sensitivity_divides_the_threshold() -> None:
    rng = np.random.default_rng(1)
    before = rng.uniform(100, 130, (*CUTS.thumbnail[::-1], 3)).astype(np.float32)
    now = rng.uniform(100, 130, before.shape).astype(np.float32)
    now[..., 1] += CUTS.difference * 0.75 - float(np.abs(now - before).sum(-1).mean()) + 10
    found = [sensitivity for sensitivity in (0.25, 0.5, 1.0, 2.0, 3.0) if is_cut(before, now, sensitivity)]
    assert found and 0.25 not in found and found == sorted(found)


def test_a_flash_is_not_a_cut() -> None:
    """The light doubles and the picture stays: much difference, full correlation."""
    frame = scene("portrait", SIZE, frames=1).image(0)
    brighter = np.clip(frame.astype(int) * 2, 0, 255).astype(np.uint8)
    assert not is_cut(thumbnail(frame // 3), thumbnail(brighter // 3 + 60))


def test_a_change_between_flat_colours_is_a_cut() -> None:
    black, red = (np.full((64, 96, 3), colour, np.uint8) for colour in ((0, 0, 0), (220, 30, 30)))
    assert is_cut(thumbnail(black), thumbnail(red))
    assert not is_cut(thumbnail(red), thumbnail(red))


def test_a_thumbnail_is_the_area_mean_in_lab() -> None:
    fine = np.zeros((36, 64, 3), np.uint8)
    fine[::2] = 200
    wanted = cv2.cvtColor(np.full((1, 1, 3), 100, np.uint8), cv2.COLOR_RGB2LAB)[0, 0]
    made = thumbnail(fine)
    assert made.shape == (18, 32, 3) and made.dtype == np.float32
    np.testing.assert_allclose(made, np.broadcast_to(wanted.astype(np.float32), made.shape), atol=1)


def test_steadiness_is_one_for_constant_light_and_near_zero_in_a_fade() -> None:
    frame = scene("harbour", SIZE, frames=1).image(0)
    here = thumbnail(frame)
    assert light_steadiness(here, here) == 1.0
    found = [light_steadiness(here, thumbnail((frame * light).astype(np.uint8))) for light in (0.99, 0.97, 0.93, 0.8)]
    assert all(a > b for a, b in pairwise(found)) and found[0] > 0.3 and found[-1] < 0.01


def test_steadiness_of_a_known_change() -> None:
    """A drift of 0.8 CIELAB units, be it of L* or a*, is 1/e."""
    here = np.full((18, 32, 3), 100, np.float32)
    for drift in ((0.8 * 2.55, 0, 0), (0, 0.8, 0)):
        assert light_steadiness(here, here + np.array(drift, np.float32)) == pytest.approx(np.exp(-1), rel=1e-3)


def test_noise_and_motion_do_not_change_the_steadiness() -> None:
    shot = scene("harbour", SIZE, frames=3, fps=12)
    rng = np.random.default_rng(0)
    noisy = [np.clip(shot.image(i) + rng.normal(0, 4, (64, 96, 3)), 0, 255).astype(np.uint8) for i in range(3)]
    assert min(light_steadiness(thumbnail(a), thumbnail(b)) for a, b in pairwise(noisy)) > 0.8
