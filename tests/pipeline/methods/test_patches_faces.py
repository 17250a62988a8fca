"""Painting patches on faces: fine strokes follow a tracked face and leave everything else as it is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from pipeline.frames import Frame
from pipeline.methods.patches import face_tracking, patch_construction
from pipeline.methods.patches.clustering import plan_cluster
from pipeline.methods.patches.face_strokes import LAYERS, FaceBrush, FacePlanes, narrow_px, smallest_width
from pipeline.methods.patches.face_tracking import ShotFaces, single_frame_planes, stroke_widths
from pipeline.methods.patches.painter import HertzmannPainter, reach_px
from pipeline.methods.patches.panorama_faces import as_planes
from pipeline.methods.patches.params import PatchesParams
from pipeline.scenes import scene
from tests.pipeline.methods.frames import painted
from tests.pipeline.methods.patch_scenes import paint
from tests.pipeline.methods.test_patches import context

SIZE, FRAMES = (192, 144), 14


@cache
def portrait() -> tuple[Frame, ...]:
    return tuple(scene("portrait", SIZE, frames=FRAMES).image(index) for index in range(FRAMES))


def head() -> FacePlanes:
    faces = single_frame_planes(np.asarray(cv2.cvtColor(portrait()[0], cv2.COLOR_RGB2GRAY), np.uint8), 1.0)
    assert faces is not None
    return faces


def error(painting: Frame) -> float:
    """Mean absolute difference to the first frame inside the head."""
    difference = np.abs(painting.astype(np.float32) - portrait()[0]).mean(axis=-1)
    return float(difference[head().weight > 0.9].mean())


def test_fine_strokes_bring_a_face_nearer_to_the_frame_and_change_nothing_far_from_it() -> None:
    painter = HertzmannPainter.of("hertzmann", SIZE[0] * SIZE[1], SIZE[1], PatchesParams(), 0)
    without, fine = painter.paint_picture(portrait()[0]), painter.paint_picture(portrait()[0], head())
    assert error(fine) < 0.8 * error(without)
    reach = 2 * int(reach_px(painter.brush)) + 1
    far = cv2.dilate((head().weight > 0).astype(np.uint8), np.ones((reach, reach), np.uint8)) == 0
    assert far.any()
    np.testing.assert_array_equal(fine[far], without[far])


def test_a_part_of_a_frame_gets_the_strokes_of_the_whole_frame_on_a_face() -> None:
    painter = HertzmannPainter.of("hertzmann", SIZE[0] * SIZE[1], SIZE[1], PatchesParams(), 0)
    whole, where = painter.paint_picture(portrait()[0], head()), head().weight > 0
    part = painter.paint_part(portrait()[0], np.ones_like(where), head())
    np.testing.assert_array_equal(part, whole)


def test_patches_paint_faces_finer_and_alike_in_one_task_and_in_many(monkeypatch: pytest.MonkeyPatch) -> None:
    frames, made = list(portrait()[:4]), []
    for area in (0.0, 1e9):
        monkeypatch.setattr(patch_construction, "SINGLE_TASK_AREA", area)
        made.append(painted(paint(frames)))
    np.testing.assert_array_equal(*made)
    assert error(made[0][0]) < 0.8 * error(painted(paint(frames, face_detail=0))[0])


def test_faces_are_tracked_from_run_to_run() -> None:
    made = paint(list(portrait()))
    read = ShotFaces(made, 0)
    for index in (0, 11, 12, 13):
        faces = read(index)
        assert faces is not None and faces.weight.max() > 0.9, index


def test_a_face_that_appears_is_known_from_the_next_run_on() -> None:
    empty = np.full_like(portrait()[0], 128)
    made = paint([empty] * 12 + list(portrait()[:2]), cut_sensitivity=0)
    read = ShotFaces(made, 0)
    assert read(11) is None
    faces = read(12)
    assert faces is not None and faces.weight.max() > 0.9


def test_face_tasks_depend_on_flow_and_the_run_before_and_exist_only_on_demand() -> None:
    tasks = {task.key: task for task in plan_cluster(context(30))}
    assert tasks["faces-0000000"].after == ("flow-0000000",)
    assert set(tasks["faces-0000024"].after) == {"flow-0000024", "flow-0000012", "faces-0000012"}
    without = replace(context(30), params=PatchesParams(face_detail=0))
    assert not any(task.key.startswith("faces") for task in plan_cluster(without))


def flat_face(width_px: float, shape: tuple[int, int] = (40, 40)) -> FacePlanes:
    return FacePlanes(np.ones(shape, np.float32), np.full(shape, width_px, np.float32))


def test_strokes_on_a_large_face_are_a_ninth_of_its_width_and_on_a_small_one_as_fine_as_possible() -> None:
    large, small = (FaceBrush(LAYERS[0], 2.0).size_px(width) for width in (180.0, 24.0))
    assert (float(large), float(small)) == (20.0, 4.0)
    fine = [FaceBrush(layer, 2.0).limit(flat_face(width), 25.0).max() for layer in LAYERS for width in (24.0, 180.0)]
    assert fine[0] == fine[1] == fine[2] == fine[4]  # all layers cover small faces, the coarsest one all faces
    assert fine[3] > 3 * fine[2] and fine[5] > fine[3]  # fine strokes on large faces only where they matter


def test_eyes_and_mouth_of_a_large_face_get_finer_strokes_than_its_cheeks() -> None:
    widths = stroke_widths(np.array([50.0, 50.0, 80.0, 80.0]), (100, 100), (100, 100))
    cheek, eyes, mouth = widths[60, 25], (widths[41, 35], widths[41, 65]), widths[71, 50]
    assert cheek == 80 and max(*eyes, mouth) < 25


def test_paint_at_the_eyes_is_replaced_sooner_than_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """The frames are 12 % darker from the sixth on. Elsewhere, the paint of the first frames is within the limit."""
    frames = [np.rint(frame * (1.0 if k < 5 else 0.88)).astype(np.uint8) for k, frame in enumerate(portrait()[:10])]
    made = paint(frames, cut_sensitivity=0)
    factor = ShotFaces(made, 0).tolerance(7)
    assert factor is not None
    assert factor.max() == 1 and factor.min() == pytest.approx(face_tracking.FEATURE_TOLERANCE, abs=0.05)
    eyes = factor < 0.5
    followed = np.abs(painted(made)[7].astype(np.float32) - frames[7])[eyes].mean()
    monkeypatch.setattr(face_tracking, "FEATURE_TOLERANCE", 1.0)
    kept = np.abs(painted(paint(frames, cut_sensitivity=0))[7].astype(np.float32) - frames[7])[eyes].mean()
    assert followed < 0.9 * kept


def test_faces_of_different_width_are_painted_in_groups_whose_grids_of_seeds_do_not_depend_on_each_other() -> None:
    one, other = flat_face(30.0), flat_face(150.0)
    both = FacePlanes(np.hstack([one.weight, other.weight]), np.hstack([one.width_px, other.width_px]))
    (coarse, first), (fine, second) = both.groups(0.0)
    assert (coarse, fine) == (128.0, 32.0)
    assert (first.corner, first.weight.shape) == ((0, 40), (40, 40))
    assert (second.corner, second.weight.shape) == ((0, 0), (40, 40))
    alone = next(iter(one.groups(0.0)))[1]
    np.testing.assert_array_equal(second.width_px, alone.width_px)
    whole = second.upscaled((slice(0, 40), slice(0, 80)), float(smallest_width(fine)))
    assert not whole.weight[:, 40:].any() and whole.width_px.min() >= 32 / 2**0.51


def test_faces_with_strokes_of_one_width_are_one_group() -> None:
    widths = np.array([[1.0, 9.0, 20.0, 44.0, 46.0, 200.0]], np.float32)
    least = narrow_px(2.8)
    assert 45.26 < least < 64
    assert (
        len({float(FaceBrush(layer, 2.8).size_px(np.float32(w))) for layer in LAYERS[:1] for w in widths[0, :4]}) == 1
    )
    found = [
        (power, group.weight.shape[1]) for power, group in FacePlanes(np.ones((1, 6), np.float32), widths).groups(least)
    ]
    assert found == [(256.0, 1), (64.0, 1), (32.0, 4)]


def test_width_of_a_face_in_the_panorama_is_that_in_the_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patch_construction, "SINGLE_TASK_AREA", 0.0)
    made = paint(list(portrait()[:4]))
    frame = ShotFaces(made, 0)(0)
    stored = [load["weights"] for (_, name), load in made.kept.items() if name.endswith("-faces") and "weights" in load]
    panorama = [as_planes(weights) for weights in stored]
    assert frame is not None and panorama
    largest = max(faces.width_px[faces.weight > 0.5].max(initial=0) for faces in panorama if faces is not None)
    assert largest == pytest.approx(frame.width_px.max(), rel=0.1)
