"""Regions corrected with a brush, and outlines of several parts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.errors import BadParameter
from pipeline.methods.local import Input, LocalContext, iterate_plan
from pipeline.methods.multistyle import Multistyle
from pipeline.methods.multistyle.design import parse
from pipeline.methods.multistyle.params import MultistyleParams

WIDTH, HEIGHT, STEP_PX = 96, 64, 2
LEFT = [[0, 0], [0.5, 0], [0.5, 1], [0, 1]]


def panning(frames: int = 12) -> list[NDArray[np.uint8]]:
    """A texture that moves to the right by STEP_PX a frame."""
    noise = np.random.default_rng(3).uniform(30, 220, (HEIGHT // 8 + 1, WIDTH // 4, 3)).astype(np.float32)
    wide = np.kron(noise, np.ones((8, 8, 1), np.float32))[:HEIGHT].astype(np.uint8)
    first = wide.shape[1] - WIDTH - 1
    return [np.ascontiguousarray(wide[:, first - STEP_PX * k : first - STEP_PX * k + WIDTH]) for k in range(frames)]


def region_maps(
    design: dict[str, Any], frames: int = 12, labels: NDArray[np.uint8] | None = None
) -> list[NDArray[np.uint8]]:
    """`labels`: a label map of frame 0."""
    inputs: dict[str, Input] = {"design": {"version": 1, **design}}
    if labels is not None:
        inputs["masks"] = {0: labels}
    context = LocalContext(MultistyleParams(), panning(frames), inputs, 0)
    for _ in iterate_plan(Multistyle(), context, steps=3):
        pass
    names = sorted(name for step, name in context.kept if step == "maps" and name.startswith("map-"))
    return [plane for name in names for plane in context.kept["maps", name]["maps"]]


def stroke(region: str, frame: int, x: float, y: float, width: float = 0.25) -> dict[str, Any]:
    return {"region": region, "frame": frame, "points": [[x, y]], "width": width}


def at(plane: NDArray[np.uint8], x: float, y: float) -> int:
    return int(plane[round(y * HEIGHT), round(x * WIDTH)])


def test_many_corrections_of_a_frame_hold_in_their_shot_along_the_motion() -> None:
    regions = {"left": {"polygons": [{"frame": 4, "points": LEFT}]}}
    strokes = [stroke("left", 4, 0.75, 0.3), stroke("left", 4, 0.75, 0.75), stroke("rest", 9, 0.3, 0.5)]
    plain, found = region_maps({"regions": regions}), region_maps({"regions": regions, "corrections": strokes})
    for k in range(12):
        moved = 0.75 + (k - 4) * STEP_PX / WIDTH
        assert at(plain[k], moved, 0.3) == at(plain[k], moved, 0.75) == 0
        assert at(found[k], moved, 0.3) == at(found[k], moved, 0.75) == 1, k
        gone = 0.3 + (k - 9) * STEP_PX / WIDTH
        assert (at(plain[k], gone, 0.5), at(found[k], gone, 0.5)) == (1, 0), k
    far = np.array([np.count_nonzero(one != other) for one, other in zip(plain, found, strict=True)])
    assert far.max() < 3.5 * (0.25 * HEIGHT) ** 2, "nothing else changes"


def test_a_later_stroke_of_a_frame_covers_an_earlier_one() -> None:
    regions = {"left": {"polygons": [{"frame": 0, "points": LEFT}]}}
    strokes = [stroke("left", 0, 0.75, 0.5, 0.4), stroke("rest", 0, 0.75, 0.5, 0.2)]
    (found, *_) = region_maps({"regions": regions, "corrections": strokes}, 2)
    assert at(found, 0.75, 0.5) == 0 and at(found, 0.75 + 0.15 * HEIGHT / WIDTH, 0.5) == 1


def test_two_outlines_of_one_frame_are_parts_of_a_region() -> None:
    small = [[0.7, 0.1], [0.9, 0.1], [0.9, 0.4], [0.7, 0.4]]
    regions = {"both": {"polygons": [{"frame": 0, "points": LEFT}, {"frame": 0, "points": small}]}}
    (found, *_) = region_maps({"regions": regions}, 2)
    assert at(found, 0.2, 0.5) == at(found, 0.8, 0.25) == 1 and at(found, 0.8, 0.8) == 0


def test_a_region_of_several_kinds_is_where_one_of_them_is() -> None:
    """An outline, an object that the segmentation has found, and a label."""
    labels = np.zeros((HEIGHT, WIDTH), np.uint8)
    labels[:8, 60:] = 7
    kinds: dict[str, dict[str, Any]] = {
        "drawn": {"polygons": [{"frame": 0, "points": LEFT}]}, "found": {"objects": [1]}, "labelled": {"label": 7},
    }  # fmt: skip
    alone = [region_maps({"regions": {name: kind}}, 6, labels) for name, kind in kinds.items()]
    whole = {name: value for kind in kinds.values() for name, value in kind.items()}
    for frame, found in enumerate(region_maps({"regions": {"all": whole}}, 6, labels)):
        parts = [maps[frame] > 0 for maps in alone]
        assert all((part & ~np.any(parts[:k] + parts[k + 1 :], axis=0)).any() for k, part in enumerate(parts))
        np.testing.assert_array_equal(found > 0, np.any(parts, axis=0))


@pytest.mark.parametrize(("change", "path"), [
    ({"region": "goose"}, "corrections[0].region"), ({"frame": 12}, "corrections[0].frame"),
    ({"width": 0}, "corrections[0].width"), ({"points": []}, "corrections[0].points"),
])  # fmt: skip
def test_a_wrong_correction_is_named(change: dict[str, Any], path: str) -> None:
    document = {"version": 1, "corrections": [stroke("rest", 0, 0.5, 0.5) | change]}
    with pytest.raises(BadParameter) as caught:
        parse(document, frames=12)
    assert caught.value.field == f"inputs.design.{path}"
