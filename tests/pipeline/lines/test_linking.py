"""Curves from points of ridges."""

from __future__ import annotations

import numpy as np
import pytest

from tests.pipeline.lines.drawn import lengths, stroked, traced


def test_a_line_is_one_curve_in_order() -> None:
    points, curves, _ = traced(stroked([[(10, 12), (110, 44)]], (120, 60)))
    longest = np.diff(curves.starts).argmax()
    order = curves.order[curves.starts[longest] : curves.starts[longest + 1]]
    steps = np.diff(points["x"][order])
    assert len(order) > 95 and (steps > 0).all() | (steps < 0).all()


def test_a_circle_is_a_loop() -> None:
    angles = np.linspace(0, 2 * np.pi, 100)
    circle = np.column_stack([40 + 25 * np.cos(angles), 40 + 25 * np.sin(angles)])
    _, curves, _ = traced(stroked([[(float(x), float(y)) for x, y in circle]], (80, 80)))
    longest = np.diff(curves.starts).argmax()
    order = curves.order[curves.starts[longest] : curves.starts[longest + 1]]
    assert order[0] == order[-1] and len(set(order.tolist())) == len(order) - 1 > 120


@pytest.mark.parametrize(("gap", "joined"), [(7, True), (20, False)])
def test_a_short_gap_is_joined(gap: float, joined: bool) -> None:
    parts = [[(10.0, 20.0), (50.0, 20.0)], [(50.0 + gap, 20.0), (110.0, 20.0)]]
    _, curves, _ = traced(stroked(parts, (120, 40)))
    assert (lengths(curves)[0] > 85) == joined


def test_ends_that_do_not_face_each_other_stay_apart() -> None:
    _, curves, _ = traced(stroked([[(10, 20), (50, 20)], [(56, 26), (56, 70)]], (90, 90)))
    assert lengths(curves)[0] < 50


def test_a_mirrored_picture_has_mirrored_curves() -> None:
    gray = stroked([[(10, 12), (60, 40), (110, 44)], [(60, 5), (66, 55)]], (120, 60))
    assert lengths(traced(gray)[1]) == lengths(traced(np.ascontiguousarray(gray[:, ::-1]))[1])


def test_no_points_give_no_curves() -> None:
    _, curves, _ = traced(np.full((20, 20), 90, np.float32))
    assert curves.starts.tolist() == [0] and not curves.order.size
