"""Transforms between frames: exact motions come back, and moved regions cover those of the next frame."""

import io
import math
import zipfile
from itertools import pairwise
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.methods.abstraction import Abstraction, AbstractionParams
from pipeline.methods.local import LocalContext, run_plan
from pipeline.scenes import scene
from pipeline.vector.outlines import Outlines
from pipeline.vector.transforms import outline_transforms, region_transforms, scaled
from tests.pipeline.vector.test_svg import SVG, blobs, polygons

SIZE = 240, 136


def moved_labels(matrix: NDArray[np.float64], size: tuple[int, int] = (120, 90)) -> tuple[NDArray[np.int32], ...]:
    """Label maps before and after an affine motion (2, 3) about the middle of pixels, and the motion at each pixel
    after it."""
    before = blobs(size, sigma=12)
    back = np.linalg.inv(np.vstack([matrix, [0, 0, 1]]))[:2]
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    origin = np.stack([x, y, np.ones_like(x)], -1) @ back.T
    now = cv2.remap(before.astype(np.float32), *(origin - 0.5).astype(np.float32).transpose(2, 0, 1),
                    cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE).astype(np.int32)  # fmt: skip
    return before, now, (np.stack([x, y], -1) - origin).astype(np.float32)


TURN = np.array([[math.cos(0.05), -math.sin(0.05), 3.0], [math.sin(0.05), math.cos(0.05), -1.5]])


@pytest.mark.parametrize("matrix", [np.array([[1, 0, 2.5], [0, 1, -1.0]]), TURN], ids=["shift", "turn"])
def test_an_exact_motion_comes_back(matrix: NDArray[np.float64]) -> None:
    before, now, flow = moved_labels(matrix)
    found = region_transforms(now, before, np.arange(10, dtype=np.int32), flow)
    assert np.isnan(found[0]).all()
    for label in range(1, 10):
        middle = np.append(np.argwhere(now == label).mean(axis=0)[::-1] + 0.5, 1)
        assert np.abs(found[label] @ middle - matrix @ middle).max() < 0.05
        assert np.abs(found[label, :, :2] - matrix[:, :2]).max() < 0.02


def test_a_new_region_has_no_motion_and_a_small_one_only_moves() -> None:
    before, now = np.ones((40, 40), np.int32), np.ones((40, 40), np.int32)
    before[10:12, 10:12] = now[10:12, 11:13] = 2
    now[30:35, 30:35] = 3
    flow = np.zeros((40, 40, 2), np.float32)
    flow[10:12, 11:13] = [[[1.4, 0], [0.6, 0]]]
    found = region_transforms(now, before, np.array([0, 1, 2, 0], np.int32), flow)
    assert np.isnan(found[3]).all()
    assert found[2, 0, 0] == pytest.approx(1, abs=0.05), "errors of the flow stretch it by 0.8 px in 1"
    assert (found[2] @ [11, 11, 1] - [12, 11]) == pytest.approx(0, abs=0.05)


def test_lines_move_with_the_flow_at_another_size() -> None:
    flow = np.full((45, 60, 2), (1.5, -0.5), np.float32)
    points = np.array([[10.0, 10], [50, 12], [50, 14], [10, 12], [10, 10]])
    none = np.zeros(1, np.int32)
    found = outline_transforms(Outlines(points, np.array([0, 5]), none, none, none > 0), flow, (2.0, 2.0))
    assert np.allclose(found, [[[1, 0, 3], [0, 1, -1]]], atol=1e-6)


def test_scaled_maps_move_scaled_points() -> None:
    point, scale = np.array([7.0, 5]), np.array([2.0, 3])
    moved = TURN @ [*point, 1]
    assert np.allclose(scaled(TURN[None], (2.0, 3.0))[0] @ [*(point * scale), 1], moved * scale)


# -- from the documents themselves


def fill(path: str, matrix: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.bool_]:
    """The pixels of an SVG path that a transform has moved."""
    shapes = [(polygon / 10) @ matrix[:, :2].T + matrix[:, 2] for polygon in polygons(path, steps=4)]
    canvas = np.zeros(size[::-1], np.uint8)
    cv2.fillPoly(canvas, [np.rint((shape - 0.5) * 16).astype(np.int32) for shape in shapes], 1, shift=4)
    return canvas > 0


def matrix_of(text: str) -> NDArray[np.float64]:
    return np.array(text.removeprefix("matrix(").removesuffix(")").split(), float).reshape(3, 2).T


def overlaps(pages: list[bytes]) -> tuple[float, float]:
    """Mean intersection over union, by area, of regions with those of the next frame: moved, and as they are."""
    sums = np.zeros(3)
    still = np.eye(2, 3)
    drawn = [{e.attrib.get("id", ""): e.attrib for e in ElementTree.fromstring(page).iter(f"{SVG}path")}
             for page in pages]  # fmt: skip
    for before, now in pairwise(drawn):
        for name in (before.keys() & now.keys()) - {""}:
            if (told := now[name].get("data-from-previous")) is None:
                continue
            target = fill(now[name]["d"], still, SIZE)
            for k, matrix in enumerate((matrix_of(told), still)):
                moved = fill(before[name]["d"], matrix, SIZE)
                sums[k] += target.sum() * (moved & target).sum() / max((moved | target).sum(), 1)
            sums[2] += target.sum()
    return sums[0] / sums[2], sums[1] / sums[2]


def panned(count: int, step: tuple[float, float], turn: float) -> list[Frame]:
    """A still picture under a camera that moves by `step` px and turns by `turn` degrees a frame."""
    whole = next(iter(scene("harbour", (SIZE[0] * 2, SIZE[1] * 2), 1))).image
    made = []
    for k in range(count):
        matrix = cv2.getRotationMatrix2D((SIZE[0], SIZE[1]), turn * k, 1.0)
        matrix[:, 2] += np.array([-SIZE[0] / 2 + step[0] * k, -SIZE[1] / 2 + step[1] * k])
        made.append(np.asarray(cv2.warpAffine(whole, matrix, SIZE, flags=cv2.INTER_LINEAR), np.uint8))
    return made


def test_moved_regions_cover_those_of_the_next_frame() -> None:
    context = LocalContext(AbstractionParams(), panned(5, (3.2, 1.1), 1.0), artefacts=frozenset({"svg"}))
    run_plan(Abstraction(), context)
    with zipfile.ZipFile(io.BytesIO(*context.files.values())) as archive:
        pages = [archive.read(name) for name in sorted(archive.namelist())]
    assert b"data-from-previous" not in pages[0]
    moved, still = overlaps(pages)
    assert moved > 0.85 and 1 - moved < 0.6 * (1 - still), (moved, still)
    lines = next(group for group in ElementTree.fromstring(pages[2]) if group.attrib["id"] == "lines")
    assert all("data-from-previous" in line.attrib for line in lines)
