"""The registry: a method = a file and a row here, or an entry point of the group `impasto.methods`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import Any

from pydantic import ValidationError

from pipeline.errors import BadParameter
from pipeline.methods.base import Method, Params


@cache
def methods() -> Mapping[str, Method]:
    """Every method by name: the built-in ones first, then those of installed packages."""
    from pipeline.methods.abstraction import Abstraction
    from pipeline.methods.analogy import Analogy

    found: dict[str, Method] = {m.name: m for m in (Abstraction(), Analogy())}
    for entry in entry_points(group="impasto.methods"):
        outside = entry.load()()
        found.setdefault(outside.name, outside)
    return MappingProxyType(found)


def method(name: str) -> Method:
    """The method `name`, or `BadParameter` that lists the names there are."""
    try:
        return methods()[name]
    except KeyError:
        raise BadParameter(
            f"There is no method named {name!r}.",
            field="method",
            value=name,
            remedy=f"Use one of: {', '.join(methods())}.",
        ) from None


def parse_params(chosen: Method, values: Mapping[str, Any]) -> Params:
    """Validate `values` against the method's Params; the first fault becomes a `BadParameter` with its remedy."""
    try:
        return chosen.Params.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(str(part) for part in first["loc"])
        remedy = (
            f"Known parameters: {', '.join(chosen.Params.model_fields)}." if first["type"] == "extra_forbidden" else ""
        )
        raise BadParameter(
            f"{first['msg']}.",
            field=f"params.{name}",
            value=first.get("input"),
            remedy=remedy or f"See the method {chosen.name!r}.",
        ) from None
