"""Multistyle: directions of everything else are those of the film in a preview; objects of many tubes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.methods import method, parse_params
from pipeline.methods.base import PreviewRequest
from pipeline.methods.local import LocalContext, run_plan
from pipeline.methods.multistyle import tubes
from pipeline.methods.multistyle.design import followed, parse
from pipeline.methods.multistyle.preview import preview_frame
from tests.pipeline.methods.frames import painted

SIZE, FRAMES = (160, 96), 8


def moving_box(index: int) -> np.ndarray:
    mask = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    mask[10:40, 10 + 14 * index : 40 + 14 * index] = 1
    return mask


def design(region: str) -> dict[str, Any]:
    element = {"pattern": "center", "at": [0.4, 0.6]}
    return {
        "version": 1,
        "regions": {"box": {"label": 1}},
        "keys": [],
        "directions": [{"region": region, "frame": 0, "edge_weight": 0.1, "elements": [element]}],
    }


@pytest.mark.parametrize("region", ["rest", "box"])
def test_directions_of_a_preview_are_those_of_the_film(region: str) -> None:
    """A box moves to the right: elements of the box follow it, those of everything else stay."""
    frames = [np.where(moving_box(k)[..., None] > 0, np.uint8(200), np.uint8(90)).repeat(3, 2) for k in range(FRAMES)]
    masks = {k: moving_box(k) for k in range(FRAMES)}
    chosen, values = method("multistyle"), {"temporal": "off", "style": "impressionism"}
    context = LocalContext(parse_params(chosen, values), frames, {"design": design(region), "masks": masks})
    run_plan(chosen, context)
    request = PreviewRequest(
        parse_params(chosen, values), 0, frames[-1:], FRAMES - 1, FRAMES, {"design": design(region)}, {"masks": masks}
    )
    np.testing.assert_array_equal(preview_frame(request), painted(context)[-1])


def test_elements_of_everything_else_follow_nothing() -> None:
    assert followed(parse(design("box"))) == [("box", 0)]
    assert followed(parse(design("rest"))) == []


# -- tubes


Sums = dict[int, np.ndarray]
Touch = dict[tuple[int, int], int]


def statistics(count: int, hub: bool) -> tuple[Sums, Touch]:
    rng = np.random.default_rng(count)
    sums = {}
    for k in range(1, count + 1):
        area = int(rng.integers(100, 5000))
        sums[k] = np.array([area, *rng.integers(0, 255, 3) * area, *rng.integers(-32, 32, 2) * area])
    touch = {(1, k): int(rng.integers(1, 300)) for k in range(2, count + 1)} if hub else {}
    for k in range(2, count + 1):
        for other in rng.integers(1, k, 2).tolist():
            touch[other, k] = int(rng.integers(1, 300))
    return sums, touch


def greedy(sums: Sums, touch: Touch, scale: float, objects: int) -> dict[int, int]:
    """The specification: the cheapest of all pairs is merged."""
    owner = {name: name for name in sums}
    total = {name: own.astype(float) for name, own in sums.items()}
    border = dict(touch)

    def cost(pair: tuple[int, int]) -> float:
        a, b = (total[name][0] for name in pair)
        one, other = (np.array([*total[n][1:4], *total[n][4:6] / 16 * scale]) / total[n][0] for n in pair)
        return a * b / (a + b) * (((one - other) ** 2).sum() + 4) / border[pair]

    while len(total) > objects and border:
        a, b = min(border, key=lambda pair: (cost(pair), pair))
        total[a] = total[a] + total.pop(b)
        for name, group in owner.items():
            owner[name] = a if group == b else group
        joined: Touch = {}
        for (one, other), length in border.items():
            first, second = sorted(a if name == b else name for name in (one, other))
            pair = first, second
            if first != second:
                joined[pair] = joined.get(pair, 0) + length
        border = joined
    return owner


@pytest.mark.parametrize("hub", [False, True])
def test_tubes_are_merged_by_the_cheapest_pair(hub: bool) -> None:
    sums, touch = statistics(60, hub)
    assert tubes._merged(sorted(sums), sums, touch, 2.0, 7) == greedy(sums, touch, 2.0, 7)


@pytest.mark.parametrize("hub", [False, True])
def test_the_work_of_merging_grows_with_the_number_of_tubes(hub: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Costs of few clusters are computed anew after a merge, also where one tube touches all others."""
    counted = 0
    costs = tubes._Clusters._costs

    def recorded(*args: Any) -> Any:
        nonlocal counted
        counted += 1
        return costs(*args)

    monkeypatch.setattr(tubes._Clusters, "_costs", recorded)
    sums, touch = statistics(1500, hub)
    tubes._merged(sorted(sums), sums, touch, 2.0, 8)
    assert counted < 12 * len(sums)


def test_a_tube_continues_only_those_that_ended_shortly_before() -> None:
    def row(first: int, last: int) -> list[Any]:
        area = 9000 * (last - first + 1)
        return [first, last, [area, 100 * area, 0, 0, 0, 0], [50.0, 50.0, 9000], [50.0, 50.0, 9000]]

    rows = {str(k): row(100 * k, 100 * k + 40) for k in range(1, 400)} | {"400": row(39945, 39950)}
    found = tubes.tubes_of([{"tubes": rows, "touch": {}}], [(0, 40000)], 180)
    assert [tube.ids for tube in found[-2:]] == [(398,), (399, 400)]
