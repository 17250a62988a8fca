"""Values over time: each frame is painted with the values of its number, on every way, or they are refused by name."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from pipeline.errors import BadParameter
from pipeline.methods import method
from tests.laws import ways
from tests.laws.cases import SEE_LEAD, Case, generated, properties_of
from tests.laws.ways import difference
from workers.live.sessions import LiveSessions

FRAMES = 8
REACT = 0.75
"""Largest rest of the difference of two constant renders, three frames after the jump from one value to the other, of
methods with a memory."""
SHOWN: dict[str, tuple[str, dict[str, Any], tuple[str, ...], bool]] = {
    "abstraction": ("line_opacity", {}, (), True),
    "analogy": ("guide_weight", {"temporal": "off", "levels": 2}, ("style_output",), True),
    "multistyle": ("saturation", {}, (), True),
    "patches": ("misfit", {"temporal": "on"}, (), False),
    "steady": ("strength", {}, ("styled",), False),
}
"""Method -> a number that varies, with further parameters and inputs, and whether a frame depends on its own
value only."""


def case_of(name: str, scale: int = 1) -> tuple[Case, str, bool]:
    shown, params, inputs, alone = SHOWN[name]
    small = replace(generated(3, name), params=params, inputs=inputs, frames=FRAMES, cut=0, piece=(3, 6), light=1.0)
    return replace(small, scale=scale), shown, alone


@pytest.mark.parametrize("name", sorted(SHOWN))
def test_the_ends_of_a_film_have_the_values_of_its_ends(name: str) -> None:
    case, shown, alone = case_of(name, scale=4 if name == "patches" else 1)
    field = properties_of(case.chosen)[shown]
    low, high = field["minimum"], field["maximum"]
    first, last = (ways.film(case.with_params(**{shown: value})) for value in (low, high))
    found = ways.film(case.with_params(**{shown: [[3, low], [4, high]]}))
    end = FRAMES - 1
    apart = difference({end: first[end]}, {end: last[end]})
    assert apart > 0.2
    if name != "patches":  # a patch has one painting for all its frames
        assert all(difference({number: found[number]}, first) == 0 for number in range(4))
    rest = difference({end: found[end]}, last)
    assert rest == 0 if alone else rest < REACT * apart


@pytest.mark.parametrize("name", sorted(SHOWN))
def test_all_numbers_at_once_follow_the_film_on_every_way(name: str) -> None:
    case, _, _ = case_of(name)
    fields = {one: properties_of(case.chosen)[one] for one in case.chosen.Params.varying()}
    usual = {one: field["default"] for one, field in fields.items()}
    flat = {one: [[0, value], [5, value]] for one, value in usual.items()}
    plain = ways.film(case.with_params(**usual))
    assert difference(plain, ways.film(case.with_params(**flat))) == 0, "keys of one value are that value"
    moving = case.with_params(**{
        one: [[1, value], [6, (value + fields[one]["maximum"]) / 2]] for one, value in usual.items()
    })  # fmt: skip
    film = ways.film(moving)
    assert difference(plain, film) > 0.2
    for way in (ways.shuffled, ways.layer, ways.iterator):
        assert difference(film, way(moving)) == 0, way.__name__
    if "preroll" in case.chosen.Params.model_fields:
        assert difference(ways.piece(moving.with_params(preroll=SEE_LEAD)), film) == 0


@pytest.mark.parametrize("name", ["abstraction", "multistyle", "steady"])
def test_a_live_session_refuses_values_over_time(name: str) -> None:
    for one in method(name).Params.varying():
        low = properties_of(method(name))[one]["minimum"]
        with pytest.raises(BadParameter) as refused:
            LiveSessions.params(name, {one: [[0, low]]})
        assert refused.value.field == f"params.{one}" and "one number" in refused.value.remedy
