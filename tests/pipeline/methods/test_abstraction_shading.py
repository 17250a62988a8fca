"""Codec blocks in a gradient are smoothed; edges, texture and lines are kept."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.colour.lab8 import LabPlanes
from pipeline.methods.abstraction import AbstractionParams, AbstractionSession
from pipeline.methods.abstraction.shading import SHADING, smooth_shading

HEIGHT, WIDTH = 96, 160


def planes(light: NDArray[np.floating]) -> LabPlanes:
    """A gray picture of that lightness, 8-bit levels."""
    out = np.full((3, *light.shape), 128, np.uint8)
    out[0] = np.rint(light)
    return out


def blocky_gradient(height: int = HEIGHT, width: int = WIDTH) -> NDArray[np.floating]:
    """Lightness that rises by 0.2 levels a row, in blocks of 16 px with an error of up to 1.5 levels each."""
    errors = np.random.default_rng(5).uniform(-1.5, 1.5, (height // 16, width // 16))
    rows = 100 + 0.2 * (np.arange(height) // 16 * 16 + 8)
    return rows[:, None] + np.kron(errors, np.ones((16, 16)))


def test_blocks_become_a_gradient() -> None:
    lab = planes(blocky_gradient())
    before = lab.copy()
    smooth_shading(lab)
    steps = [np.abs(np.diff(p[0].astype(int), axis=0))[:, 24:-24].max() for p in (before, lab)]
    assert steps[0] >= 4 and steps[1] <= 1
    truth = 100 + 0.2 * np.arange(HEIGHT)
    errors = [np.abs(p[0] - truth[:, None])[24:-24, 24:-24].mean() for p in (before, lab)]
    assert errors[1] < 0.6 * errors[0]


@pytest.mark.parametrize("size", [(1, 1), (5, 3), (8, 8), (41, 67), (96, 160)])
def test_a_plain_picture_of_any_size_is_unchanged(size: tuple[int, int]) -> None:
    lab = planes(np.full(size, 90.0))
    smooth_shading(lab)
    np.testing.assert_array_equal(lab, planes(np.full(size, 90.0)))


def test_an_edge_and_what_lies_beside_it_are_kept() -> None:
    light = blocky_gradient()
    light[:, 80:] += 40
    lab = planes(light)
    before = lab.copy()
    smooth_shading(lab)
    np.testing.assert_array_equal(lab[:, :, 76:84], before[:, :, 76:84])
    assert (lab != before).any()


def test_texture_is_kept() -> None:
    lab = planes(100 + np.random.default_rng(2).integers(0, 16, (HEIGHT, WIDTH)).astype(float))
    before = lab.copy()
    smooth_shading(lab)
    np.testing.assert_array_equal(lab, before)


def test_no_pixel_changes_by_more_than_the_limit() -> None:
    lab = planes(np.kron(np.random.default_rng(3).integers(100, 107, (12, 20)), np.ones((8, 8))))
    before = lab.astype(int)
    smooth_shading(lab)
    assert 0 < np.abs(lab - before).max() <= SHADING.largest_change


def test_a_border_through_a_compressed_sky_is_calm() -> None:
    """A border across the picture is hardly longer than the picture; without smoothing it follows the blocks."""
    light = blocky_gradient(192, 320) + np.linspace(0, 60, 192)[:, None] // 4
    frame = np.repeat(np.rint(light).astype(np.uint8)[..., None], 3, axis=2)
    session = AbstractionSession(AbstractionParams(lines="off", boundary_smoothing=0), (320, 192))
    labels = session.finish(session.analyze(frame)).labels
    borders = len(np.unique(labels)) - 1
    length = (labels[1:] != labels[:-1]).sum() + (labels[:, 1:] != labels[:, :-1]).sum()
    assert borders >= 1
    assert length < 1.25 * 320 * borders
