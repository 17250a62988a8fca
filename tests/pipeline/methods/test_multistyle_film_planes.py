"""What the studio reads of a film: where the elements of a design are in a frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Arrays
from pipeline.methods.base import Task, TaskResult
from pipeline.methods.local import LocalContext, run_plan
from pipeline.methods.multistyle import Multistyle
from pipeline.methods.multistyle.film_planes import film_plane
from pipeline.methods.multistyle.params import MultistyleParams

WIDTH, HEIGHT, FRAMES, STEP_PX = 96, 64, 8, 4
LEFT = 10
"""Left side of the moving square in frame 0, px; its side is 20 px."""


class Film:
    """The tasks of a film that was painted in memory."""

    def __init__(self, directions: list[dict[str, Any]]) -> None:
        frames = [np.random.default_rng(k).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8) for k in range(FRAMES)]
        masks = {k: np.zeros((HEIGHT, WIDTH), np.uint8) for k in range(FRAMES)}
        for k, mask in masks.items():
            mask[20:40, LEFT + STEP_PX * k : LEFT + STEP_PX * k + 20] = 1
        design = {"version": 1, "regions": {"box": {"label": 1}}, "directions": directions}
        params = MultistyleParams(cut_sensitivity=0)
        self.context = LocalContext(params, frames, {"design": design, "masks": masks})
        self._tasks = run_plan(Multistyle(), self.context)

    def tasks(self, step: str) -> Mapping[str, Task]:
        return {task.key: task for task in self._tasks[step]}

    def results(self, step: str) -> Mapping[str, TaskResult]:
        return self.context.results[step]

    def load(self, step: str, key: str, name: str) -> Arrays:
        return self.context.kept[step, name]


def element(x_px: float, **more: Any) -> dict[str, Any]:
    return {"pattern": "center", "at": [x_px / WIDTH, 30 / HEIGHT], "reach": 0.5, "strength": 2, **more}


def moved(film: Film, frame: int) -> Mapping[str, Any]:
    found = film_plane("directions", frame, film)
    assert found is not None
    return found.moved


def test_elements_are_where_the_film_has_them() -> None:
    own = {"region": "box", "frame": 2, "edge_weight": 0.1, "elements": [element(LEFT + 2 * STEP_PX + 10)]}
    still = {"region": "rest", "frame": 0, "elements": [element(70, angle=30, reach="everywhere")]}
    film = Film([own, still])
    for frame in (0, 2, 7):
        found = moved(film, frame)
        (box,), (rest,) = found["box"]["elements"], found["rest"]["elements"]
        assert box["at"] == pytest.approx([(LEFT + STEP_PX * frame + 10) / WIDTH, 30 / HEIGHT], abs=1e-3)
        assert (box["reach"], box["strength"], found["box"]["edge_weight"]) == (0.5, 2, 0.1)
        assert rest["at"] == pytest.approx([70 / WIDTH, 30 / HEIGHT], abs=1e-3) and (rest["angle"], rest["reach"]) == (
            30,
            0,
        )


def test_between_two_keys_elements_are_between_them() -> None:
    keys = [
        {"region": "rest", "frame": 0, "edge_weight": 0.0, "elements": [element(20, angle=170)], "ease": "in"},
        {"region": "rest", "frame": 4, "edge_weight": 0.8, "elements": [element(60, angle=-170)]},
        {"region": "rest", "frame": 6, "elements": [element(60, pattern="node")]},
    ]
    film = Film(keys)
    rest = moved(film, 2)["rest"]
    (found,) = rest["elements"]
    assert found["at"][0] * WIDTH == pytest.approx(25, abs=0.01), "an eighth of the way"
    assert (found["angle"], rest["edge_weight"]) == (172.5, 0.1)
    assert moved(film, 5)["rest"]["elements"] == moved(film, 4)["rest"]["elements"], "other patterns: the key before"
