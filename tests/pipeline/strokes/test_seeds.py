"""Stroke seeds: coverage, density, and ids."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.errors import BadParameter
from pipeline.strokes.seeds import Seeds, place, sample

ODD = (61, 83)


def gap(seeds: Seeds, shape: tuple[int, int]) -> float:
    """The largest distance of a pixel from its nearest seed."""
    free = np.ones(shape, np.uint8)
    x, y = np.rint(seeds.xy).astype(int).T
    free[y, x] = 0
    return float(cv2.distanceTransform(free, cv2.DIST_L2, 5).max())


@pytest.mark.parametrize("spacing", [1.0, 2.7, 4.0, 5.9, 8.0, 13.0])
def test_seeds_cover_without_gaps(spacing: float) -> None:
    assert gap(place(ODD, spacing, jitter=0), ODD) <= 1.5 * spacing + 1
    assert gap(place(ODD, spacing, seed=4), ODD) <= 2.2 * spacing + 1


@pytest.mark.parametrize("spacing", [2.0, 3.1, 5.0, 8.0])
def test_density_is_one_seed_per_squared_spacing(spacing: float) -> None:
    shape = (201, 307)
    assert len(place(shape, spacing)) == pytest.approx(201 * 307 / spacing**2, rel=0.06)


@pytest.mark.parametrize("cell", [2.0, 3.0])
def test_seeds_of_a_part_are_those_of_the_whole_picture(cell: float) -> None:
    spacing = np.full(ODD, cell, np.float32)
    spacing[20:40, 30:60] *= 1.7
    whole, part = place(ODD, spacing, seed=3), place(ODD, spacing[15:45, 22:70].copy(), seed=3, corner=(15, 22))
    inner = (np.abs(whole.xy - np.array([46, 30])) < np.array([17, 8])).all(axis=1)
    assert inner.sum() > 1 and set(part.ids) < set(whole.ids)
    places = dict(zip(part.ids.tolist(), part.xy.tolist(), strict=True))
    assert {key: places[key] for key in whole.ids[inner].tolist()} == dict(
        zip(whole.ids[inner].tolist(), whole.xy[inner].tolist(), strict=True)
    )


def test_density_follows_a_field() -> None:
    spacing = np.full((200, 200), 4, np.float32)
    spacing[:, 100:] = 12
    x = place((200, 200), spacing).xy[:, 0]
    assert (x < 100).sum() / (x >= 100).sum() == pytest.approx(9, rel=0.15)


def test_a_slightly_larger_size_drops_seeds_and_moves_none_far() -> None:
    before, after = place(ODD, 5.0), place(ODD, 5.3)
    assert set(after.ids) < set(before.ids)
    old = dict(zip(before.ids.tolist(), before.xy, strict=True))
    moves = [np.abs(old[name] - xy).max() for name, xy in zip(after.ids.tolist(), after.xy, strict=True)]
    assert max(moves) <= 0.16


def test_seeds_stay_inside_and_ids_are_unique() -> None:
    seeds = [place(ODD, 3.3, seed=9, layer=layer, birth=birth) for layer in (0, 1) for birth in (0, 7)]
    xy, ids = np.concatenate([s.xy for s in seeds]), np.concatenate([s.ids for s in seeds])
    assert xy.min() >= 0 and (xy <= [ODD[1] - 1, ODD[0] - 1]).all()
    assert len(np.unique(ids)) == len(ids)
    np.testing.assert_array_equal(seeds[0].xy, seeds[1].xy)
    assert not np.array_equal(seeds[0].xy[:50], seeds[2].xy[:50])


def test_equal_seeds_give_equal_bytes_and_other_seeds_others() -> None:
    assert place(ODD, 4.0, seed=1).xy.tobytes() == place(ODD, 4.0, seed=1).xy.tobytes()
    assert place(ODD, 4.0, seed=1).xy.tobytes() != place(ODD, 4.0, seed=2).xy.tobytes()


def test_fields_are_read_at_the_nearest_pixel() -> None:
    plane = np.arange(12, dtype=np.float32).reshape(3, 4)
    points = np.array([[0.4, 0], [0.6, 0], [3, 2], [-5, 9]], np.float32)
    np.testing.assert_array_equal(sample(plane, points), [0, 1, 11, 8])
    np.testing.assert_array_equal(sample(2.5, points), [2.5] * 4)


def test_a_field_may_be_on_a_coarser_grid_over_the_picture() -> None:
    coarse = np.arange(6, dtype=np.float32).reshape(2, 3)
    fine = np.ascontiguousarray(coarse.repeat(8, axis=0).repeat(8, axis=1))
    points = np.random.default_rng(4).uniform(0, (23, 15), (50, 2)).astype(np.float32)
    column, row = np.clip((points.T + 0.5) / 8 - 0.5, 0, [[2], [1]])
    np.testing.assert_allclose(sample(coarse, points, fine.shape), column + 3 * row, atol=1e-5)
    one, other = place(fine.shape, coarse + 3), place(fine.shape, fine + 3)
    np.testing.assert_array_equal(one.xy, other.xy)
    np.testing.assert_array_equal(one.ids, other.ids)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.array([[3.0, np.inf]])])
def test_an_invalid_spacing_is_named(bad: float) -> None:
    with pytest.raises(BadParameter):
        place(ODD, bad)
