"""The map of places in which no face has been searched."""

import numpy as np

from pipeline.segmentation.new_places import NewPlaces

SIZE = (640, 360)


def panned(places: NewPlaces, frames: int, shift: tuple[float, float]) -> None:
    for _ in range(frames):
        flow = np.zeros((90, 160, 2), np.float32)
        flow[:] = shift
        places.move(flow)


def test_nothing_is_new_while_nothing_moves() -> None:
    places = NewPlaces(SIZE, 24)
    panned(places, 50, (0, 0))
    assert places.next_rectangle() is None


def test_the_strip_that_a_pan_brings_into_view_is_searched_once() -> None:
    places = NewPlaces(SIZE, 24)
    panned(places, 7, (-12, 0))
    rows = np.zeros(SIZE[1], bool)
    for _ in range(8):
        where = places.next_rectangle()
        if where is None:
            break
        assert where.left > SIZE[0] - 200 and where.right == SIZE[0]
        rows[where.top : where.bottom] = True
        places.searched(where)
    assert places.next_rectangle() is None
    assert rows.mean() > 0.8


def test_a_restored_map_is_the_same_and_another_size_is_resampled() -> None:
    places, same, other = NewPlaces(SIZE, 24), NewPlaces(SIZE, 24), NewPlaces((160, 90), 24)
    panned(places, 4, (-10, 3))
    same.restore(places.plane)
    other.restore(places.plane)
    np.testing.assert_array_equal(same.plane, places.plane)
    assert abs(float(other.plane.mean() - places.plane.mean())) < 0.02
