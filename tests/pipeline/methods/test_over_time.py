"""Numbers with values over time: what is accepted, and the value of each frame."""

from __future__ import annotations

from typing import Any

import jsonschema
import pytest

from pipeline.errors import BadParameter
from pipeline.methods import method, methods, parse_params
from pipeline.methods.fields import Params, varying
from pipeline.methods.over_time import Keys, largest

KEYS = [[10, 1.0], [20, 3.0], [21, 0.0]]


class Toy(Params):
    amount: float = varying(1, 0, 3, "Amount", "What it does, in words.", "ratio", "Toys")


@pytest.mark.parametrize(("frame", "value"), [(0, 1), (10, 1), (12, 1.4), (15, 2), (20, 3), (21, 0), (9_000_000, 0)])
def test_values_are_linear_between_keys_and_constant_outside(frame: int, value: float) -> None:
    assert Toy.model_validate({"amount": KEYS}).at(frame).amount == pytest.approx(value, abs=1e-12)


def test_a_key_has_its_value_exactly_and_numbers_stay_as_they_are() -> None:
    keys = Keys([(0, 0.1), (7, 0.7)])
    assert [keys.at(0), keys.at(7), keys.at(8)] == [0.1, 0.7, 0.7]
    assert (largest(keys), largest(0.3)) == (0.7, 0.3)
    plain = Toy(amount=2)
    assert plain.at(5) is plain and plain.over_time == {}


def test_parameters_with_keys_survive_the_way_to_a_job_and_back() -> None:
    toy = Toy.model_validate({"amount": KEYS})
    dumped = toy.model_dump(mode="json")
    assert dumped == {"amount": KEYS} and Toy.model_validate(dumped) == toy == Toy.model_validate(toy.model_dump())
    assert toy != Toy(amount=1) and hash(toy) != hash(Toy(amount=1))
    jsonschema.validate(dumped, Toy.model_json_schema())


@pytest.mark.parametrize(
    ("value", "field", "remedy"),
    [
        ([[5, 1], [5, 0.5]], "params.vividness", "Sort the keys"),
        ([[5, 1], [2, 0.5]], "params.vividness", "Sort the keys"),
        ([[0, 1], [5, 3.5]], "params.vividness.1.1", "impasto methods abstraction"),
        ([[0, 1], [-1, 1]], "params.vividness.1.0", "impasto methods abstraction"),
        ([[0.5, 1]], "params.vividness.0.0", "impasto methods abstraction"),
        ([[0, 1, 2]], "params.vividness.0", "impasto methods abstraction"),
        ([[0, float("nan")]], "params.vividness.0.1", "impasto methods abstraction"),
        ([], "params.vividness", "impasto methods abstraction"),
        ([[frame, 1] for frame in range(1001)], "params.vividness", "impasto methods abstraction"),
    ],
)
def test_wrong_keys_are_refused_with_their_place(value: Any, field: str, remedy: str) -> None:
    with pytest.raises(BadParameter) as refused:
        parse_params(method("abstraction"), {"vividness": value})
    assert refused.value.field == field and remedy in refused.value.remedy


@pytest.mark.parametrize(("name", "parameter"), [("abstraction", "line_width"), ("steady", "look_ahead")])
def test_a_number_that_cannot_vary_says_which_can(name: str, parameter: str) -> None:
    with pytest.raises(BadParameter) as refused:
        parse_params(method(name), {parameter: [[0, 1]]})
    assert refused.value.field == f"params.{parameter}"
    assert all(other in refused.value.remedy for other in method(name).Params.varying())


@pytest.mark.parametrize("name", sorted(methods()))
def test_the_schema_says_which_numbers_vary_and_accepts_their_keys(name: str) -> None:
    chosen = method(name)
    schema = chosen.Params.model_json_schema()
    names = chosen.Params.varying()
    assert names == tuple(key for key, field in schema["properties"].items() if field.get("varies"))
    for one in names:
        low = schema["properties"][one]["minimum"]
        jsonschema.validate({one: [[0, low], [5, low]]}, schema)
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate({one: [[0, low - 1]]}, schema)
