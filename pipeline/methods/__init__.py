"""The registry: a method = a row of `pipeline.method_names`, or an entry point of the group `impasto.methods`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from pkgutil import resolve_name
from types import MappingProxyType

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from pipeline.errors import BadInput, BadParameter, did_you_mean, together
from pipeline.method_names import BUILT_IN, PLATFORM
from pipeline.methods.base import LayerPart, Method, Params


@cache
def methods() -> Mapping[str, Method]:
    """Every method by name: the built-in ones first, then those of installed packages."""
    found = {name: _loaded(path) for name, path in BUILT_IN.items()}
    for method_class in (entry.load() for entry in entry_points(group="impasto.methods")):
        found.setdefault(method_class.name, method_class())
    return MappingProxyType(found)


def layer_parts() -> Mapping[str, LayerPart]:
    """The parts of all methods by name.

    Raises:
        BadInput: two methods describe parts of one name differently, or an input names a part that is not described.
    """
    found: dict[str, LayerPart] = {}
    for owner in methods().values():
        for part in owner.parts:
            if found.setdefault(part.name, part) != part:
                raise BadInput(
                    f"The method {owner.name!r} describes a part otherwise than another method does.",
                    field="parts", value=part.name, remedy="Give the part another name, or describe it alike.",
                )  # fmt: skip
        own = {"", *(part.name for part in owner.parts)}
        for spec in owner.inputs:
            if (name := spec.part.partition(".")[0]) not in own:
                raise BadInput(
                    f"An input of the method {owner.name!r} names a part that the method does not describe.",
                    field=f"inputs.{spec.name}.part", value=name, remedy="Describe it in `Method.parts`.",
                )  # fmt: skip
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
    if found["type"] == "unsorted_keys":
        remedy = "Sort the keys by frame, with one key for a frame."
    elif isinstance(value, list | tuple) and found["type"] in ("float_type", "int_type") and len(found["loc"]) == 1:
        varying = ", ".join(chosen.Params.varying()) or "none"
        remedy = f"Give one number for the whole film; parameters that can vary over it: {varying}."
    return BadParameter(f"{found['msg']}.", field=field, value=value, remedy=remedy)
