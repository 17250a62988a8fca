"""Orientation fields: design elements, edge fields, smoothing over time, Laplace fill, motion with objects."""

from __future__ import annotations

import itertools
import math
from typing import get_args

import cv2
import numpy as np
import pytest

from pipeline.errors import BadParameter
from pipeline.frames import Mask, Plane
from pipeline.tensors.edges import edge_field, gradient_tensor, smooth_over_time
from pipeline.tensors.elements import WINDINGS, Element, Pattern, basis_field, design_field, follow
from pipeline.tensors.ellipses import Ellipse, fit_ellipse
from pipeline.tensors.field import (
    OrientationField,
    angle_of,
    field_of,
    fill_free,
    rotated,
    strength_of,
)
from pipeline.tensors.structure import Tensors

ODD = (37, 53)


def apart(a: Plane, b: Plane | float) -> Plane:
    """The angle between directions, rad, 0..pi/2."""
    off = np.abs(a - b) % math.pi
    return np.asarray(np.minimum(off, math.pi - off), np.float32)


def noise(seed: int, size: tuple[int, int] = ODD) -> Plane:
    return np.random.default_rng(seed).uniform(0, 255, size).astype(np.float32)


def ellipse_mask(ellipse: Ellipse, size: tuple[int, int] = (120, 160)) -> Mask:
    y, x = np.indices(size)
    c, s = math.cos(ellipse.angle_rad), math.sin(ellipse.angle_rad)
    along, across = (x - ellipse.x) * c + (y - ellipse.y) * s, (y - ellipse.y) * c - (x - ellipse.x) * s
    return np.asarray((along / ellipse.major_px) ** 2 + (across / ellipse.minor_px) ** 2 <= 1)


# Tensors


def test_angles_are_recovered_modulo_half_a_turn() -> None:
    angles = np.linspace(0, math.pi, 181)[:-1].reshape(10, 18)
    np.testing.assert_allclose(angle_of(field_of(angles)), angles, atol=1e-6)
    np.testing.assert_allclose(field_of(angles + math.pi), field_of(angles), atol=1e-6)
    np.testing.assert_allclose(strength_of(field_of(angles, 3)), 3, atol=1e-6)


def test_angles_are_in_0_to_pi() -> None:
    field = np.array([[[1, 1, -1, 0, 1]], [[0, -1e-12, 0, 0, -1e-7]]], np.float32)
    assert (angle_of(field) >= 0).all()
    assert (angle_of(field) < np.float32(math.pi)).all()


def test_opposite_senses_agree_and_perpendicular_ones_cancel() -> None:
    same = field_of(0.3) + field_of(0.3 + math.pi)
    assert float(np.hypot(*same)) == pytest.approx(2, abs=1e-6)
    assert float(np.hypot(*(field_of(0.3) + field_of(0.3 + math.pi / 2)))) == pytest.approx(0, abs=1e-6)


# Pictures


@pytest.mark.parametrize("degrees", range(0, 180, 15))
def test_strokes_run_along_a_straight_edge(degrees: int) -> None:
    angle = math.radians(degrees)
    y, x = np.indices(ODD) - (np.array(ODD) - 1).reshape(2, 1, 1) / 2
    picture = np.asarray(128 + 80 * np.tanh((y * math.cos(angle) - x * math.sin(angle)) / 2), np.float32)
    field = edge_field(gradient_tensor(picture, 2.0))
    assert apart(angle_of(field)[17:20, 25:28], angle).max() < math.radians(1)
    assert strength_of(field)[18, 26] > 0.9


def test_rotating_the_picture_rotates_the_field() -> None:
    picture = noise(1)
    field = edge_field(gradient_tensor(picture, 2.0))
    quarter = edge_field(gradient_tensor(np.ascontiguousarray(np.rot90(picture)), 2.0))
    expected = rotated(np.rot90(field, axes=(1, 2)), -math.pi / 2)
    np.testing.assert_allclose(quarter, expected, atol=1e-3)


def test_a_flat_picture_has_no_direction() -> None:
    assert not edge_field(gradient_tensor(np.full(ODD, 99, np.float32), 2.0)).any()


def test_strokes_run_along_an_edge_between_colours_of_equal_lightness() -> None:
    picture = np.full((*ODD, 3), (204, 36, 54), np.float32)
    picture[:, 26:] = (120, 82, 36)
    field = edge_field(gradient_tensor(picture, 2.0))
    assert apart(angle_of(field)[18, 26], math.pi / 2) < math.radians(1) and strength_of(field)[18, 26] > 0.9


