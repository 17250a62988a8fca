"""Strokes that follow the marks of the previous frame."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.lines.memory import MEMORY, fading_strokes, follow_marks, leave_marks
from pipeline.lines.past import PastMotion
from pipeline.lines.pen import Strokes

SHAPE = (40, 80)


def line(y: float, half_width: float = 1.0, opacity: float = 1.0, slope: float = 0.0) -> Strokes:
    x = np.arange(10, 70, dtype=np.float32)
    places = np.column_stack([x, y + slope * (x - 40)]).astype(np.float32)
    count = len(x)
    return Strokes(
        places, np.full(count, half_width, np.float32), np.full(count, opacity, np.float32),
        np.array([0, count], np.int32),
    )  # fmt: skip


def followed(now: Strokes, before: Strokes, down_px: float = 0.0, weight: float = 0.5) -> Strokes:
    flow = np.zeros((*SHAPE, 2), np.float32)
    flow[..., 1] = down_px
    motion = PastMotion(flow, np.zeros(SHAPE, np.uint8), np.full(256, weight, np.float32))
    return follow_marks(now, leave_marks(before, SHAPE), motion)


@pytest.mark.parametrize("down_px", [0.0, 6.25])
def test_a_line_moves_a_part_of_the_way_to_where_it_was(down_px: float) -> None:
    out = followed(line(20.4 + down_px), line(20.0), down_px)
    middle = out.places[15:-15, 1] - down_px
    np.testing.assert_allclose(middle, 20.4 - 0.75 * 0.4, atol=0.02)


def test_width_and_opacity_are_mixed() -> None:
    out = followed(line(20.0, half_width=1.0, opacity=1.0), line(20.0, half_width=2.0, opacity=0.5))
    np.testing.assert_allclose(out.half_widths[15:-15], 1.75, atol=0.03)
    np.testing.assert_allclose(out.opacities[15:-15], 0.75, atol=0.01)


def test_a_new_line_fades_in_at_its_place() -> None:
    out = followed(line(20.0), line(30.0))
    np.testing.assert_allclose(out.places, line(20.0).places, atol=1e-5)
    np.testing.assert_allclose(out.opacities, 0.5, atol=1e-5)


def test_a_line_that_crosses_another_does_not_follow_it() -> None:
    upright = line(20.0)._replace(
        places=np.column_stack([np.full(30, 40.0), np.arange(5, 35)]).astype(np.float32),
        half_widths=np.ones(30, np.float32), opacities=np.ones(30, np.float32), starts=np.array([0, 30], np.int32),
    )  # fmt: skip
    np.testing.assert_allclose(followed(upright, line(20.0)).places, upright.places, atol=1e-5)


def test_a_line_fades_in_where_the_picture_has_changed_too() -> None:
    out = followed(line(20.0), line(30.0), weight=0.0)
    np.testing.assert_allclose(out.opacities, 1 - MEMORY.least_weight, atol=1e-5)


def faded(now: Strokes, before: Strokes, weight: float = 0.5) -> Strokes:
    flow = np.zeros((*SHAPE, 2), np.float32)
    flow[..., 1] = 3
    motion = PastMotion(flow, np.zeros(SHAPE, np.uint8), np.full(256, weight, np.float32))
    return fading_strokes(before, leave_marks(now, SHAPE), motion)


def test_a_line_without_successor_moves_on_and_fades_out() -> None:
    out = faded(line(30.0), line(10.0))
    np.testing.assert_allclose(out.places, line(13.0).places, atol=1e-5)
    np.testing.assert_allclose(out.opacities, 0.5, atol=1e-5)
    assert out.starts.tolist() == [0, 60]


def test_only_the_missing_part_of_a_line_fades_out() -> None:
    whole, shape = line(10.0), slice(0, 30)
    half = Strokes(
        whole.places[shape] + np.array([0, 3], np.float32), whole.half_widths[shape], whole.opacities[shape],
        np.array([0, 30], np.int32),
    )  # fmt: skip
    out = faded(half, whole)
    assert out.starts.tolist() == [0, 29] and out.places[:, 0].min() == 41


def test_a_line_that_is_drawn_again_or_lies_where_the_picture_has_changed_does_not_fade() -> None:
    assert len(faded(line(13.0), line(10.0)).places) == 0
    assert len(faded(line(30.0), line(10.0), weight=0.0).places) == 0
