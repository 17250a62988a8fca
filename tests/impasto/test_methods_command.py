"""`impasto methods` prints the content of a method's schema, in every form that pydantic writes."""

from __future__ import annotations

import json
from enum import StrEnum
from types import SimpleNamespace
from typing import Annotated, Literal

import pytest
from pydantic import Field

from impasto.cli import methods as command
from impasto.cli.app import run
from pipeline.methods import methods as registry
from pipeline.methods.base import Params


class Kind(StrEnum):
    SOFT = "soft"
    HARD = "hard"


class Sample(Params):
    sigma_px: float = Field(1.5, gt=0, le=9, description="How soft.", json_schema_extra={"unit": "px", "symbol": "σ"})
    count: Annotated[int, Field(ge=2)] = 3
    small: float = Field(0.1, lt=1)
    lines: Literal["off", "on"] = "on"
    kind: Kind = Kind.SOFT
    limit: float | None = Field(None, ge=0, le=1)
    loud: bool = True


def rows() -> dict[str, dict[str, object]]:
    return {row["name"]: row for row in command.parameters(SimpleNamespace(Params=Sample))}


@pytest.mark.parametrize(
    ("name", "kind", "allowed", "default"),
    [
        ("sigma_px", "number", "more than 0 to 9", 1.5),
        ("count", "integer", "2 or more", 3),
        ("small", "number", "less than 1", 0.1),
        ("lines", "choice", "off, on", "on"),
        ("kind", "choice", "soft, hard", "soft"),
        ("limit", "number", "0 to 1", None),
        ("loud", "boolean", "", True),
    ],
)
def test_a_parameter_is_listed_with_type_range_and_default(name: str, kind: str, allowed: str, default: object) -> None:
    row = rows()[name]
    assert (row["type"], row["range"], row["default"]) == (kind, allowed, default)


def test_unit_and_symbol_are_listed() -> None:
    row = rows()["sigma_px"]
    assert (row["unit"], row["symbol"], row["help"]) == ("px", "σ", "How soft.")


def test_every_method_is_listed_with_every_parameter(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["methods", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert [each["name"] for each in listed] == list(registry())
    for each in listed:
        assert [row["name"] for row in each["params"]] == list(registry()[each["name"]].Params.model_fields)
        assert all(row["help"] for row in each["params"])


@pytest.mark.parametrize("name", list(registry()))
def test_every_method_can_be_explained(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["methods", name]) == 0
    text = capsys.readouterr().out
    assert all(parameter in text for parameter in registry()[name].Params.model_fields)


def test_the_error_of_an_unknown_method_names_the_known_ones(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["methods", "oil"]) == 2
    assert "abstraction" in capsys.readouterr().err