def flicker(fields: list[OrientationField]) -> float:
    """Mean change of direction from frame to frame, rad."""
    return float(np.mean([apart(angle_of(a), angle_of(b)).mean() for a, b in itertools.pairwise(fields)]))


def test_memory_removes_flicker_but_not_the_edges() -> None:
    clean = 60 * np.sin(np.indices(ODD)[1] / 6).astype(np.float32)
    single: list[OrientationField] = []
    smoothed: list[OrientationField] = []
    state: Tensors | None = None
    for frame in range(30):
        now = gradient_tensor(clean + 0.1 * noise(frame), 1.5)
        state = now if state is None else smooth_over_time(now, state, None, 0.85)
        single.append(edge_field(now))
        smoothed.append(edge_field(state))
    assert flicker(smoothed[15:]) < 0.3 * flicker(single[15:])
    strong = strength_of(smoothed[-1]) > 0.7
    assert strong.mean() > 0.3
    assert apart(angle_of(smoothed[-1]), math.pi / 2)[strong].max() < 0.2


def test_smoothing_follows_the_motion() -> None:
    """On a panning picture, smoothed tensors move with the picture."""
    wide = np.asarray(gradient_tensor(noise(5, (37, 90)), 3.0))
    flow = np.zeros((*ODD, 2), np.float32)
    flow[..., 0] = 2
    state = wide[:, :, 20:73]
    for step in range(1, 6):
        now = np.ascontiguousarray(wide[:, :, 20 - 2 * step : 73 - 2 * step])
        back = np.full_like(flow, 0) - flow
        state = smooth_over_time(now, state, back, 0.9)
        inside = slice(2 * step + 2, None)
        np.testing.assert_allclose(state[:, :, inside], now[:, :, inside], rtol=1e-3, atol=1e-2)


def test_a_border_that_leaves_does_not_direct_the_surface_that_it_uncovers() -> None:
    """A black bar over faint horizontal ripples leaves at once: three frames later, strokes follow the ripples."""
    ripples = 128 + 4 * np.sin(np.indices(ODD)[0] / 2).astype(np.float32)
    covered = ripples.copy()
    covered[:, 20:26] = 0
    state = gradient_tensor(covered, 2.0)
    assert apart(angle_of(edge_field(state))[18, 19], math.pi / 2) < math.radians(5)
    for _ in range(3):
        state = smooth_over_time(gradient_tensor(ripples, 2.0), state, None, 0.85)
    assert apart(angle_of(edge_field(state))[18, 10:36], 0).max() < math.radians(10)


# Design


def index_around(field: OrientationField, x: float, y: float, radius_px: float) -> float:
    """Index of the field around (x, y): turns of the stroke direction on one way round, a multiple of 1/2.

    0 if no singularity is inside the circle; wedge 1/2, trisector -1/2, node and center 1, saddle -1. The circle must
    lie in the picture, and the field must not be 0 on it.
    """
    way = np.arange(720) * (2 * math.pi / 720)
    px, py = (x + radius_px * np.cos(way)).astype(np.float32), (y + radius_px * np.sin(way)).astype(np.float32)
    u, v = (cv2.remap(plane, px, py, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).ravel() for plane in field)
    along = u + 1j * v
    steps = np.angle(np.roll(along, -1) * along.conj())
    return round(float(steps.sum()) / (2 * math.pi)) / 2


@pytest.mark.parametrize("pattern", get_args(Pattern))
@pytest.mark.parametrize("angle_rad", [0.0, 1.1])
def test_singularities_have_their_index(pattern: Pattern, angle_rad: float) -> None:
    expected = {"regular": 0, "wedge": 0.5, "trisector": -0.5, "node": 1, "center": 1, "spiral": 1, "saddle": -1}[
        pattern
    ]
    field = basis_field(Element(pattern, 26.3, 18.4, angle_rad, 0.05, 0.7), ODD)
    for radius in (3, 9, 15):
        assert index_around(field, 26.3, 18.4, radius) == expected
    assert index_around(field, 8, 8, 4) == 0
    if WINDINGS[pattern]:
        assert strength_of(basis_field(Element(pattern, 26, 18), ODD))[18, 26] == 0


