"""What is promised happens. A few hundred generated cases; `make laws` runs thousands."""

from __future__ import annotations

from typing import Any

import pytest

from pipeline.frames import Frame
from pipeline.methods import method
from pipeline.methods.local import LocalContext
from tests.laws import effects, ways
from tests.laws.__main__ import kept, verdict
from tests.laws.cases import SEE_LEAD, Case, generated
from tests.laws.laws import LAWS, every_way_is_the_same, piece_is_film
from tests.laws.wrong import FAULTS, everything_wrong_is_said, places

PAINTED, SAID = 12, 300


@pytest.mark.parametrize("law", sorted(LAWS))
@pytest.mark.parametrize("seed", range(PAINTED))
def test_a_generated_case_keeps_the_law(law: str, seed: int) -> None:
    assert verdict(law, seed) is None, generated(seed)


@pytest.mark.parametrize(("law", "seed"), kept())
def test_a_case_that_once_broke_a_law_keeps_it(law: str, seed: int) -> None:
    assert verdict(law, seed) is None, generated(seed)


def test_everything_wrong_is_said_in_one_list() -> None:
    broken = {seed: wrong for seed in range(SAID) if (wrong := everything_wrong_is_said(seed))}
    assert not broken
    assert places(iter(range(SAID))) == {fault.__name__ for fault in FAULTS}, "every kind of fault is tried"


@pytest.mark.parametrize(("name", "parameter"), [*effects.parameters()])
def test_a_parameter_has_an_effect(name: str, parameter: str) -> None:
    assert effects.effect_of_parameter(name, parameter) > 0


@pytest.mark.parametrize(("name", "given"), [*effects.inputs()])
def test_an_input_has_an_effect(name: str, given: str) -> None:
    assert effects.effect_of_input(name, given) > 0


# -- sabotage: the harness finds what is broken on purpose


def test_a_parameter_that_is_switched_off_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = LocalContext.__init__

    def without_relief(self: Any, params: Any, *args: Any, **kwargs: Any) -> None:
        honest(self, params.model_copy(update={"relief": 1.0}), *args, **kwargs)

    monkeypatch.setattr(LocalContext, "__init__", without_relief)
    assert effects.effect_of_parameter("multistyle", "relief") == 0


def test_a_key_that_is_one_frame_late_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    case = _keyed()
    assert piece_is_film(case) is None
    honest = LocalContext.images

    def late(self: LocalContext[Any], name: str) -> Any:
        found = honest(self, name)
        return {number + 1: image for number, image in found.items()} if self.video.is_piece else found

    monkeypatch.setattr(LocalContext, "images", late)
    assert "differs" in (piece_is_film(case) or "")


def test_a_mask_that_is_dropped_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case(1, "abstraction", {}, ("importance",), 6, 0, (2, 4))
    assert every_way_is_the_same(case) is None
    honest = ways.Case.given
    monkeypatch.setattr(ways, "_library", lambda case: {k: v for k, v in honest(case).items() if k != "importance"})
    with_seed = [Case(seed, "abstraction", {}, ("importance",), 6, 0, (2, 4)) for seed in range(len(ways.WAYS))]
    found = [wrong for each in with_seed if (wrong := every_way_is_the_same(each))]
    assert found and all("differs" in wrong for wrong in found)


def _keyed() -> Case:
    return Case(2, "analogy", {}, ("keyframes",), 6, 0, (2, 4))


def test_the_preroll_of_a_method_covers_its_memory() -> None:
    """What `is_exact` relies on: with the whole film before it, a piece has the film's bytes."""
    for name in ("abstraction", "multistyle"):
        case = Case(5, name, {"preroll": SEE_LEAD}, (), 8, 0, (5, 8))
        frames: dict[int, Frame] = ways.piece(case)
        assert ways.difference(frames, ways.film(case)) == 0, method(name).title
