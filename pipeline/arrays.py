"""Aliases of arrays whose dtype differs from call to call, and the state of a stage as arrays by dotted name.

Frames, flows, masks and label maps have one dtype each: see `pipeline.frames`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

from numpy.typing import NDArray

AnyArray: TypeAlias = NDArray[Any]
"""An array of any dtype; the function that takes or returns it states which dtypes are allowed."""
Arrays: TypeAlias = Mapping[str, AnyArray]
"""Arrays by name: an artefact, stored without pickle, or a state to restore."""
State: TypeAlias = dict[str, AnyArray]
"""State of a stage as arrays by dotted name ("analyzer.importance.faces"). A stage that is restored from it continues
with the same output bytes."""


def flatten(parts: Mapping[str, Arrays]) -> State:
    """Merge the states of the parts of a stage: {"a": {"b": x}} -> {"a.b": x}."""
    return {f"{name}.{key}": array for name, part in parts.items() for key, array in part.items()}


def part(state: Arrays, name: str) -> State:
    """State of the part `name`, the inverse of `flatten`: {"a.b": x} and "a" -> {"b": x}."""
    return {key[len(name) + 1 :]: array for key, array in state.items() if key.startswith(name + ".")}
