"""Passes of every method: all that it names, of every frame, without a change of the film, and true."""

from __future__ import annotations

from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.arrays import State
from pipeline.frames import Frame
from pipeline.methods import method, methods
from pipeline.methods.abstraction import plan as abstraction_plan
from pipeline.methods.local import LocalContext, required_inputs, run_plan
from pipeline.passes.pass_archive import PassArchive
from pipeline.scenes import scene

SIZE = 128, 96
COUNT = 7
QUICK: dict[str, dict[str, Any]] = {"analogy": {"levels": 2, "iterations": 1}}
MAKERS = [name for name, chosen in methods().items() if chosen.makes_passes]


@cache
def shots() -> tuple[Frame, ...]:
    """Two shots of one camera move over a still picture, 2 px a frame to the left."""
    wide = next(iter(scene("harbour", (SIZE[0] + 40, SIZE[1]), 1))).image
    one = [np.ascontiguousarray(wide[:, 2 * k : 2 * k + SIZE[0]]) for k in range(COUNT - 2)]
    return (*one, *(np.ascontiguousarray(255 - frame[::-1]) for frame in one[:2]))


@cache
def made(name: str, wanted: frozenset[str]) -> tuple[dict[int, State], list[bytes]]:
    """Passes by frame, and the film."""
    chosen = method(name)
    params = chosen.Params(**QUICK.get(name, {}))
    context = LocalContext(params, list(shots()), required_inputs(chosen, list(shots())))
    context.passes_wanted = wanted
    run_plan(chosen, context)
    return context.made_passes, [context.emitted[index].tobytes() for index in range(COUNT)]


def passes(name: str) -> dict[int, State]:
    return made(name, frozenset(one.name for one in method(name).makes_passes))[0]


@pytest.mark.parametrize("name", MAKERS)
def test_every_pass_of_every_frame_fits_its_description(name: str, tmp_path: Any) -> None:
    described = method(name).makes_passes
    assert {"flow"} <= {one.name for one in described} and len({one.name for one in described}) == len(described)
    found = passes(name)
    assert sorted(found) == list(range(COUNT))
    archive = PassArchive(tmp_path / "a", described, "", SIZE)
    for index in range(COUNT):
        assert sorted(found[index]) == sorted(one.name for one in described)
        assert all(np.isfinite(array).all() for array in found[index].values())
        archive.add(index, found[index])  # refuses what does not fit
    archive.close()


@pytest.mark.parametrize("name", MAKERS)
def test_passes_do_not_change_the_film_and_come_one_by_one(name: str) -> None:
    film = made(name, frozenset())
    assert film[0] == {}
    assert made(name, frozenset(one.name for one in method(name).makes_passes))[1] == film[1]
    alone, _ = made(name, frozenset({"flow"}))
    assert all(list(alone[index]) == ["flow"] for index in range(COUNT))
    assert all((alone[index]["flow"] == passes(name)[index]["flow"]).all() for index in range(COUNT))


@pytest.mark.parametrize("name", MAKERS)
def test_the_flow_leads_back_to_the_previous_frame(name: str) -> None:
    """The picture moves 2 px to the left, so a pixel comes from 2 px to its right; a shot begins without motion."""
    found = passes(name)
    for index in (0, COUNT - 2):
        assert not found[index]["flow"].any()
    for index in (2, 3, 4):
        flow = cv2.resize(found[index]["flow"], SIZE, interpolation=cv2.INTER_LINEAR)
        moving = np.abs(shots()[index].astype(int) - shots()[index - 1]).max(axis=2) > 20
        assert np.median(flow[moving][:, 0]) == pytest.approx(2, abs=0.3), name
        x, y = np.meshgrid(*(np.arange(side, dtype=np.float32) for side in SIZE))
        warped = cv2.remap(shots()[index - 1], x + flow[..., 0], y + flow[..., 1], cv2.INTER_LINEAR,
                           borderMode=cv2.BORDER_REPLICATE)  # fmt: skip
        moved, still = (
            np.abs(one.astype(float) - shots()[index])[:, :-4].mean() for one in (warped, shots()[index - 1])
        )
        assert moved < 0.4 * still, (name, index, moved, still)


