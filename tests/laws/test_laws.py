"""What is promised happens. A few hundred generated cases; `make laws` runs thousands."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from pipeline.frames import Frame
from pipeline.methods import method, methods
from pipeline.methods.local import LocalContext
from tests.laws import effects, members, ways
from tests.laws.__main__ import kept, verdict, verdicts
from tests.laws.cases import SEE_LEAD, WIDTH, Case, generated
from tests.laws.laws import LAWS, every_way_is_the_same, piece_is_film, preview_is_film
from tests.laws.stage import Layer, Stage, composited_film, half_of_film
from tests.laws.ways import Films
from tests.laws.wrong import FAULTS, everything_wrong_is_said, places
from workers.previews import film

PAINTED, SAID = 40, 300
LIKE_FILM = 2.0
"""Largest difference between a preview of half the size and the film, gray levels, see `half_of_film`."""


@pytest.mark.parametrize("seed", range(PAINTED))
def test_a_generated_case_keeps_the_laws(seed: int) -> None:
    assert verdicts(seed) == dict.fromkeys(LAWS), generated(seed)


@pytest.mark.parametrize(("law", "seed"), kept())
def test_a_case_that_once_broke_a_law_keeps_it(law: str, seed: int) -> None:
    assert verdict(law, seed) is None, generated(seed)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("name", sorted(methods()))
def test_a_preview_of_half_the_size_has_the_colours_of_the_film(name: str, seed: int) -> None:
    """Of analogy, only with keys that are painted everywhere: see "Sizes of previews" on its page."""
    case = _halved(name, seed)
    assert half_of_film(replace(case, inputs=("keyframes",)) if name == "analogy" else case, 3) < LIKE_FILM


def test_everything_wrong_is_said_in_one_list() -> None:
    broken = {seed: wrong for seed in range(SAID) if (wrong := everything_wrong_is_said(seed))}
    assert not broken
    assert places(iter(range(SAID))) == {fault.__name__ for fault in FAULTS}, "every kind of fault is tried"


@pytest.fixture(scope="module")
def unchanged() -> effects.Unchanged:
    return effects.Unchanged()


@pytest.mark.parametrize(("name", "parameter"), [*effects.parameters()])
def test_a_parameter_has_an_effect(name: str, parameter: str, unchanged: effects.Unchanged) -> None:
    assert effects.effect_of_parameter(name, parameter, unchanged) > 0


@pytest.mark.parametrize(("name", "given"), [*effects.inputs()])
def test_an_input_has_an_effect(name: str, given: str) -> None:
    assert effects.effect_of_input(name, given) > 0


@pytest.mark.parametrize(("name", "given", "path"), [*members.members()])
def test_a_member_of_a_document_has_an_effect(name: str, given: str, path: str) -> None:
    assert members.effect_of_member(name, given, path) > 0


# -- sabotage: the harness finds what is broken on purpose


def test_a_parameter_that_is_switched_off_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = LocalContext.__init__

    def without_relief(self: Any, params: Any, *args: Any, **kwargs: Any) -> None:
        honest(self, params.model_copy(update={"relief": 1.0}), *args, **kwargs)

    monkeypatch.setattr(LocalContext, "__init__", without_relief)
    assert effects.effect_of_parameter("multistyle", "relief", effects.Unchanged()) == 0


def test_a_key_that_is_one_frame_late_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    case = _keyed()
    assert piece_is_film(case, Films()) is None
    honest = LocalContext.images

    def late(self: LocalContext[Any], name: str) -> Any:
        found = honest(self, name)
        return {number + 1: image for number, image in found.items()} if self.video.is_piece else found

    monkeypatch.setattr(LocalContext, "images", late)
    assert "differs" in (piece_is_film(case, Films()) or "")


def test_a_key_that_the_stage_drops_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    case = _keyed()
    assert preview_is_film(case, Films()) is None
    honest = film.layer_inputs

    def without_the_last_key(*args: Any) -> dict[str, Any]:
        found = honest(*args)
        return {**found, "keyframes": dict(list(found["keyframes"].items())[:-1])}

    monkeypatch.setattr(film, "layer_inputs", without_the_last_key)
    assert "levels of difference" in (preview_is_film(case, Films()) or "")


def test_a_region_and_an_opacity_that_the_stage_drops_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case(3, "multistyle", {}, ("design",), 6, 0, (2, 4))
    shot = Stage([Layer(case, opacity=0.5)], WIDTH)
    whole = composited_film(shot.layers)
    assert ways.difference(shot.frames([3]), whole) == 0
    without_opacity = Stage([Layer(case)], WIDTH).frames([3])
    without_region = Stage([Layer(replace(case, inputs=()), opacity=0.5)], WIDTH).frames([3])
    assert all(ways.difference(broken, whole) > 1 for broken in (without_opacity, without_region))


def test_a_preview_of_half_the_size_that_ignores_a_parameter_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    case = _halved("multistyle", 1).with_params(saturation=-1.0)
    assert half_of_film(case, 3) < LIKE_FILM
    honest = LocalContext.__init__

    def coloured(self: Any, params: Any, video: Any, *args: Any, **kwargs: Any) -> None:
        small = not isinstance(video, list)
        honest(self, params.model_copy(update={"saturation": 0.0}) if small else params, video, *args, **kwargs)

    monkeypatch.setattr(LocalContext, "__init__", coloured)
    assert half_of_film(case, 3) > LIKE_FILM


def test_a_mask_that_is_dropped_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case(1, "abstraction", {}, ("importance",), 6, 0, (2, 4))
    assert every_way_is_the_same(case, Films()) is None
    honest = ways.Case.given
    monkeypatch.setattr(ways, "_library", lambda case: {k: v for k, v in honest(case).items() if k != "importance"})
    with_seed = [Case(seed, "abstraction", {}, ("importance",), 6, 0, (2, 4)) for seed in range(len(ways.WAYS))]
    found = [wrong for each in with_seed if (wrong := every_way_is_the_same(each, Films()))]
    assert found and all("differs" in wrong for wrong in found)


def _halved(name: str, seed: int) -> Case:
    """A case with the method's own parameters, whose film is large enough for strokes at half the size."""
    return replace(generated(seed, name), params={}, scale=4, frames=5, cut=0, piece=(0, 5))


def _keyed() -> Case:
    return Case(2, "analogy", {}, ("keyframes",), 6, 0, (2, 4))


def test_the_preroll_of_a_method_covers_its_memory() -> None:
    """What `is_exact` relies on: with the whole film before it, a piece has the film's bytes."""
    for name in ("abstraction", "multistyle"):
        case = Case(5, name, {"preroll": SEE_LEAD}, (), 8, 0, (5, 8))
        frames: dict[int, Frame] = ways.piece(case)
        assert ways.difference(frames, ways.film(case)) == 0, method(name).title
