"""Strokes of a pen."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.lines.pen import Strokes, draw_strokes, join_strokes


def stroke(places: list[tuple[float, float]], half_width: float, opacity: float = 1.0) -> Strokes:
    count = len(places)
    return Strokes(
        np.array(places, np.float32), np.full(count, half_width, np.float32), np.full(count, opacity, np.float32),
        np.array([0, count], np.int32),
    )  # fmt: skip


@pytest.mark.parametrize("half_width", [0.3, 0.9, 2.25])
@pytest.mark.parametrize("end", [(52.3, 20.4), (52.3, 41.0), (12.1, 50.0)])
def test_a_line_covers_its_area(half_width: float, end: tuple[float, float]) -> None:
    begin = (12.1, 20.4)
    ink = draw_strokes(stroke([begin, end], half_width), (70, 70)) / 255
    length = np.hypot(end[0] - begin[0], end[1] - begin[1])
    assert ink.sum() == pytest.approx(2 * half_width * length + np.pi * half_width**2, rel=0.09)


def test_ink_is_as_opaque_as_the_most_opaque_stroke() -> None:
    one, two = stroke([(5, 10), (35, 10)], 2, 0.4), stroke([(20, 2), (20, 18)], 2, 0.8)
    ink = draw_strokes(join_strokes(one, two), (40, 20))
    assert ink[9, 20] == ink[4, 20] == 204 and ink[9, 8] == 102 and ink.max() == 204


def test_a_stroke_beyond_the_frame_is_cut_off() -> None:
    ink = draw_strokes(stroke([(-30, 5), (90, 5)], 1.5), (40, 10))
    assert (ink[4] == 255).all() and not ink[9].any()
