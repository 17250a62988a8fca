"""The choice of curves: length, strength, the past, and texture."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.lines.linking import Curves
from pipeline.lines.ridges import POINT, Points
from pipeline.lines.selection import PastLines, choose_curves

SHAPE = (120, 160)


def rows(*spans: tuple[int, int, int], excess: float = 2.0, importance: float = 0.0) -> tuple[Points, Curves]:
    """Horizontal curves: (y, first x, last x) each."""
    points, starts = [], [0]
    for y, first, last in spans:
        for x in range(first, last + 1):
            points.append((x, y, 1, 0, 1 + excess, 1, 1.5, importance))
        starts.append(len(points))
    return np.array(points, POINT), Curves(np.arange(len(points), dtype=np.int32), np.array(starts, np.int32))


def drawn(
    given: tuple[Points, Curves], opacity: np.ndarray | None = None, moved: float = 0.0, thickness: float = 1.0
) -> int:  # fmt: skip
    flow = np.zeros((*SHAPE, 2), np.float32)
    flow[..., 1] = moved
    past = None if opacity is None else PastLines(opacity, flow)
    return len(choose_curves(*given, past, np.full(SHAPE, thickness, np.float32), 1.0, 12.0).starts) - 1


def test_a_short_curve_is_drawn_if_it_is_strong() -> None:
    assert drawn(rows((20, 10, 60))) == 1
    assert drawn(rows((40, 10, 18))) == 0
    assert drawn(rows((40, 10, 18), excess=6.0)) == 1


def test_a_short_curve_is_drawn_where_importance_is_high() -> None:
    assert drawn(rows((40, 10, 17), importance=1.0)) == 1


@pytest.mark.parametrize("importance", [0.0, 1.0])
def test_a_spot_is_not_drawn_however_strong_it_is_unless_lines_are_thin_there(importance: float) -> None:
    spot = rows((40, 10, 15), excess=40.0, importance=importance)
    assert drawn(spot) == 0 and drawn(spot, thickness=0.7) == 1


@pytest.mark.parametrize(("moved", "stays"), [(4.0, 1), (0.0, 0)])
def test_a_weak_curve_stays_where_a_line_has_moved_to(moved: float, stays: int) -> None:
    weak = rows((40, 10, 40), excess=0.8)
    opacity = np.zeros(SHAPE, np.uint8)
    opacity[36, 10:41] = 255
    assert drawn(weak) == 0 and drawn(weak, opacity, moved) == stays


def test_lines_in_all_directions_are_texture_and_parallel_ones_are_not() -> None:
    hatching = rows(*((y, x, x + 14) for y in range(40, 80, 4) for x in (40, 60, 80)))
    points = hatching[0].copy()
    turned = np.random.default_rng(3).uniform(0, np.pi, len(hatching[1].starts) - 1)
    angles = np.repeat(turned, np.diff(hatching[1].starts))
    points["along_x"], points["along_y"] = np.cos(angles), np.sin(angles)
    assert drawn(hatching) == 30 and drawn((points, hatching[1])) < 5


def test_no_curves() -> None:
    assert drawn(rows()) == 0
