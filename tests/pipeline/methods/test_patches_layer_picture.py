"""Pictures of layers: computed in areas around the pixels in which strokes start."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.methods.patches.layer_picture import LayerPicture, areas_around
from pipeline.methods.patches.painter import HertzmannPainter
from pipeline.methods.patches.params import PatchesParams
from pipeline.scenes import scene
from pipeline.strokes.brush import Brush

SIZE = (160, 120)


def spots(*places: tuple[int, int]) -> np.ndarray:  # type: ignore[type-arg]
    where = np.zeros(SIZE[::-1], np.bool_)
    for row, column in places:
        where[row : row + 3, column : column + 3] = True
    return where


@pytest.mark.parametrize("pad", [0, 5, 17])
def test_areas_are_disjoint_and_contain_everything_near_the_mask(pad: int) -> None:
    where = spots((10, 12), (14, 30), (100, 150), (0, 100))
    covered = np.zeros(where.shape, np.int32)
    for area in areas_around(where, pad):
        covered[area] += 1
    near = cv2.dilate(where.astype(np.uint8), np.ones((2 * pad + 1, 2 * pad + 1), np.uint8)) > 0
    assert covered.max() == 1 and (covered[near] == 1).all() and (covered == 0).mean() > 0.2


def test_without_starts_there_is_no_area_and_with_many_it_is_the_whole_picture() -> None:
    whole = [(slice(0, SIZE[1]), slice(0, SIZE[0]))]
    assert areas_around(spots(), 5) == [] and areas_around(~spots(), 5) == whole
    assert areas_around(spots((30, 40), (80, 110)), 40) == whole


def test_an_area_has_the_references_directions_and_slopes_of_the_whole_picture() -> None:
    picture, brush = scene("harbour", SIZE, frames=1).image(0), Brush(4.0, 20.0)
    painter = HertzmannPainter.of("hertzmann", 1e9, SIZE[1], PatchesParams(), 0)
    whole = LayerPicture.of(painter.reference(picture, brush), brush)
    area, inner = (slice(20, 90), slice(30, 120)), (slice(40, 70), slice(50, 100))
    part = LayerPicture.within(
        [area], picture, brush, lambda box: painter.reference(np.ascontiguousarray(picture[box]), brush)
    )
    np.testing.assert_array_equal(part.reference[inner], whole.reference[inner])
    np.testing.assert_allclose(part.field[inner], whole.field[inner], atol=1e-3)
    np.testing.assert_array_equal(part.slopes[inner], whole.slopes[inner])
    assert not part.field[:15].any() and (part.reference[:15] == picture[:15]).all()
