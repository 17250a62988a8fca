"""Multistyle: stroke directions of flat areas, of elements, and beside objects."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.frames import Frame, Mask
from pipeline.methods.base import no_clock
from pipeline.methods.multistyle.analyzer import StrokeAnalyzer
from pipeline.methods.multistyle.design import parse
from pipeline.methods.multistyle.design_fields import RegionPlacement
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.tensors.field import angle_of

SIZE = (192, 128)


def angles_deg(
    picture: Frame, directions: list[dict[str, Any]], cat: Mask | None = None, **values: Any
) -> np.ndarray:  # fmt: skip
    """Stroke angles in [0, 180) of one frame; `cat` is where the region "cat" is."""
    document = {"version": 1, "regions": {"cat": {"label": 1}}, "directions": directions}
    size = (picture.shape[1], picture.shape[0])
    params = MultistyleParams.model_validate(values)
    analyzer = StrokeAnalyzer(params, size, 0, no_clock, parse(document, masks=True))
    regions = np.zeros(size[::-1], np.uint8) if cat is None else cat.astype(np.uint8)
    field = analyzer.observe(picture, RegionPlacement(0, regions, {}, {})).field
    return np.degrees(angle_of(field))


def apart_deg(one: np.ndarray, other: np.ndarray | float) -> np.ndarray:
    return np.abs((one - other + 90) % 180 - 90)


def constant(angle_deg: float, edge_weight: float) -> list[dict[str, Any]]:
    element = {"pattern": "regular", "at": [0.5, 0.5], "angle": angle_deg, "reach": "everywhere"}
    return [{"region": "rest", "edge_weight": edge_weight, "elements": [element]}]


@pytest.mark.parametrize("edge_weight", [0.2, 0.5, 0.8])
def test_an_element_alone_directs_strokes_where_the_picture_has_no_edges(edge_weight: float) -> None:
    gray = np.full((*SIZE[::-1], 3), 128, np.uint8)
    assert apart_deg(angles_deg(gray, constant(10, edge_weight)), 10).max() < 0.05


def test_without_edges_and_elements_strokes_have_the_default_direction() -> None:
    gray = np.full((*SIZE[::-1], 3), 128, np.uint8)
    faint = {"pattern": "regular", "at": [0, 0], "angle": 10, "reach": 0.05}
    found = angles_deg(gray, [{"region": "rest", "elements": [faint]}])
    assert apart_deg(found[0, 0], 10) < 0.5 and apart_deg(found[64:, 64:], -35).max() < 0.5


def test_flat_areas_beside_an_edge_follow_it() -> None:
    picture = np.full((*SIZE[::-1], 3), 60, np.uint8)
    picture[:, 96:] = 190
    found = angles_deg(picture, [])
    assert apart_deg(found[:, 90:102], 90).max() < 1, "within six hundredths of the height of the edge"
    assert apart_deg(found[64, 104], 90) < 10 and apart_deg(found[64, 10], -35) < 1


def test_one_constraint_directs_a_whole_background_and_leaves_the_object_alone() -> None:
    """Figure 4e of kagaya2011video: with regions, one element makes the background's directions constant, and those
    inside the cat stay as they are without it."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    cat = ((x - 96) / 50) ** 2 + ((y - 64) / 36) ** 2 < 1
    texture = 110 + 60 * np.sin((x + 2 * y) / 6) + np.where(cat, 50 * np.cos(y / 5), 0)
    picture = np.repeat(np.clip(texture, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
    before, after = angles_deg(picture, [], cat), angles_deg(picture, constant(30, 0), cat)
    assert apart_deg(after[~cat], 30).max() < 0.05
    assert apart_deg(after[cat], before[cat]).max() < 0.05
    assert np.median(apart_deg(before[~cat], 30)) > 20


@pytest.mark.parametrize(
    ("values", "rows"), [({}, 180), ({"direction_rows": 2160}, 360), ({"edge_smoothing": 2}, 360)], ids=str
)
def test_directions_follow_the_border_of_a_region_to_their_resolution(values: dict[str, Any], rows: int) -> None:
    """A disc with strokes at 60 degrees before strokes at 0: the share of pixels with the other's direction."""
    y, x = np.mgrid[:360, :480]
    cat = (x - 240) ** 2 + (y - 180) ** 2 < 121**2
    directions = [
        {"region": name, "edge_weight": 0, "elements": [{"pattern": "regular", "at": [0, 0], "angle": angle}]}
        for name, angle in (("rest", 0), ("cat", 60))
    ]
    found = angles_deg(np.full((360, 480, 3), 128, np.uint8), directions, cat, **values)
    assert found.shape == (rows, 480 * rows // 360)
    wrong = apart_deg(np.kron(found, np.ones((360 // rows, 360 // rows))), np.where(cat, 60, 0)) > 1
    assert wrong.mean() == 0 if rows == 360 else 0.001 < wrong.mean() < 0.01


def test_directions_of_a_step_do_not_depend_on_their_resolution() -> None:
    y, x = np.mgrid[:360, :480]
    picture = np.repeat(np.where(x + y / 2 < 330, 70, 170).astype(np.uint8)[..., None], 3, axis=2)
    coarse, fine = (angles_deg(picture, [], None, direction_rows=rows) for rows in (160, 2160))
    assert np.percentile(apart_deg(fine[::2, ::2], coarse), 99) < 3