def test_patterns_have_their_shapes() -> None:
    y, x = np.indices(ODD)
    round_it = np.arctan2(y - 18, x - 26).astype(np.float32)
    away = np.hypot(y - 18, x - 26) > 1
    rays, circles = (angle_of(basis_field(Element(kind, 26, 18), ODD)) for kind in ("node", "center"))
    assert apart(rays, round_it)[away].max() < 1e-5
    assert apart(circles, round_it + np.float32(math.pi / 2))[away].max() < 1e-5
    assert apart(angle_of(basis_field(Element("regular", 3, 3, 0.4), ODD)), 0.4).max() < 1e-6


@pytest.mark.parametrize("pattern", ["regular", "wedge", "trisector", "saddle"])
def test_a_rotated_element_is_the_rotated_picture_of_it(pattern: Pattern) -> None:
    """Rotation equivariance: by a quarter turn of the grid, and by any angle at corresponding places."""
    size = (41, 41)
    plain = basis_field(Element(pattern, 20, 20, 0.2, 0.04), size)
    quarter = basis_field(Element(pattern, 20, 20, 0.2 - math.pi / 2, 0.04), size)
    np.testing.assert_allclose(quarter, rotated(np.rot90(plain, axes=(1, 2)), -math.pi / 2), atol=1e-5)
    turn = math.atan2(3, 4)  # takes (5, 0) to (4, 3) and (0, 5) to (-3, 4)
    other = basis_field(Element(pattern, 20, 20, 0.2 + turn, 0.04), size)
    np.testing.assert_allclose(other[:, 23, 24], rotated(plain[:, 20, 25], turn), atol=1e-5)
    np.testing.assert_allclose(other[:, 24, 17], rotated(plain[:, 25, 20], turn), atol=1e-5)


@pytest.mark.parametrize(("pattern", "tilt"), [("node", 0), ("center", 90), ("spiral", 45)])
def test_the_angle_of_a_symmetric_element_tilts_its_strokes(pattern: Pattern, tilt: float) -> None:
    y, x = np.indices(ODD)
    rays = np.arctan2(y - 18, x - 26).astype(np.float32)
    away = np.hypot(y - 18, x - 26) > 1
    for degrees in (0, 20, 90):
        found = angle_of(basis_field(Element(pattern, 26, 18, math.radians(degrees)), ODD))
        assert apart(found, rays + np.float32(math.radians(tilt + degrees)))[away].max() < 1e-5
    key, now = Ellipse(26, 18, 0.0, 10, 5), Ellipse(26, 18, 1.0, 10, 5)
    assert follow(Element(pattern, 26, 18, 0.3), key, now).angle_rad == 0.3, "it looks the same from all sides"


def test_strength_and_decay() -> None:
    field = strength_of(basis_field(Element("regular", 10, 10, 0.3, 0.1, 2.0), ODD))
    assert field[10, 10] == pytest.approx(2)
    assert field[10, 20] == pytest.approx(2 / math.e, rel=1e-5)


def test_edges_and_elements_are_weighted() -> None:
    edges = field_of(np.full(ODD, 1.0))
    element = Element("regular", 0, 0, 0.2)
    np.testing.assert_array_equal(design_field(edges, [element], 1), edges)
    np.testing.assert_allclose(angle_of(design_field(edges, [element], 0)), 0.2, atol=1e-6)
    np.testing.assert_allclose(angle_of(design_field(edges, [element], 0.5)), 0.6, atol=1e-6)


def test_free_regions_are_filled_across_the_branch_cut() -> None:
    """The interpolation from 170 to 10 degrees passes 0 and not 90."""
    key = np.zeros(ODD, bool)
    key[:, :5] = key[:, -5:] = True
    angles = np.where(np.arange(53) < 26, math.radians(170), math.radians(10)) * np.ones((37, 1))
    filled = fill_free(field_of(angles), key)
    assert filled.residual <= 1e-6
    assert apart(angle_of(filled.x), 0.0).max() <= math.radians(10) + 1e-5
    assert apart(angle_of(filled.x)[:, 26], 0.0).max() < math.radians(0.5)


def test_a_border_keeps_directions_apart() -> None:
    key = np.zeros(ODD, bool)
    key[:, 0] = key[:, -1] = True
    right = np.ones((37, 52), np.float32)
    right[:, 25] = 0
    angles = np.where(np.arange(53) < 26, 0.3, 1.4) * np.ones((37, 1))
    filled = fill_free(field_of(angles), key, right=right)
    assert apart(angle_of(filled.x), angles.astype(np.float32)).max() < 1e-4


