"""Analogy: guides that are computed from the pictures, and the random search of every round."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.analogy.automatic_guides import automatic_guides, edges, faces, places
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.local import LocalContext, run_plan
from pipeline.synthesis.refine import Rounds
from tests.pipeline.methods.frames import painted

SIZE = (96, 72)


def test_edges_are_strong_at_edges_alone() -> None:
    picture = np.full((60, 80, 3), 40, np.uint8)
    picture[:, 40:] = 200
    found = edges(picture)
    assert found[:, 39:41].min() > 180 and found[:, :30].max() == 0


def test_places_are_fractions_of_width_and_height() -> None:
    found = places(np.zeros((41, 81, 3), np.uint8))
    assert found.shape == (41, 81, 2)
    assert [found[row, column].tolist() for row, column in ((0, 0), (20, 40), (40, 80))] == [
        [0, 0], [128, 128], [255, 255],
    ]  # fmt: skip


@pytest.mark.real("media")
def test_faces_are_found_where_they_are(media: Path) -> None:
    video = cv2.VideoCapture(str(media / "video" / "foreman_cif.mp4"))
    picture = np.ascontiguousarray(video.read()[1][..., ::-1])
    found = faces(picture)
    assert found[110:150, 150:190].min() > 200 and found[:, :40].max() == 0
    assert faces(np.full((120, 160, 3), 90, np.uint8)).max() == 0


def test_only_guides_with_a_weight_are_computed() -> None:
    assert automatic_guides(AnalogyParams()) == ()
    chosen = automatic_guides(AnalogyParams(edge_guide=3, place_guide=2))
    assert [(guide.name, guide.weights) for guide in chosen] == [("edges", (3.0,)), ("places", (1.0, 1.0))]


def rendered(inputs: dict[str, Any], **params: Any) -> np.ndarray:
    chosen = method("analogy")
    frames = [np.full((SIZE[1], SIZE[0], 3), 128, np.uint8)] * 2
    context = LocalContext(parse_params(chosen, {"levels": 3, "iterations": 3, **params}), frames, inputs)
    run_plan(chosen, context)
    return painted(context)


def two_halves() -> Frame:
    """A painting of one lightness: greenish to the left, reddish to the right, each with a grain of its own."""
    grain = cv2.GaussianBlur(np.random.default_rng(1).normal(size=(96, 128)).astype(np.float32), (0, 0), 1.5) * 60
    out = np.empty((96, 128, 3), np.float32)
    out[:, :64], out[:, 64:] = (70, 140, 90), (190, 95, 90)
    return np.clip(out + grain[..., None], 0, 255).astype(np.uint8)


@pytest.mark.real("opencl")
@pytest.mark.parametrize("scene", [False, True], ids=["painting alone", "with its scene"])
def test_the_guide_of_places_takes_paint_from_the_same_place(scene: bool) -> None:
    inputs: dict[str, Any] = {"style_output": [two_halves()]}
    if scene:
        inputs["style"] = [np.full((96, 128, 3), 128, np.uint8)]
    reds = [
        [part.reshape(-1, 3)[:, 0].mean() for part in (out[:, :, :40], out[:, :, 56:])]
        for out in (rendered(inputs, place_guide=weight) for weight in (0, 30))
    ]
    assert abs(reds[0][1] - reds[0][0]) < 60 < reds[1][1] - reds[1][0]


@pytest.mark.real("opencl")
@pytest.mark.parametrize(("transparency", "expected"), [("half", (200, 40, 40)), ("glaze", (164, 84, 84))])
def test_semi_transparent_paint_of_a_key_is_opaque_or_a_glaze(transparency: str, expected: tuple[int, ...]) -> None:
    """Red of opacity 0.5 over a gray frame of 128: the key's frame shows it exactly."""
    key = np.zeros((SIZE[1], SIZE[0], 4), np.uint8)
    key[20:50, 20:60] = (200, 40, 40, 128)
    out = rendered({"keyframes": {0: key}}, key_transparency=transparency)
    assert (out[0, 22:48, 22:58] == expected).all()


def test_the_random_search_of_the_paper_runs_in_every_round() -> None:
    searched = [
        [Rounds(4, 32.0, every=every).search((0, 0), index).search_px > 0 for index in range(4)]
        for every in (False, True)
    ]
    assert searched == [[True, False, True, False], [True] * 4]
