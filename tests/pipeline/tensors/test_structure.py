"""Directions of pictures with known directions."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.frames import Flow, Plane
from pipeline.tensors.structure import doubled_tangents, structure_tensor, tangent_field

ODD = (37, 53)


def edge(angle_rad: float, size: tuple[int, int] = ODD) -> Plane:
    """A soft straight edge through the middle; `angle_rad` is the angle of its normal."""
    y, x = np.indices(size) - (np.array(size) - 1).reshape(2, 1, 1) / 2
    return np.asarray(128 + 80 * np.tanh((x * math.cos(angle_rad) + y * math.sin(angle_rad)) / 2), np.float32)


def noise(seed: int, size: tuple[int, int] = ODD) -> Plane:
    return np.random.default_rng(seed).uniform(0, 255, size).astype(np.float32)


def alike(a: Flow, b: Flow) -> NDArray[np.floating]:
    """|cosine| between directions, which have no sign."""
    return np.abs((a * b).sum(-1))


@pytest.mark.parametrize("degrees", range(0, 180, 15))
def test_directions_run_along_a_straight_edge(degrees: int) -> None:
    angle = math.radians(degrees)
    field = tangent_field(structure_tensor(edge(angle), 2.0))
    middle = field[18, 26]
    assert abs(middle @ [math.cos(angle), math.sin(angle)]) < 0.005
    assert np.hypot(*middle) == pytest.approx(1, abs=1e-6)


def test_directions_of_a_disc_are_tangential() -> None:
    y, x = np.indices((61, 61)) - 30.0
    radius = np.hypot(x, y)
    disc = np.asarray(100 * np.tanh((radius - 20) / 2), np.float32)
    field = tangent_field(structure_tensor(disc, 1.5))
    ring = np.abs(radius - 20) < 2
    round_it = np.dstack([-y, x]).astype(np.float32) / np.maximum(radius, 1)[..., None].astype(np.float32)
    assert alike(field, round_it)[ring].min() > 0.99


def test_rotating_the_picture_rotates_the_directions() -> None:
    picture = noise(1)
    field = tangent_field(structure_tensor(picture, 2.0))
    rotated = tangent_field(structure_tensor(np.ascontiguousarray(np.rot90(picture)), 2.0))
    back = np.rot90(rotated, -1)
    np.testing.assert_allclose(alike(np.dstack([back[..., 1], -back[..., 0]]), field), 1, atol=1e-3)


def test_directions_have_length_one_or_zero() -> None:
    picture = noise(2)
    picture[:, 26:] = 77
    length = np.hypot(*np.moveaxis(tangent_field(structure_tensor(picture, 1.0)), -1, 0))
    assert np.all((length == 0) | (np.abs(length - 1) < 1e-6))
    assert not length[:, 40:].any()
    assert length[:, :20].all()


def test_opposite_sides_of_a_line_agree_and_do_not_cancel() -> None:
    picture = np.full(ODD, 200, np.float32)
    picture[:, 26:28] = 20
    field = tangent_field(structure_tensor(picture, 2.0))
    np.testing.assert_allclose(np.abs(field[5:32, 22:32, 1]), 1, atol=1e-4)


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (17, 16)])
def test_any_size_is_accepted(size: tuple[int, int]) -> None:
    field = tangent_field(structure_tensor(noise(3, size), 2.0))
    assert field.shape == (*size, 2)
    assert field.dtype == np.float32
    assert np.isfinite(field).all()


def test_memory_layout_does_not_change_the_result() -> None:
    picture = noise(4)
    expected = structure_tensor(picture, 2.0)
    for shift in range(1, 8):
        buffer = np.empty(picture.size + shift, np.float32)
        moved = buffer[shift:].reshape(ODD)
        moved[:] = picture
        tensors = structure_tensor(moved, 2.0)
        assert tensors.tobytes() == expected.tobytes()
        assert tangent_field(tensors).tobytes() == tangent_field(expected).tobytes()


@pytest.mark.parametrize("sigma_px", [1.0, 2.0, 4.0, 9.0])
def test_doubled_tangents_have_the_directions_of_the_tangent_field(sigma_px: float) -> None:
    picture = np.rint(edge(0.4, (90, 130)) + 20 * np.sin(np.indices((90, 130))[1] / 3)).astype(np.uint8)
    exact = tangent_field(structure_tensor(picture.astype(np.float32), sigma_px))
    doubled = doubled_tangents(picture[..., None], sigma_px)
    length = np.hypot(doubled[..., 0], doubled[..., 1])
    cosine = (exact[..., 0] ** 2 - exact[..., 1] ** 2) * doubled[..., 0] + 2 * exact.prod(-1) * doubled[..., 1]
    agrees = cosine / np.maximum(length, 1e-6)
    assert doubled.shape == exact.shape and length.max() <= 1 + 1e-5
    assert np.quantile(agrees, 0.05) > 0.95 and np.median(agrees) > 0.999
    if sigma_px == 1:
        np.testing.assert_allclose(agrees[length > 0], 1, atol=1e-3)


def test_doubled_tangents_of_a_flat_picture_are_undefined() -> None:
    assert not doubled_tangents(np.full((*ODD, 3), 90, np.uint8), 6.0).any()


@pytest.mark.parametrize("sigma_px", [1.0, 4.0])
def test_three_equal_channels_have_the_tangents_of_one(sigma_px: float) -> None:
    gray = np.rint(edge(0.4, (90, 130))).astype(np.uint8)
    one, three = (doubled_tangents(np.dstack([gray] * count).reshape(90, 130, count), sigma_px) for count in (1, 3))
    np.testing.assert_allclose(three, one, atol=1e-4)


@pytest.mark.parametrize("sigma_px", [1.0, 4.0])
def test_tangents_follow_an_edge_between_colours_of_equal_lightness(sigma_px: float) -> None:
    """Red and brown, both 88 gray levels: the direction along a vertical edge is (cos 2a, sin 2a) = (-1, 0)."""
    picture = np.full((40, 60, 3), (204, 36, 54), np.uint8)
    picture[:, 30:] = (120, 82, 36)
    assert len(np.unique(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))) == 1
    np.testing.assert_allclose(doubled_tangents(picture, sigma_px)[20, 30], (-1, 0), atol=1e-3)
