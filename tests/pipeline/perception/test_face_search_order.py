"""The maps of places that are searched for faces first."""

import numpy as np

from pipeline.perception.face_search_order import NewPlaces

SIZE = (640, 360)


def panned(places: NewPlaces, frames: int, shift: tuple[float, float]) -> None:
    for _ in range(frames):
        flow = np.zeros((90, 160, 2), np.float32)
        flow[:] = shift
        places.move(flow)


def test_nothing_is_new_while_nothing_moves() -> None:
    places = NewPlaces(SIZE, 24)
    panned(places, 50, (0, 0))
    assert places.next_rectangle(1) is None


def test_the_strip_that_a_pan_brings_into_view_is_searched_once() -> None:
    places = NewPlaces(SIZE, 24)
    panned(places, 7, (-12, 0))
    rows = np.zeros(SIZE[1], bool)
    for _ in range(8):
        where = places.next_rectangle(1)
        if where is None:
            break
        assert where.left > SIZE[0] - 200 and where.right == SIZE[0]
        rows[where.top : where.bottom] = True
        places.searched(where)
    assert places.next_rectangle(1) is None
    assert rows.mean() > 0.8


def test_a_restored_map_is_the_same_and_another_size_is_resampled() -> None:
    places, same, other = NewPlaces(SIZE, 24), NewPlaces(SIZE, 24), NewPlaces((160, 90), 24)
    panned(places, 4, (-10, 3))
    same.restore(places.unsearched, places.moving)
    other.restore(places.unsearched, None)
    np.testing.assert_array_equal(same.unsearched, places.unsearched)
    np.testing.assert_array_equal(same.moving, places.moving)
    assert abs(float(other.unsearched.mean() - places.unsearched.mean())) < 0.02


def test_what_moves_in_front_of_a_moving_camera_is_searched_soon_and_then_rests() -> None:
    places = NewPlaces(SIZE, 24)
    flow = np.full((SIZE[1] // 4, SIZE[0] // 4, 2), (2.0, 0.0), np.float32)
    flow[20:50, 40:55] = -1.0, 0.5  # somebody who walks
    found = []
    for age in range(24):
        places.move(flow)
        places.unsearched[:] = 0  # what comes into view is another matter
        if (where := places.next_rectangle(age)) is not None:
            found.append((age, where))
            places.searched(where)
    ages = [age for age, _ in found]
    assert ages[0] <= 8
    assert all(age % 4 == 0 for age in ages)
    assert len(ages) <= 4, "each place rests after its search"
    assert all(where.left < 220 and where.right > 160 for _, where in found), "the walker, not the rest of the pan"


def test_nothing_is_searched_where_the_whole_frame_moves_alike() -> None:
    places = NewPlaces(SIZE, 24)
    for _ in range(24):
        places.move(np.full((SIZE[1] // 4, SIZE[0] // 4, 2), (0.0, 3.0), np.float32))
    assert not places.moving.any()
