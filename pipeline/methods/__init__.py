"""The registry: a method = a file and a row here, or an entry point of the group `impasto.methods`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from pkgutil import resolve_name
from types import MappingProxyType

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from pipeline.errors import BadParameter, did_you_mean, together
from pipeline.methods.base import Method, Params

BUILT_IN: Mapping[str, str] = MappingProxyType({
    "abstraction": "pipeline.methods.abstraction:Abstraction",
    "patches": "pipeline.methods.patches:Patches",
    "analogy": "pipeline.methods.analogy:Analogy",
    "multistyle": "pipeline.methods.multistyle:Multistyle",
    "steady": "pipeline.methods.steady:Steady",
})  # fmt: skip
"""Method name -> its class, named as in an entry point: a job imports only its own method, because importing all of
them takes longer than painting a small still, and methods that use other methods import this module."""
PLATFORM: Mapping[str, str] = MappingProxyType({
    "layers": "pipeline.methods.layers:Layers", "convert": "pipeline.methods.convert:Convert",
})  # fmt: skip
"""Methods of the platform's own jobs, which are not published."""


@cache
def methods() -> Mapping[str, Method]:
    """Every method by name: the built-in ones first, then those of installed packages."""
    found = {name: _loaded(path) for name, path in BUILT_IN.items()}
    for method_class in (entry.load() for entry in entry_points(group="impasto.methods")):
        found.setdefault(method_class.name, method_class())
    return MappingProxyType(found)


@cache
def _loaded(path: str) -> Method:
    found: Method = resolve_name(path)()
    return found


def method(name: str) -> Method:
    """The method `name`, or `BadParameter` that lists the names there are."""
    if (path := BUILT_IN.get(name)) is not None:
        return _loaded(path)
    if (outside := methods().get(name)) is not None:
        return outside
    if (path := PLATFORM.get(name)) is not None:
        return _loaded(path)
    raise BadParameter(
        f"Unknown method {name!r}.", field="method", value=name, remedy=did_you_mean(name, methods(), "methods")
    )


def parse_params(chosen: Method, values: Mapping[str, object]) -> Params:
    """Validate `values` against the method's Params.

    Raises: BadParameter for the first fault, with all further ones as its `others`.
    """
    try:
        return chosen.Params.model_validate(values)
    except ValidationError as error:
        raise together([_param_fault(chosen, found) for found in error.errors()]) from None


def param_faults(chosen: Method, values: Mapping[str, object]) -> list[BadParameter]:
    """Every fault of `values` as the method's Params; `field` is `params.<name>`."""
    try:
        chosen.Params.model_validate(values)
    except ValidationError as error:
        return [_param_fault(chosen, found) for found in error.errors()]
    return []


def _param_fault(chosen: Method, found: ErrorDetails) -> BadParameter:
    name = ".".join(str(part) for part in found["loc"])
    field = f"params.{name}"
    if found["type"] == "extra_forbidden":
        remedy = did_you_mean(name, chosen.Params.model_fields, "parameters")
        return BadParameter(f"Unknown parameter {name!r}.", field=field, value=found["input"], remedy=remedy)
    value = None if found["type"] == "missing" else found["input"]
    if isinstance(value, str) and (own := chosen.Params.removed_values.get(name, {}).get(value)):
        return BadParameter(f"{name} = {value!r} no longer exists.", field=field, value=value, remedy=own)
    remedy = f"See `impasto methods {chosen.name}` or GET /v1/methods/{chosen.name}."
    return BadParameter(f"{found['msg']}.", field=field, value=value, remedy=remedy)