# Objects


def test_the_ellipse_of_a_rotating_object() -> None:
    """More than a full turn: the angle increases without jumps."""
    found: Ellipse | None = None
    for frame in range(60):
        true = Ellipse(60.3 + 0.7 * frame, 50.2 + 0.3 * frame, 0.4 + 0.13 * frame, 36, 17)
        found = fit_ellipse(ellipse_mask(true), found)
        assert found is not None
        assert math.hypot(found.x - true.x, found.y - true.y) < 0.5
        assert abs(found.angle_rad - true.angle_rad) < math.radians(1)
        assert found.major_px == pytest.approx(36, rel=0.02)
        assert found.minor_px == pytest.approx(17, rel=0.02)


def test_a_round_object_keeps_its_angle() -> None:
    before = Ellipse(50, 50, 7.3, 20, 19)
    found = fit_ellipse(ellipse_mask(Ellipse(52, 51, 0, 20, 20)), before)
    assert found is not None
    assert found.angle_rad == 7.3


def test_only_a_mask_with_pixels_has_an_ellipse() -> None:
    assert fit_ellipse(np.zeros((5, 6), bool)) is None
    one = np.zeros((5, 6), bool)
    one[2, 3] = True
    found = fit_ellipse(one)
    assert found is not None
    assert (found.x, found.y) == (3, 2)
    assert found.minor_px > 0


def test_an_element_follows_its_object() -> None:
    key, now = Ellipse(40, 30, 0.2, 20, 10), Ellipse(70, 55, 0.2 + math.pi / 2, 40, 20)
    there = complex(8 * math.cos(0.2), 8 * math.sin(0.2))
    element = Element("wedge", 40 + there.real, 30 + there.imag, 0.5, 0.1)
    moved = follow(element, key, now)
    assert complex(moved.x - 70, moved.y - 55) == pytest.approx(there * 2j)
    assert moved.angle_rad == pytest.approx(0.5 + math.pi / 2)
    assert moved.decay_per_px == pytest.approx(0.05)
    still = follow(element, key, key)
    assert (still.x, still.y) == pytest.approx((element.x, element.y))


@pytest.mark.parametrize("pattern", WINDINGS)
def test_a_pattern_is_stretched_as_its_object(pattern: Pattern) -> None:
    """Directions at moved points are the moved directions: a pattern of circles becomes one of ellipses."""
    key, now = Ellipse(200, 200, 0.3, 10, 5), Ellipse(200, 200, 1.1, 20, 5)
    element = Element(pattern, 200, 200, 0.4, 0.005)
    before, after = (basis_field(one, (401, 401)) for one in (element, follow(element, key, now)))
    turns = [np.array([[math.cos(a), -math.sin(a)], [math.sin(a), math.cos(a)]]) for a in (0.3, 1.1)]
    moves = turns[1] @ np.diag([2, 1]) @ turns[0].T
    for offset in ([70, 30], [-50, 60], [20, -80]):
        x, y = 200 + np.array(offset)
        own = float(angle_of(before)[y, x])
        along = moves @ [math.cos(own), math.sin(own)]
        x, y = (int(v) for v in np.rint(200 + moves @ offset))
        found = angle_of(after)[y : y + 1, x : x + 1]
        assert apart(found, math.atan2(along[1], along[0]) % math.pi)[0, 0] < 0.02, offset


@pytest.mark.parametrize(
    ("change", "field"),
    [({"pattern": "swirl"}, "pattern"), ({"x": math.nan}, "x"), ({"strength": -1.0}, "strength")],
)
def test_an_invalid_element_is_named(change: dict[str, object], field: str) -> None:
    with pytest.raises(BadParameter) as caught:
        Element(**({"pattern": "node", "x": 0.0, "y": 0.0} | change))  # type: ignore[arg-type]
    assert caught.value.field == field


def test_weights_out_of_range_are_named() -> None:
    field, tensors = np.zeros((2, 4, 5), np.float32), np.zeros((3, 4, 5), np.float32)
    with pytest.raises(BadParameter, match="edge_weight"):
        design_field(field, [], 1.5)
    with pytest.raises(BadParameter, match="memory"):
        smooth_over_time(tensors, tensors, None, 1.0)
