"""Strokes of multistyle on faces: shorter, flatter and more opaque in the middle of a face, unchanged elsewhere, and a
layer of fine strokes on small faces."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.frames import Frame
from pipeline.methods.multistyle.face_layer import FaceLayer
from pipeline.methods.multistyle.params import StyleName
from pipeline.methods.multistyle.styles import STYLES, LayerStyle, face_weight, layer_style, uniform
from pipeline.perception.faces import FACE, Faces
from pipeline.strokes.seeds import as_plane
from pipeline.strokes.tracks import LifecycleParams

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
    for before, after in ((without.threshold, beside.threshold), (without.layers, beside.layers)):
        np.testing.assert_array_equal(as_plane(before, SHAPE)[:-1], as_plane(after, SHAPE)[:-1])


def test_the_weight_of_a_face_rises_from_half_to_full_detail() -> None:
    assert face_weight(np.full(SHAPE, 0.5, np.float32)) is None
    weight = face_weight(np.array([[0.0, 0.5, 0.75, 1.0]], np.float32))
    assert weight is not None
    np.testing.assert_allclose(weight, [[0, 0, 0.5, 1]])


FRAME, BOX = (200, 160), (100.0, 80.0, 30.0, 30.0)
"""Size of a frame, and centre, width and height of a face in it, px."""


def one_face(box: tuple[float, ...] = BOX, strength: float = 1.0) -> Faces:
    return np.array([(box, box, strength, 1.0, 0.0, 0.0, 0)], FACE)


def eyes(shift: int = 0) -> Frame:
    """A light frame with two dark squares of 4 px, the eyes of the face `BOX`, moved to the right by `shift` px."""
    frame: Frame = np.full((FRAME[1], FRAME[0], 3), 200, np.uint8)
    for x in (92, 104):
        frame[74:78, x + shift : x + shift + 4] = 30
    return frame


def plain_style() -> LayerStyle:
    return layer_style(uniform(STYLES["van-gogh"].style, STYLES["van-gogh"].technique), None, FRAME[1])


def test_a_small_face_has_strokes_finer_than_its_eyes() -> None:
    layer = FaceLayer(FRAME, LifecycleParams(), 0).step(eyes(), one_face(), plain_style(), None, None, 0)
    assert layer is not None
    assert (np.abs(layer.xy - np.array(BOX[:2])) < 34).all(), "no stroke beside the head"
    assert layer.values("radius_px").min() == pytest.approx(0.85, abs=0.01)
    dark = layer.values("target").max(axis=1) < 100
    for x in (92, 104):
        inside = np.abs(layer.xy - np.array([x + 1.5, 75.5])).max(axis=1) < 1.6
        assert inside.any() and dark[inside].all()
    nose = np.abs(layer.xy - np.array([99.5, 75.5])).max(axis=1) < 2
    assert nose.any() and not dark[nose].any(), "the bridge of the nose is light"


def test_strokes_on_a_face_move_with_it_and_leave_with_it() -> None:
    layers = FaceLayer(FRAME, LifecycleParams(fade=0.25), 0)
    first = layers.step(eyes(), one_face(), plain_style(), None, None, 0)
    flow = np.zeros((FRAME[1], FRAME[0], 2), np.float32)
    flow[..., 0] = 3
    stored = FaceLayer(FRAME, LifecycleParams(fade=0.25), 0)
    stored.restore(layers.state())
    face = one_face((103.0, *BOX[1:]))
    second, again = (each.step(eyes(3), face, plain_style(), flow, None, 1) for each in (layers, stored))
    assert first is not None and second is not None and again is not None
    kept = np.isin(second.ids, first.ids)
    assert kept.mean() > 0.9
    before = dict(zip(first.ids, first.xy, strict=True))
    moved = np.array([xy - before[each] for each, xy in zip(second.ids[kept], second.xy[kept], strict=True)])
    np.testing.assert_allclose(moved, np.broadcast_to([3, 0], moved.shape), atol=1e-4)
    assert second.strokes.tobytes() == again.strokes.tobytes() and second.xy.tobytes() == again.xy.tobytes()
    still, counts = np.zeros_like(flow), []
    for number in range(2, 8):
        layer = layers.step(eyes(3), one_face()[:0], plain_style(), still, None, number)
        counts.append(0 if layer is None else len(layer))
    assert counts[0] > 0 and counts[-1] == 0, "they fade"


def test_frames_without_faces_have_no_such_strokes() -> None:
    layers = FaceLayer(FRAME, LifecycleParams(), 0)
    assert layers.step(eyes(), one_face()[:0], plain_style(), None, None, 0) is None


def test_a_large_face_has_such_strokes_at_its_eyes_and_brows_alone() -> None:
    large = one_face((100.0, 80.0, 90.0, 90.0))
    layer = FaceLayer(FRAME, LifecycleParams(), 0).step(eyes(), large, plain_style(), None, None, 0)
    assert layer is not None
    x, y = layer.xy.T
    assert (np.abs(y - 67) < 17).all() and (np.abs(np.abs(x - 100) - 18) <= 20).all()
    assert (x < 94).any() and (x > 106).any()


def test_a_weaker_face_has_fainter_strokes() -> None:
    full, half, faint = (
        FaceLayer(FRAME, LifecycleParams(), 0).step(eyes(), one_face(strength=each), plain_style(), None, None, 0)
        for each in (1.0, 0.5, 0.2)
    )
    assert full is not None and half is not None and faint is None
    assert full.values("opacity").max() == 1 and half.values("opacity").max() == 0.5
