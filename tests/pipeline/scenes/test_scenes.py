"""Scenes: render passes agree exactly with the frames and with each other."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

from pipeline.errors import BadParameter
from pipeline.perception.flow.reliability import chi_minus, chi_plus
from pipeline.perception.flow.warp import warp_back
from pipeline.scenes import Scene, SceneFrame, scene, scenes

SIZE = (128, 72)
NAMES = tuple(scenes())


@cache
def small(name: str, frames: int = 8, fps: float = 12.0, seed: int = 0) -> Scene:
    return scene(name, SIZE, frames, fps, seed)


@cache
def frame(name: str, index: int) -> SceneFrame:
    return small(name).frame(index)


def away_from_edges(ids: np.ndarray, px: int = 2) -> np.ndarray:
    """True where no other object is near: there a pixel shows one object only."""
    kernel = np.ones((2 * px + 1, 2 * px + 1), np.uint8)
    values = ids.astype(np.float32)
    return cv2.dilate(values, kernel) == cv2.erode(values, kernel)


@pytest.mark.parametrize("name", NAMES)
def test_every_pass_has_its_shape_type_and_range(name: str) -> None:
    made = frame(name, 1)
    height, width = SIZE[1], SIZE[0]
    assert (made.image.shape, made.image.dtype) == ((height, width, 3), np.uint8)
    assert made.ids.dtype == np.int32 and set(np.unique(made.ids)) <= set(small(name).things)
    for flow in (made.velocity_next, made.velocity_previous):
        assert (flow.shape, flow.dtype) == ((height, width, 2), np.float32) and np.isfinite(flow).all()
    assert made.normals.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(made.normals, axis=-1), 1, atol=1e-5)
    assert made.orientation.dtype == np.float32
    assert made.orientation.min() >= 0 and made.orientation.max() < np.float32(np.pi)
    assert made.lines.dtype == np.float32 and made.lines.min() >= 0 and made.lines.max() <= 1
    assert made.occluded_next.dtype == made.occluded_previous.dtype == np.bool_


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("step", [1, -1], ids=["next", "previous"])
def test_fetching_along_the_velocity_gives_the_frame_again(name: str, step: int) -> None:
    made = small(name, 6, fps=4.0)
    here, there = made.frame(1), made.image(1 + step)
    flow = here.velocity_next if step > 0 else -here.velocity_previous
    hidden = here.occluded_next if step > 0 else here.occluded_previous
    inner = ~hidden & away_from_edges(here.ids)
    error = np.abs(warp_back(there, flow).astype(int) - here.image).mean(-1)
    still = np.abs(there.astype(int) - here.image).mean(-1)
    assert inner.mean() > 0.4
    assert error[inner].mean() < 1.5
    assert error[inner].mean() < 0.6 * still[inner].mean()


@pytest.mark.parametrize("name", NAMES)
def test_a_visible_point_is_on_the_same_object_in_the_next_frame(name: str) -> None:
    here, after = frame(name, 1), frame(name, 2)
    y, x = np.nonzero(~here.occluded_next & away_from_edges(here.ids, 1))
    to = np.rint(np.stack([x, y], 1) + here.velocity_next[y, x]).astype(int)
    same = after.ids[to[:, 1], to[:, 0]] == here.ids[y, x]
    assert same.mean() > 0.985


@pytest.mark.parametrize("name", NAMES)
def test_the_two_velocities_are_inverse(name: str) -> None:
    here, after = frame(name, 1), frame(name, 2)
    there = warp_back(away_from_edges(after.ids, 2).astype(np.float32), here.velocity_next) > 0.99
    inner = ~here.occluded_next & away_from_edges(here.ids, 2) & there
    back = warp_back(after.velocity_previous, here.velocity_next)
    assert np.abs(back - here.velocity_next)[inner].max() < 0.35
    assert np.abs(back - here.velocity_next)[inner].mean() < 0.02


def test_the_papers_occlusion_agrees_with_the_exact_one() -> None:
    made = scene("shapes", (384, 216), 10, 12.0)
    here, after, before = made.frame(5), made.frame(6), made.frame(4)
    plain = away_from_edges(here.ids, 2)
    assert (chi_plus(here.velocity_next, after.velocity_previous) == ~here.occluded_next)[plain].mean() > 0.98
    assert (chi_minus(here.velocity_previous, before.velocity_next) == ~here.occluded_previous)[plain].mean() > 0.98


@pytest.mark.parametrize("name", NAMES)
def test_a_seed_gives_the_same_bytes_in_any_order(name: str) -> None:
    first, again = (scene(name, (64, 36), 4, seed=7) for _ in range(2))
    again.image(3)
    once, twice = first.frame(2), again.frame(2)
    for field in once.__dataclass_fields__:
        assert getattr(once, field).tobytes() == getattr(twice, field).tobytes(), field
    np.testing.assert_array_equal(once.image, first.image(2))
    assert not np.array_equal(once.image, scene(name, (64, 36), 4, seed=8).image(2))


def test_an_object_is_hidden_for_some_frames_and_comes_back() -> None:
    made = scene("shapes", (96, 54), 24, 12.0)
    number = {thing: k for k, thing in made.things.items()}["disc"]
    areas = [int((made.frame(k).ids == number).sum()) for k in range(24)]
    gone = [k for k, area in enumerate(areas) if area == 0]
    assert gone and min(gone) > 0 and max(gone) < 23
    assert areas[min(gone) - 2] > 20 and areas[max(gone) + 3] > 20


def test_shapes_rotate_and_grow() -> None:
    made = scene("shapes", (192, 108), 4, 12.0)
    number = {thing: k for k, thing in made.things.items()}
    here = made.frame(0)
    y, x = np.nonzero(here.ids == number["square"])
    flow = here.velocity_next[y, x]
    assert np.polyfit(x, flow[:, 0], 1)[0] == pytest.approx(0.22 / 12, rel=0.2)  # grows by 22 % a second
    y, x = np.nonzero(here.ids == number["star"])
    flow = here.velocity_next[y, x]
    assert np.polyfit(y, flow[:, 0], 1)[0] == pytest.approx(-np.sin(1.6 / 12), rel=0.1)  # turns at 1.6 rad a second


def test_all_points_are_occluded_across_a_cut() -> None:
    last, first = frame("cut", 3), frame("cut", 4)
    assert last.occluded_next.all() and first.occluded_previous.all()
    assert not set(np.unique(last.ids)) & set(np.unique(first.ids))
    assert np.abs(last.image.astype(int) - first.image).mean() > 20
    assert not frame("cut", 2).occluded_next.all()


def test_lines_lie_on_object_borders() -> None:
    made = scene("shapes", (384, 216), 2, 12.0).frame(0)
    edges = ~away_from_edges(made.ids, 1)
    assert made.lines[edges].mean() > 0.4
    assert made.lines[~edges].mean() < 0.05


def test_normals_of_a_disc_point_outwards() -> None:
    made = scene("shapes", (384, 216), 2, 12.0)
    number = {thing: k for k, thing in made.things.items()}["disc"]
    here = made.frame(0)
    y, x = np.nonzero(here.ids == number)
    out = np.stack([x - x.mean(), y - y.mean()], 1)
    far = np.hypot(*out.T) > 12
    agree = (out * here.normals[y, x, :2]).sum(1) / np.maximum(np.linalg.norm(here.normals[y, x, :2], axis=1), 1e-6)
    np.testing.assert_allclose((agree / np.hypot(*out.T))[far], 1, atol=0.08)
    assert here.normals[y, x, 2][np.hypot(*out.T) < 2].min() > 0.9


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("size", [(16, 16), (33, 97), (131, 47)], ids=str)
def test_any_size_is_accepted(name: str, size: tuple[int, int]) -> None:
    made = scene(name, size, 2).frame(1)
    assert made.image.shape == (size[1], size[0], 3)


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        ({"name": "moon"}, "name"),
        ({"name": "shapes", "size": (15, 64)}, "size"),
        ({"name": "shapes", "frames": 0}, "frames"),
        ({"name": "shapes", "fps": 0.0}, "fps"),
        ({"name": "shapes", "fps": float("nan")}, "fps"),
        ({"name": "shapes", "seed": -1}, "seed"),
    ],
)
def test_invalid_arguments_are_named(arguments: dict[str, object], field: str) -> None:
    with pytest.raises(BadParameter) as caught:
        scene(**arguments)  # type: ignore[arg-type]
    assert caught.value.field == field and caught.value.remedy


def test_the_portrait_is_found_by_the_face_detector() -> None:
    cv2.ocl.setUseOpenCL(False)  # a cascade otherwise opens the OpenCL loader, which hides runtimes registered later
    detector = cv2.CascadeClassifier(cv2.data.haarcascades + "haarcascade_frontalface_default.xml")
    made = scene("portrait", (480, 360), 48, 12.0)
    found = [
        len(detector.detectMultiScale(cv2.cvtColor(made.image(k), cv2.COLOR_RGB2GRAY), 1.1, 4)) for k in (0, 6, 24)
    ]
    assert sum(n >= 1 for n in found) >= 2
