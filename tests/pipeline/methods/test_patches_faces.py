"""Painting patches on faces: fine strokes follow a tracked face and leave everything else as it is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from pipeline.frames import Frame
from pipeline.methods.patches import patch_construction
from pipeline.methods.patches.clustering import plan_cluster
from pipeline.methods.patches.face_tracking import FaceWeights, single_frame_weights
from pipeline.methods.patches.painter import HertzmannPainter
from pipeline.methods.patches.params import PatchesParams
from pipeline.scenes import scene
from tests.pipeline.methods.frames import painted
from tests.pipeline.methods.patch_scenes import paint
from tests.pipeline.methods.test_patches import context

SIZE, FRAMES = (192, 144), 14


@cache
def portrait() -> tuple[Frame, ...]:
    return tuple(scene("portrait", SIZE, frames=FRAMES).image(index) for index in range(FRAMES))


def head() -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    weights = single_frame_weights(np.asarray(cv2.cvtColor(portrait()[0], cv2.COLOR_RGB2GRAY), np.uint8), 1.0)
    assert weights is not None
    return weights


def error(painting: Frame) -> float:
    """Mean absolute difference to the first frame inside the head."""
    difference = np.abs(painting.astype(np.float32) - portrait()[0]).mean(axis=-1)
    return float(difference[head() > 0.9].mean())


def test_fine_strokes_bring_a_face_nearer_to_the_frame_and_change_nothing_far_from_it() -> None:
    painter = HertzmannPainter.of("hertzmann", SIZE[0] * SIZE[1], SIZE[1], PatchesParams(), 0)
    without, fine = painter.paint_picture(portrait()[0]), painter.paint_picture(portrait()[0], head())
    assert error(fine) < 0.8 * error(without)
    reach = 2 * int(painter.reach_px) + 1
    far = cv2.dilate((head() > 0).astype(np.uint8), np.ones((reach, reach), np.uint8)) == 0
    assert far.any()
    np.testing.assert_array_equal(fine[far], without[far])


def test_a_part_of_a_frame_gets_the_strokes_of_the_whole_frame_on_a_face() -> None:
    painter = HertzmannPainter.of("hertzmann", SIZE[0] * SIZE[1], SIZE[1], PatchesParams(), 0)
    whole, where = painter.paint_picture(portrait()[0], head()), head() > 0
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
    read = FaceWeights(made, 0)
    for index in (0, 11, 12, 13):
        weights = read(index)
        assert weights is not None and weights.max() > 0.9, index


def test_face_tasks_depend_on_flow_and_the_run_before_and_exist_only_on_demand() -> None:
    tasks = {task.key: task for task in plan_cluster(context(30))}
    assert tasks["faces-0000000"].after == ("flow-0000000",)
    assert set(tasks["faces-0000024"].after) == {"flow-0000024", "flow-0000012", "faces-0000012"}
    without = replace(context(30), params=PatchesParams(face_detail=0))
    assert not any(task.key.startswith("faces") for task in plan_cluster(without))
