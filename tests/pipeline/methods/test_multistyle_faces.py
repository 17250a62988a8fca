"""Strokes of multistyle on faces: shorter, flatter and more opaque in the middle of a face, unchanged elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.methods.multistyle.params import StyleName
from pipeline.methods.multistyle.styles import STYLES, LayerStyle, face_weight, layer_style, uniform
from pipeline.strokes.seeds import as_plane

SHAPE, HEIGHT = (8, 8), 360


def styled(name: StyleName, detail: float, corner: float) -> LayerStyle:
    """Style of a picture with this detail; its last pixel has the detail `corner`."""
    plane = np.full(SHAPE, detail, np.float32)
    plane[-1, -1] = corner
    return layer_style(uniform(STYLES[name].style, STYLES[name].technique), plane, HEIGHT)


@pytest.mark.parametrize("name", STYLES)
def test_strokes_in_a_face_are_shorter_flatter_and_more_opaque(name: StyleName) -> None:
    brush, face = styled(name, 0.5, 1.0).brush, (-1, -1)
    length, opacity, relief = (as_plane(field, SHAPE) for field in (brush.length_px, brush.opacity, brush.relief_px))
    plain = STYLES[name].style
    assert length[face] <= 0.2 * plain.length * HEIGHT / 1000
    assert opacity[face] >= 0.8
    assert relief[face] <= 0.5 * plain.relief * HEIGHT / 1000


def test_a_face_changes_no_style_where_other_cues_set_the_detail() -> None:
    without, beside = styled("watercolor", 0.4, 0.4), styled("watercolor", 0.4, 1.0)
    for name in ("size_px", "length_px", "opacity", "jitter", "relief_px"):
        one, other = (as_plane(getattr(style.brush, name), SHAPE) for style in (without, beside))
        np.testing.assert_array_equal(one[:-1], other[:-1], err_msg=name)
    for one, other in ((without.threshold, beside.threshold), (without.layers, beside.layers)):
        np.testing.assert_array_equal(as_plane(one, SHAPE)[:-1], as_plane(other, SHAPE)[:-1])


def test_the_weight_of_a_face_rises_from_half_to_full_detail() -> None:
    assert face_weight(np.full(SHAPE, 0.5, np.float32)) is None
    weight = face_weight(np.array([[0.0, 0.5, 0.75, 1.0]], np.float32))
    assert weight is not None
    np.testing.assert_allclose(weight, [[0, 0, 0.5, 1]])