def followed(found: dict[int, State], name: str, index: int) -> float:
    """Share of pixels whose number is that of the place where they were in the previous frame."""
    now, before = found[index][name], found[index - 1][name]
    scale = SIZE[0] // now.shape[1]
    return float((now[:, : -2 // scale] == before[:, 2 // scale :]).mean())


@pytest.mark.parametrize(
    ("name", "numbers", "least"),
    [("abstraction", "labels", 0.8), ("multistyle", "stroke-ids", 0.5), ("multistyle", "tubes", 0.8),
     ("patches", "labels", 0.8), ("patches", "patches", 0.8), ("patches", "stroke-ids", 0.5)],
)  # fmt: skip
def test_numbers_move_with_the_picture_and_end_with_the_shot(name: str, numbers: str, least: float) -> None:
    found = passes(name)
    assert followed(found, numbers, 3) > least
    assert found[3][numbers].max() > 0
    if numbers in ("stroke-ids", "patches"):
        first, second = (set(np.unique(found[index][numbers])) - {0} for index in (3, COUNT - 1))
        assert not first & second


def test_abstraction_makes_the_maps_of_figures_3_and_8(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few pixels are left in a shot, all at a cut; the filtered labels are those of the previous frame."""
    found = passes("abstraction")
    assert (found[0]["residual"] == 1).all() and (found[COUNT - 2]["residual"] == 1).all()
    assert not found[COUNT - 2]["propagated"].any()
    assert 0 < found[3]["residual"].mean() < 0.3
    assert set(np.unique(found[3]["propagated"])) - {0} <= set(np.unique(found[2]["labels"]))
    ink = found[3]["lines"]
    assert 0 < ink.mean() < 0.5 and ink.max() <= 1
    monkeypatch.setattr(abstraction_plan, "RUN_FRAMES", 2)
    made.cache_clear()
    again = passes("abstraction")
    made.cache_clear()
    assert all((again[k][name] == found[k][name]).all() for k in found for name in found[k]), "other tasks, same bytes"


def test_explicit_strokes_have_numbers_and_layers_without_a_change_of_the_film() -> None:
    chosen, films, found = method("multistyle"), [], {}
    for wanted in (frozenset[str](), frozenset({"stroke-ids", "layers"})):
        context = LocalContext(chosen.Params(renderer="explicit", stroke_size=3), list(shots()), {})
        context.passes_wanted = wanted
        run_plan(chosen, context)
        films.append([context.emitted[index].tobytes() for index in range(COUNT)])
        found = context.made_passes
    assert films[0] == films[1] and sorted(found) == list(range(COUNT))
    shares, numbers = found[3]["layers"], found[3]["stroke-ids"]
    assert shares.min() >= 0 and shares.sum(axis=2).max() < 1 + 1e-5 and (shares.max(axis=(0, 1))[:3] > 0.5).all()
    assert (numbers > 0).mean() > 0.9 and len(np.unique(numbers)) > 100
    assert followed(found, "stroke-ids", 3) > 0.5
    assert not set(np.unique(numbers)) & set(np.unique(found[COUNT - 1]["stroke-ids"])) - {0}


def test_layers_of_strokes_share_the_pixel() -> None:
    shares = passes("multistyle")[3]["layers"]
    assert shares.min() > -1e-5 and shares.sum(axis=2).max() < 1 + 1e-5 and shares.sum(axis=2).mean() > 0.5
    orientation = passes("multistyle")[3]["orientation"]
    assert np.allclose((orientation**2).sum(axis=2), 1, atol=1e-4)


def test_steady_knows_what_was_uncovered() -> None:
    occlusion = passes("steady")[3]["occlusion"]
    assert occlusion[:, -2:].mean() > 0.9 > 0.5 > np.median(occlusion[:, :-8])


def test_positions_of_patches_move_with_the_picture() -> None:
    """The painting of a patch moves with it: a pixel keeps its place in it."""
    before, now = passes("patches")[2], passes("patches")[3]
    same = (now["patches"][:, :-2] == before["patches"][:, 2:]) & (now["patches"][:, :-2] > 0)
    drift = np.abs(now["positions"][:, :-2] - before["positions"][:, 2:])[same]
    assert same.mean() > 0.5 and np.median(drift) < 0.5


def test_directions_of_analogy_run_along_edges() -> None:
    found = passes("analogy")[3]["orientation"]
    length = np.hypot(found[..., 0], found[..., 1])
    assert (np.isclose(length, 1, atol=1e-5) | (length == 0)).all() and (length > 0).mean() > 0.5
    gray = cv2.GaussianBlur(cv2.cvtColor(shots()[3], cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 2)
    slope = np.dstack([cv2.Sobel(gray, cv2.CV_32F, *way) for way in ((1, 0), (0, 1))])
    steep = (np.hypot(slope[..., 0], slope[..., 1]) > 60) & (length > 0)
    across = np.abs((found * slope).sum(-1))[steep] / np.hypot(slope[..., 0], slope[..., 1])[steep]
    assert steep.sum() > 200 and np.median(across) < 0.3


def test_positions_of_analogy_are_places_of_the_painting() -> None:
    found = passes("analogy")[3]["positions"]
    assert (
        found.min() >= -0.5 and found.max() < max(SIZE) and len(np.unique(np.rint(found).reshape(-1, 2), axis=0)) > 500
    )
