"""Width, place and opacity of the strokes of curves."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.frames import Plane
from pipeline.lines.inking import ink_curves
from pipeline.lines.pen import Strokes
from pipeline.lines.selection import choose_curves
from tests.pipeline.lines.drawn import SIGMA_PX, stroked, traced


def inked(gray: Plane) -> Strokes:
    points, curves, response = traced(gray)
    curves = choose_curves(points, curves, None, np.ones((len(gray), gray.shape[1]), np.float32), 1.0, 10.0)
    return ink_curves(
        points, curves, response, np.full(gray.shape, SIGMA_PX, np.float32), 0.65, 2.0,
        np.zeros(len(curves.order), np.float32),
    )  # fmt: skip


def longest(strokes: Strokes) -> slice:
    k = int(np.diff(strokes.starts).argmax())
    return slice(int(strokes.starts[k]), int(strokes.starts[k + 1]))


def edge(contrast: int) -> Plane:
    """Dark above row 30, light below."""
    gray = np.full((60, 100), 60 + contrast, np.float32)
    gray[:30] = 60
    return np.asarray(cv2.GaussianBlur(gray, (0, 0), 0.7), np.float32)


def test_a_line_beside_an_edge_moves_towards_it() -> None:
    strokes = inked(edge(140))
    middle = strokes.places[longest(strokes)][20:-20, 1]
    assert np.abs(middle - 30).max() < 0.8 * SIGMA_PX and np.ptp(middle) < 0.05


def test_a_dark_line_stays_where_it_is() -> None:
    strokes = inked(stroked([[(-5, 20), (105, 20)]], (100, 40)))
    assert np.abs(strokes.places[longest(strokes)][20:-20, 1] - 20.5).max() < 0.1


def test_a_faint_line_is_thinner_and_less_opaque() -> None:
    faint, strong = (inked(edge(contrast)) for contrast in (30, 140))
    assert np.median(faint.half_widths) < 0.75 * np.median(strong.half_widths)
    assert np.median(faint.opacities) < 0.9 < np.median(strong.opacities)


def test_free_ends_taper_and_ends_at_another_line_do_not() -> None:
    strokes = inked(stroked([[(20, 10), (20, 70)], [(21, 40), (80, 40)]], (100, 80)))
    for begin, stop in zip(strokes.starts[:-1], strokes.starts[1:], strict=True):
        places, widths = strokes.places[begin:stop], strokes.half_widths[begin:stop]
        if np.ptp(places[:, 0]) > 40:  # the horizontal line, from the vertical one to the right
            widths = widths if places[0, 0] < places[-1, 0] else widths[::-1]
            assert widths[-1] < 0.5 * np.median(widths) < widths[0]
            return
    pytest.fail("no horizontal line")


def test_a_line_reaches_the_border_of_the_frame() -> None:
    strokes = inked(stroked([[(-5, 20), (105, 20)]], (100, 40)))
    part = longest(strokes)
    assert strokes.places[part, 0].min() < 0 and strokes.places[part, 0].max() > 100
    assert strokes.half_widths[part].min() > 0.8 * np.median(strokes.half_widths[part])
