"""Lines drawn from a field: exact coverage of straight outlines, one pixel sharp at any size, tapering, fading."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.frames import Plane
from pipeline.lines.coverage import (
    PEAK_SHARE,
    RESPONSE_TOLERANCE,
    PastMotion,
    blend_opacity,
    blend_response,
    draw_lines,
    line_field,
)
from pipeline.methods.abstraction.line_extractor import LineExtractor, PreviousFrame
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.sizes import sizes_of

FULL = 255


def ramp(angle_rad: float, offset_px: float, shape: tuple[int, int] = (24, 24), slope: float = 3.0) -> Plane:
    """A field that rises by `slope` a pixel across a straight outline."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return (slope * (x * np.cos(angle_rad) + y * np.sin(angle_rad) - offset_px)).astype(np.float32)


def drawn(field: Plane, size: tuple[int, int] | None = None) -> np.ndarray:
    return draw_lines(field, np.full(field.shape, FULL, np.uint8), size or (field.shape[1], field.shape[0]))


@pytest.mark.parametrize("slope", [0.2, 3.0, 90.0])
def test_a_vertical_outline_is_covered_exactly(slope: float) -> None:
    """Pixel centres are at whole x: an outline at 10.25 covers a quarter of pixel 10, whatever the field's slope."""
    row = drawn(ramp(0.0, 10.25, slope=slope))[12].astype(int)
    assert (row[1:10] == 0).all() and (row[12:-1] == FULL).all()
    assert row[10] == pytest.approx(0.25 * FULL, abs=1) and row[11] == FULL


@pytest.mark.parametrize("scale", [1, 2, 5])
def test_outlines_are_one_pixel_wide_at_every_size(scale: int) -> None:
    made = drawn(ramp(0.4, 11.0), (24 * scale, 24 * scale))
    middle = made[made.shape[0] // 2].astype(int)
    assert ((middle > 25) & (middle < 230)).sum() <= 2


def test_opacity_scales_the_ink() -> None:
    field = ramp(0.0, 10.0)
    made = draw_lines(field, np.full(field.shape, 100, np.uint8), (24, 24))
    assert made.max() == 100


def test_lines_taper_where_the_response_falls() -> None:
    y, x = np.mgrid[:21, :60].astype(np.float32)
    response = ((1 - x / 60) * 8 * np.exp(-(((y - 10) / 2) ** 2))).astype(np.float32)
    field = line_field(response, np.full(response.shape, 1 / 3, np.float32), 1.0, 0.0, 2)
    width = (drawn(field) / FULL).sum(axis=0)
    assert width[2] > width[30] > width[45] > 0 and width[58] == 0


def test_strong_lines_are_no_wider_than_their_peak_share_allows() -> None:
    y = np.mgrid[:41, :40][0].astype(np.float32)
    for strength in (20.0, 200.0):
        response = (strength * np.exp(-(((y - 20) / 4) ** 2))).astype(np.float32)
        field = line_field(response, np.zeros(response.shape, np.float32), 1.0, 0.0, 8)
        assert (drawn(field)[:, 20] / FULL).sum() <= 8 * np.sqrt(-np.log(PEAK_SHARE)) + 1


def test_the_outline_lies_the_margin_above_the_threshold() -> None:
    """On a ramp of one gray level per pixel, a margin of 2 gray levels moves the outline by 2 px."""
    response = np.broadcast_to(np.arange(20, dtype=np.float32), (12, 20)).copy()
    thin, wide = (
        (line_field(response, np.full(response.shape, 1 / 3, np.float32), 5.0, margin, 1) > 0)[6].sum()
        for margin in (2.0, 0.0)
    )
    assert wide - thin == 2


def test_more_is_drawn_where_importance_is_high() -> None:
    response = np.full((8, 8), 0.8, np.float32)
    low, high = (line_field(response, np.full((8, 8), i, np.float32), 1.0, 0.0, 1) for i in (0.0, 1.0))
    assert (low < 0).all() and (high > 0).all()


def test_opacity_follows_the_flow_and_fades() -> None:
    before = np.zeros((20, 30), np.uint8)
    before[8, 10] = 200
    made = blend_opacity(np.zeros_like(before), before, motion((3, 2), before.shape, 0.5))
    assert made[10, 13] == 100 and made.sum() == 100


def test_the_response_is_averaged_where_it_agrees_with_the_past() -> None:
    before = np.zeros((8, 8), np.float32)
    for difference, weight in ((0.1, 0.8), (float(RESPONSE_TOLERANCE), 0.4), (600.0, 0.0)):
        now = np.full((8, 8), difference, np.float32)
        kept = 1 - blend_response(now, before, motion((0, 0), (8, 8), 0.8)) / difference
        np.testing.assert_allclose(kept, weight, atol=0.01)


def test_the_past_response_is_moved_along_the_flow() -> None:
    x = np.tile(np.arange(20, dtype=np.float32), (10, 1))
    made = blend_response(x - 1.5, x, motion((1.5, 0), x.shape, 0.8))
    np.testing.assert_allclose(made[:, 2:-2], (x - 1.5)[:, 2:-2], atol=1e-5)


def motion(flow_px: tuple[float, float], shape: tuple[int, ...], weight: float) -> PastMotion:
    flow = np.tile(np.array(flow_px, np.float32), (*shape, 1))
    return PastMotion(flow, np.zeros(shape, np.uint8), np.full(256, weight, np.float32))


@pytest.mark.parametrize(("residual", "least", "most"), [(0, 40, 120), (254, 200, 255)])
def test_a_line_fades_in_unless_its_place_has_changed(residual: int, least: int, most: int) -> None:
    """The outline of a fast hand is new in every frame; if it faded in, it would not be drawn at all."""
    params = AbstractionParams(line_width=10, edges="sharp")
    lines = LineExtractor(params, sizes_of(params, (96, 96)))
    empty, importance = np.full((96, 96), 170, np.uint8), np.full((96, 96), 0.5, np.float32)
    lines.step(empty, importance, None)
    stripe = empty.copy()
    stripe[:, 46:50] = 60
    past = PreviousFrame(np.zeros((96, 96, 2), np.float32), np.full((96, 96), residual, np.uint8))
    assert least <= lines.step(stripe, importance, past).max() <= most
